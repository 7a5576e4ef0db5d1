import time

import numpy as np
import pytest

from dynid import load_robot
from dynid.drivers.joint_state import Sample
from dynid.errors import StartPoseOff, StateStale
from dynid.record.preflight import ObservedState, check_place, check_start
from motions import standing

ARM = load_robot("kuka_lwr4plus")
STILL = np.zeros(7)
REST = standing(STILL)


def off(size):
    return size * (np.arange(7) == 3)


@pytest.mark.parametrize(("q", "moved"), [(off(0.06), 0.0), (off(np.nan), 0.0), (STILL, 0.03)])
def test_a_motion_begins_at_its_first_pose_with_an_arm_at_rest(q, moved):
    check_start(ObservedState(off(0.04), STILL, 100.0, 0.01), ARM, REST)
    with pytest.raises(StartPoseOff):
        check_start(ObservedState(q, STILL, 100.0, moved), ARM, REST)


def test_an_arm_that_was_moved_or_fell_silent_while_a_person_was_asked_is_not_commanded():
    check_place(Sample(time.monotonic(), off(0.04), STILL), ARM, REST)
    with pytest.raises(StartPoseOff, match="moved after it was checked"):
        check_place(Sample(time.monotonic(), off(0.4), STILL), ARM, REST)
    with pytest.raises(StateStale, match="the arm was not moved"):
        check_place(Sample(time.monotonic() - 1.0, STILL, STILL), ARM, REST)
