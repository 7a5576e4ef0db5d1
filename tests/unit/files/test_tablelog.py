import numpy as np
import pytest

from dynid.errors import LogLayout
from dynid.files.tablelog import read_table


def test_a_csv_is_read_by_its_header_whatever_the_order(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("tau_b,q_a,t,q_b,tau_a,qd_a,qd_b\n4,1,0.0,2,3,5,6\n40,10,0.1,20,30,50,60\n")
    log = read_table(path, ())
    assert log.names == ("a", "b")
    np.testing.assert_array_equal(log.q, [[1, 2], [10, 20]])
    np.testing.assert_array_equal(log.tau, [[3, 4], [30, 40]])
    np.testing.assert_array_equal(log.qd, [[5, 6], [50, 60]])


def test_currents_in_a_csv_are_amperes(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,i_a\n0,1,2\n1,2,3\n")
    log = read_table(path, ())
    assert log.tau_unit == "A"
    assert log.qd is None


def test_a_csv_joint_without_torque_is_named(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,q_b,tau_a\n0,1,2,3\n")
    with pytest.raises(LogLayout, match="joint 'b' has q_b but no tau_b"):
        read_table(path, ())


def test_an_empty_cell_is_not_a_number(tmp_path):
    path = tmp_path / "log.csv"
    path.write_text("t,q_a,tau_a\n0,1,2\n1,,3\n")
    assert np.isnan(read_table(path, ()).q[1, 0])
