"""Figures show the numbers that they are made from."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from dynid.reports.figures import (
    QUANTITIES,
    motion_figure,
)


def curves(axis):
    """Return the curves of a panel by label, without the breaks at gaps."""
    return {
        line.get_label(): np.asarray(line.get_ydata())[np.isfinite(line.get_ydata())]
        for line in axis.get_lines()
    }


def panels(figure):
    return [axis for axis in figure.axes if axis.get_visible()]


@pytest.mark.parametrize("quantity", QUANTITIES, ids=lambda each: each.key)
def test_each_panel_shows_measured_and_estimated_of_its_joint(motion, robot, quantity):
    figure = motion_figure(motion, robot, quantity=quantity)
    assert len(panels(figure)) == robot.n
    for j, axis in enumerate(panels(figure)):
        joint = robot.joints[j]
        unit = quantity.units[0 if joint.revolute else 1]
        assert axis.get_title(loc="left") == f"{joint.name} [{unit}]"
        found = curves(axis)
        measured = getattr(motion, f"{quantity.key}_measured")[:, j]
        estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
        assert_array_equal(found["measured"], measured)
        assert_array_equal(found["estimated"], estimated)
        assert set(found) == {"measured", "estimated"} | (
            {"residual"} if quantity.key == "tau" else set()
        )


def test_the_residual_is_measured_minus_estimated_torque(motion, robot):
    for only in (False, True):
        (axis,) = panels(motion_figure(motion, robot, joints=("slide",), residual_only=only))
        found = curves(axis)
        j = robot.joint_names.index("slide")
        assert_array_equal(
            found["residual"], motion.tau_measured[:, j] - motion.tau_estimated[:, j]
        )
        assert set(found) == ({"residual"} if only else {"measured", "estimated", "residual"})
        assert axis.get_title(loc="left") == "slide [N]"


def test_no_line_crosses_a_gap_in_time(motion, robot):
    """Nobody measured there: the curve has one break, at 5 s."""
    (axis,) = panels(motion_figure(motion, robot, joints=("slide",), residual_only=True))
    x = np.asarray(axis.get_lines()[0].get_xdata())
    assert np.flatnonzero(np.isnan(x)).tolist() == [500]
    assert np.nanmax(np.diff(x)) < 0.011
