import numpy as np
import pytest

from dynid import load_robot
from dynid.drivers.joint_state import Sample
from dynid.errors import PacingLate, StateStale, TorqueHigh, TrackingLost
from dynid.record.monitor import Monitor

ARM = load_robot("kuka_lwr4plus")
STILL = np.zeros(7)


def seen(arrival, q=STILL, tau=STILL):
    return Sample(arrival, q, tau)


def test_a_good_state_passes_and_is_remembered():
    monitor = Monitor(ARM)
    monitor.state(seen(10.0, q=np.full(7, 0.1), tau=np.full(7, 3.8)), STILL, 10.1, 1.0)
    assert monitor.outcome.largest_deviation == pytest.approx(0.1)
    assert monitor.outcome.largest_torque_share == pytest.approx(0.1)


def test_an_old_state_stops():
    with pytest.raises(StateStale, match=r"no joint state for 0\.30 s"):
        Monitor(ARM).state(seen(10.0), STILL, 10.3, 1.0)


@pytest.mark.parametrize("off", [0.2, -0.2, float("nan")])
def test_a_joint_that_is_elsewhere_stops(off):
    with pytest.raises(TrackingLost):
        Monitor(ARM).state(seen(10.0, q=np.full(7, off)), STILL, 10.0, 1.0)


def test_one_spike_of_torque_passes_and_three_running_stop():
    monitor, high = Monitor(ARM), np.array([0, 150.0, 0, 0, 0, 0, 0])
    for k, tau in enumerate((high, STILL, high, high)):
        monitor.state(seen(10.0 + k, tau=tau), STILL, 10.0 + k, float(k))
    with pytest.raises(TorqueHigh, match="lwr_1_joint reads 150"):
        monitor.state(seen(20.0, tau=high), STILL, 20.0, 5.0)


def test_the_same_state_is_judged_once():
    monitor = Monitor(ARM)
    for _ in range(5):
        monitor.state(seen(10.0, tau=np.full(7, 170.0)), STILL, 10.0, 1.0)


def test_a_late_command_stops():
    monitor = Monitor(ARM)
    monitor.pace(0.02, 1.0)
    with pytest.raises(PacingLate):
        monitor.pace(0.11, 1.0)
    assert monitor.outcome.largest_lateness == pytest.approx(0.11)
