"""The figures of sections show the numbers that they are made from."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color
from numpy.testing import assert_allclose, assert_array_equal

from dynid.estimation.prediction import EstimatedMotion
from dynid.reports.figures import ESTIMATED, MEASURED
from dynid.reports.section_figures import (
    coverage_figure,
    residual_averages,
    residual_figure,
    spectrum_figure,
)


def bars(axis, color):
    """Return left ends and widths of the bars of a colour."""
    shown = [bar for bar in axis.patches if same_color(bar.get_facecolor()[:3], color)]
    return np.array([(bar.get_x(), bar.get_width()) for bar in shown]).reshape(-1, 2)


def test_coverage_shows_the_range_of_each_joint_over_its_limits(motion, robot):
    for axis, values, limits in zip(
        coverage_figure(motion, robot).axes,
        (motion.q_estimated, motion.qd_estimated),
        (
            [joint.limits.position for joint in robot.joints],
            [(-joint.limits.velocity, joint.limits.velocity) for joint in robot.joints],
        ),
        strict=True,
    ):
        done = np.column_stack([values.min(axis=0), np.ptp(values, axis=0)])
        assert_allclose(bars(axis, ESTIMATED), done)
        low, high = np.array(limits).T
        assert_allclose(bars(axis, MEASURED), np.column_stack([low, high - low]))


def test_the_residual_over_velocity_shows_a_friction_step_that_was_left(robot):
    """A residual of sign(qd) is -1 on the left and +1 on the right; over an unrelated position it is flat."""
    rng = np.random.default_rng(2)
    qd, q = rng.uniform(-1, 1, (2, 4800, robot.n))
    zero = np.zeros_like(q)
    t = np.arange(4800.0)
    motion = EstimatedMotion(t, q, q, qd, qd, zero, zero, np.sign(qd), zero, zero == 0, t)
    _, line, _, size = residual_averages(motion, 0, "velocity")
    assert len(line) == 24
    assert size == pytest.approx(1.0, rel=1e-3)
    assert set(np.sign(line[:11])) == {-1.0}
    assert np.abs(np.abs(np.delete(line, [11, 12])) - 1).max() < 1e-12
    assert np.abs(residual_averages(motion, 0, "position")[1]).max() < 0.3
    shown = residual_figure(motion, robot).axes[0].get_lines()[0].get_ydata()
    assert_array_equal(shown, line)


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 25, 26])
def test_a_residual_of_so_few_samples_is_drawn(robot, count):
    some = np.ones((count, robot.n))
    t = np.arange(float(count))
    motion = EstimatedMotion(t, *[some] * 6, 0.9 * some, 0.0 * some, some > 0, t)
    residual_figure(motion, robot).draw_without_rendering()


def test_singular_values_are_shares_of_the_largest():
    (axis,) = spectrum_figure(np.array([4.0, 0.4, 0.04, 0.002])).axes
    assert axis.get_yscale() == "log"
    assert_allclose(axis.get_lines()[0].get_ydata(), [1.0, 0.1, 0.01, 0.0005])


def test_names_of_joints_are_no_formulas(motion, robot):
    hostile = replace(robot, joints=tuple(replace(j, name="$\\frac$") for j in robot.joints))
    for figure in (coverage_figure(motion, hostile), residual_figure(motion, hostile)):
        figure.draw_without_rendering()
