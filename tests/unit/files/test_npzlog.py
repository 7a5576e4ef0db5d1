"""The .npz log comes back as it was written; plain npz files are read with an assumed order."""

import json
from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import LogLayout, LogNotFound, NewerSchema
from dynid.files.logs import read_log, read_npz_log
from dynid.signals.checks import prepare
from makelogs import lwr, lwr_log, shared_data

ONES = np.ones((3, 2))
LOG = {"t": np.arange(3.0), "q": ONES, "tau": ONES}


def saved(folder, header=None, **arrays):
    """Return a file of somebody else: arrays, and maybe a header."""
    facts = {} if header is None else {"header": np.array(json.dumps(header))}
    np.savez(folder / "log.npz", **facts, **arrays)
    return folder / "log.npz"


def test_units_declared_by_the_file_go_before_those_of_the_robot_file(tmp_path):
    log = replace(lwr_log(), q=np.degrees(lwr_log().q), units={"position": "deg"})
    again = prepare(read_npz_log(log.save(tmp_path / "log.npz")), lwr())
    np.testing.assert_allclose(again.q, lwr_log().q, atol=1e-12)


def test_a_plain_file_has_its_order_assumed_and_says_so_where_no_header_names_the_joints(tmp_path):
    some = lwr_log()
    log = read_log(saved(tmp_path, t=some.t, q=some.q, tau=some.tau), robot=lwr())
    assert (log.names, [f.code for f in log.findings]) == ((), ["W320"])
    assert read_npz_log(saved(tmp_path, {"joint_names": ["b", "a"]}, **LOG)).names == ("b", "a")


def test_motor_columns_are_known_by_their_names(tmp_path):
    assert read_npz_log(saved(tmp_path, t=LOG["t"], q_motor=ONES, tau_motor=ONES)).motor_side


@pytest.mark.data
def test_the_recorded_tx40_is_on_the_motor_side():
    assert read_npz_log(shared_data("tx40/exc.npz")).motor_side


@pytest.mark.parametrize(
    ("change", "error", "said"),
    [
        ({"tau": None}, LogLayout, "no array 'tau'; it has q, t"),
        ({"t": 5.0}, LogLayout, "'q'"),
        ({"t": np.ones((4, 2))}, LogLayout, "'q'"),
        # Objects would have to be pickled, and are never loaded.
        ({"t": np.array([{"a": 1}], dtype=object)}, LogNotFound, "damaged"),
    ],
)
def test_missing_arrays_and_odd_ones_are_refused(tmp_path, change, error, said):
    arrays = {key: x for key, x in (LOG | change).items() if x is not None}
    with pytest.raises(error, match=said):
        read_npz_log(saved(tmp_path, **arrays))


@pytest.mark.parametrize(
    ("header", "error", "said"),
    [
        ({"schema": "dynid/log/2", "dynid": "9.9"}, NewerSchema, r"written by dynid 9\.9"),
        ({"schema": "dynid/regressor/1"}, LogNotFound, "dynid/regressor/1, not a log"),
    ],
)
def test_what_the_header_says_decides_whether_it_is_a_log(tmp_path, header, error, said):
    with pytest.raises(error, match=said):
        read_npz_log(saved(tmp_path, header, **LOG))
