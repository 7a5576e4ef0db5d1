import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import LogLayout
from dynid.files.tables import in_seconds, read_table


def test_a_csv_is_read_by_its_header_whatever_the_order(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("tau_b,q_a,t,q_b,tau_a,qd_a,qd_b\n4,1,0.0,2,3,5,6\n40,10,0.1,20,30,50,60\n")
    log = read_table(path, ())
    assert log.names == ("a", "b")
    assert_array_equal(log.q, [[1, 2], [10, 20]])
    assert_array_equal(log.tau, [[3, 4], [30, 40]])
    assert_array_equal(log.qd, [[5, 6], [50, 60]])


def test_currents_in_a_csv_are_amperes(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,i_a\n0,1,2\n1,2,3\n")
    log = read_table(path, ())
    assert log.tau_unit == "A"
    assert log.qd is None


def test_a_joint_without_torque_has_none_and_sensors_come_before_currents(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,q_b,tau_a,i_a,i_b\n0,1,2,3,4,5\n")
    assert_array_equal(read_table(path, (), sensors=True).tau, [[3, np.nan]])
    assert_array_equal(read_table(path, ()).tau, [[4, 5]])
    path.write_text("t,q_a,q_b,tau_a\n0,1,2,3\n")
    assert_array_equal(read_table(path, ()).tau, [[3, np.nan]])


def test_an_empty_cell_is_not_a_number(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,tau_a\n0,1,2\n1,,3\n")
    assert np.isnan(read_table(path, ()).q[1, 0])


def test_columns_are_found_by_number_from_0_or_1(tmp_path):
    patterns = {"time": "timestamp", "position": "actual_q_{i}", "effort": "i_{name}"}
    for first in (0, 1):
        path = tmp_path / f"from{first}.csv"
        path.write_text(
            f"timestamp,actual_q_{first},actual_q_{first + 1},i_a,i_b\n0,1,2,3,4\n0.1,5,6,7,8\n"
        )
        log = read_table(path, ("a", "b"), patterns)
        assert_array_equal(log.q, [[1, 2], [5, 6]])
        assert_array_equal(log.tau, [[3, 4], [7, 8]])
        assert log.names == ("a", "b")


def test_an_unknown_header_is_answered_with_the_columns_to_paste(tmp_path):
    path = tmp_path / "ur.csv"
    path.write_text(
        "timestamp;actual_q_0;actual_q_1;actual_current_0;actual_current_1\n0;1;2;3;4\n"
    )
    with pytest.raises(LogLayout) as caught:
        read_table(path, ("a", "b"))
    assert (
        'columns: {time: "timestamp", position: "actual_q_{i}", effort: "actual_current_{i}"}'
        in caught.value.fix
    )


@pytest.mark.parametrize(("unit", "factor"), [("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize(("start", "count"), [(0.0, 100), (1.7e9, 100), (1.7e9, 1_000_000)])
def test_stamps_tell_their_unit(unit, factor, start, count):
    seconds, (said,) = in_seconds((start + np.arange(count) * 0.008) * factor, "t", "log.csv")
    assert_allclose(np.diff(seconds), 0.008, atol=1e-6)
    assert said.evidence == {"unit": unit, "seconds": pytest.approx(0.008 * (count - 1))}


def test_stamps_in_seconds_stay_as_they_are():
    t = 1.7e9 + np.arange(100) * 0.2
    seconds, findings = in_seconds(t, "t", "log.csv")
    assert_array_equal(seconds, t)
    assert findings == ()
