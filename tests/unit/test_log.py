"""A log is made from arrays, says what does not fit, shows itself, and comes back from disk as it was saved."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from dynid import Log
from dynid.errors import JointNamesDiffer, LogLayout
from dynid.files.logs import read_log
from dynid.signals.checks import prepare
from makelogs import lwr, lwr_log

T = np.arange(5) / 100


def test_anything_that_numpy_understands_becomes_float64():
    ones = np.ones((3, 1), np.float32)
    log = Log([0, 1, 2], [[1], [2], [3]], ones, ["elbow"], extra={"q_ref": [[0], [0], [1]]})
    columns = log.q, log.tau, log.extra["q_ref"]
    assert [x.shape for x in columns] == [(3, 1)] * 3
    assert {x.dtype for x in (log.t, *columns)} == {np.dtype(np.float64)}
    assert (log.names, log.n, len(log), log.duration, log.rate) == (("elbow",), 1, 3, 2.0, 1.0)
    assert "nan Hz" in repr(replace(log, t=0 * log.t))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"q": np.ones((4, 2))}, r"array 'q' is \(4, 2\), expected \(5, number of joints\)"),
        ({"tau": np.ones((5, 3))}, r"array 'tau' is \(5, 3\), expected \(5, 2\)"),
        ({"qd": np.ones((5, 1))}, r"array 'qd' is \(5, 1\), expected \(5, 2\)"),
        ({"extra": {"q_ref": np.ones(5)}}, r"array 'q_ref' is \(5,\), expected \(5, 2\)"),
        ({"tau": [["a", "b"]] * 5}, "array 'tau' holds no numbers"),
        ({"q": [[1, 2], [3]]}, "array 'q' holds .* rows of different lengths"),
        ({"names": ("one",)}, "the log: 1 names for 2 columns"),
        ({"units": {"position": "gon"}}, "units.position = gon is not known; known: rad, deg"),
        (
            {"units": {"place": "rad"}},
            "units.place = rad is not known; known: position, velocity, effort",
        ),
        ({"tau_unit": "mA"}, "tau_unit = mA is not known; known: Nm, A"),
    ],
)
def test_what_does_not_fit_is_named(change, text):
    with pytest.raises(LogLayout, match=text):
        Log(**{"t": T, "q": np.ones((5, 2)), "tau": np.ones((5, 2)), **change})


def test_a_table_has_one_column_for_each_quantity_of_each_joint():
    pytest.importorskip("pandas")
    q = np.arange(10.0).reshape(5, 2)
    table = Log(T, q, 10 * q, ("a", "b"), qd=-q).to_dataframe()
    assert list(table.columns) == ["q_a", "q_b", "qd_a", "qd_b", "tau_a", "tau_b"]
    assert_array_equal(table["tau_b"], 10 * q[:, 1])
    assert_array_equal(table.index, T)
    assert list(Log(T, q, q).to_dataframe().columns)[:2] == ["q_joint_1", "q_joint_2"]


def test_what_is_saved_is_read_back(tmp_path):
    ones = np.ones((5, 2))
    made = Log(T, ones, 2 * ones, ("a", "b"), units={"position": "deg"}, tau_unit="A")
    made = replace(made, extra={"q_ref": 3 * ones})
    for log in (made, prepare(lwr_log(), lwr())):
        again = read_log(log.save(tmp_path / "log.npz"), robot=lwr())
        for key in ("t", "q", "tau"):
            assert_array_equal(getattr(again, key), getattr(log, key))
        assert (again.names, again.tau_unit, again.dh, again.checked) == (
            log.names,
            log.tau_unit,
            log.dh,
            False,
        )
        if log is made:
            assert_array_equal(again.extra["q_ref"], 3 * ones)
            assert (again.qd, again.units["position"]) == (None, "deg")


def test_a_checked_log_is_not_checked_again_but_still_cut_and_asked_for_enough_motion():
    log = prepare(lwr_log(), lwr())
    assert log.checked
    assert_array_equal(prepare(log, lwr()).q, log.q)
    assert prepare(log, lwr(), exclude=[(-1.0, 5.0)]).t[0] > 5.0
    short = [(2.0, 1e9)]
    assert "W313" in [finding.code for finding in prepare(log, lwr(), exclude=short).findings]
    assert prepare(log, lwr(), exclude=short, identify=False).duration < 2.1
    other = replace(
        lwr(),
        joints=tuple(replace(joint, name=f"x{joint.name}") for joint in lwr().joints),
        driver=None,
    )
    with pytest.raises(JointNamesDiffer):
        prepare(log, other)
