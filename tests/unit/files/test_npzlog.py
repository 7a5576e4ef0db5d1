"""The .npz log comes back as it was written; plain npz files are read with an assumed order."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import LogLayout, LogNotFound, NewerSchema
from dynid.files.logs import read_log, read_npz_log
from dynid.signals.checks import prepare
from makelogs import lwr, lwr_log, shared_data


def test_a_log_comes_back_as_it_was_written(tmp_path):
    log = replace(lwr_log(), tau_unit="Nm", dh=True, extra={"q_ref": lwr_log().q + 1})
    log.save(tmp_path / "log.npz")
    again = read_npz_log(tmp_path / "log.npz")
    for key in ("t", "q", "tau"):
        np.testing.assert_array_equal(getattr(again, key), getattr(log, key))
    np.testing.assert_array_equal(again.extra["q_ref"], log.q + 1)
    assert (again.names, again.tau_unit, again.dh, again.qd) == (log.names, "Nm", True, None)


def test_units_declared_by_the_file_go_before_those_of_the_robot_file(tmp_path):
    log = replace(lwr_log(), q=np.degrees(lwr_log().q), units={"position": "deg"})
    log.save(tmp_path / "log.npz")
    again = prepare(read_npz_log(tmp_path / "log.npz"), lwr())
    np.testing.assert_allclose(again.q, lwr_log().q, atol=1e-12)


def test_a_unit_that_is_not_known_is_refused_with_those_that_are(tmp_path):
    header = np.array(json.dumps({"schema": "dynid/log/1", "units": {"position": "gon"}}))
    np.savez(
        tmp_path / "log.npz",
        t=np.arange(3.0),
        q=np.ones((3, 2)),
        tau=np.ones((3, 2)),
        header=header,
    )
    with pytest.raises(LogLayout, match=r"units\.position = gon is not known; known: rad, deg"):
        read_npz_log(tmp_path / "log.npz")


def test_the_same_log_gives_the_same_bytes(tmp_path):
    lwr_log().save(tmp_path / "a.npz")
    lwr_log().save(tmp_path / "b.npz")
    assert (tmp_path / "a.npz").read_bytes() == (tmp_path / "b.npz").read_bytes()


def test_a_plain_file_has_its_order_assumed_and_says_so(tmp_path):
    np.savez(tmp_path / "log.npz", t=lwr_log().t, q=lwr_log().q, tau=lwr_log().tau)
    log = read_log(tmp_path / "log.npz", robot=lwr())
    assert log.names == ()
    assert [f.code for f in log.findings] == ["W320"]


def test_motor_columns_are_known_by_their_names(tmp_path):
    np.savez(
        tmp_path / "log.npz", t=np.arange(3.0), q_motor=np.ones((3, 2)), tau_motor=np.ones((3, 2))
    )
    assert read_npz_log(tmp_path / "log.npz").motor_side


def test_a_log_of_a_newer_dynid_asks_to_upgrade(tmp_path):
    header = np.array(json.dumps({"schema": "dynid/log/2", "dynid": "9.9"}))
    np.savez(
        tmp_path / "log.npz",
        t=np.arange(3.0),
        q=np.ones((3, 2)),
        tau=np.ones((3, 2)),
        header=header,
    )
    with pytest.raises(NewerSchema, match=r"written by dynid 9\.9"):
        read_npz_log(tmp_path / "log.npz")


def test_another_result_is_not_a_log(tmp_path):
    np.savez(tmp_path / "log.npz", header=np.array(json.dumps({"schema": "dynid/regressor/1"})))
    with pytest.raises(LogNotFound, match="dynid/regressor/1, not a log"):
        read_npz_log(tmp_path / "log.npz")


def test_a_missing_array_is_named(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.arange(3.0), q=np.ones((3, 2)))
    with pytest.raises(LogLayout, match="no array 'tau'; it has q, t"):
        read_npz_log(tmp_path / "log.npz")


def test_pickled_objects_are_never_loaded(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.array([{"a": 1}], dtype=object))
    with pytest.raises(LogNotFound):
        read_npz_log(tmp_path / "log.npz")


def test_arrays_of_different_size_are_refused(tmp_path):
    np.savez(tmp_path / "log.npz", t=np.arange(3.0), q=np.ones((3, 2)), tau=np.ones((3, 3)))
    with pytest.raises(LogLayout, match="'tau'"):
        read_npz_log(tmp_path / "log.npz")


@pytest.mark.parametrize("t", [5.0, np.ones((4, 2))])
def test_odd_shapes_of_time_are_refused(tmp_path, t):
    np.savez(tmp_path / "log.npz", t=t, q=np.ones((4, 2)), tau=np.ones((4, 2)))
    with pytest.raises(LogLayout):
        read_npz_log(tmp_path / "log.npz")


def test_a_truncated_file_is_no_log(tmp_path):
    lwr_log().save(tmp_path / "log.npz")
    content = (tmp_path / "log.npz").read_bytes()
    (tmp_path / "log.npz").write_bytes(content[: len(content) // 2])
    with pytest.raises(LogNotFound, match="damaged"):
        read_npz_log(tmp_path / "log.npz")


@pytest.mark.data
def test_the_recorded_tx40_is_on_the_motor_side():
    assert read_npz_log(shared_data("tx40/exc.npz")).motor_side
