"""The figures of sections show the numbers that they are made from."""

from dataclasses import replace

import numpy as np
import pytest
from matplotlib.colors import same_color
from numpy.testing import assert_allclose, assert_array_equal

from dynid.estimation.prediction import EstimatedMotion
from dynid.model.parameters import second_moments
from dynid.reports.figures import ESTIMATED, MEASURED
from dynid.reports.section_figures import (
    bodies_figure,
    body_outline,
    coverage_figure,
    error_figure,
    inertia_tensor,
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
    motion = EstimatedMotion(
        np.arange(4800.0), q, q, qd, qd, zero, zero, np.sign(qd), zero, zero == 0
    )
    _, line, _, size = residual_averages(motion, 0, "velocity")
    assert len(line) == 24
    assert size == pytest.approx(1.0, rel=1e-3)
    assert set(np.sign(line[:11])) == {-1.0}
    assert np.abs(np.abs(np.delete(line, [11, 12])) - 1).max() < 1e-12
    assert np.abs(residual_averages(motion, 0, "position")[1]).max() < 0.3
    shown = residual_figure(motion, robot).axes[0].get_lines()[-1].get_ydata()
    assert_array_equal(shown, line)


@pytest.mark.slow
@pytest.mark.parametrize("count", [0, 1, 25, 26])
def test_a_residual_of_so_few_samples_is_drawn(robot, count):
    some = np.ones((count, robot.n))
    motion = EstimatedMotion(np.arange(float(count)), *[some] * 6, 0.9 * some, 0.0 * some, some > 0)
    residual_figure(motion, robot).draw_without_rendering()


def test_singular_values_are_shares_of_the_largest():
    (axis,) = spectrum_figure(np.array([4.0, 0.4, 0.04, 0.002])).axes
    assert axis.get_yscale() == "log"
    assert_allclose(axis.get_lines()[0].get_ydata(), [1.0, 0.1, 0.01, 0.0005])


def test_bars_are_standard_errors_in_percent_cut_at_300(gathered):
    """0.01 over the value; a parameter that is not determined, or zero, has no bar."""
    found = gathered.result
    shown = np.isfinite(found.std_error) & (found.theta != 0)
    assert not shown.all()
    (axis,) = error_figure(found).axes
    percent = np.clip(1 / np.abs(found.theta[shown]), 0.05, 300)
    ends = [bar.get_x() + bar.get_width() for bar in axis.patches]
    assert_allclose(ends, percent)


def test_the_outline_of_a_body_is_that_of_the_ellipsoid_with_its_mass_and_inertia(gathered):
    """A uniform ellipsoid of semi-axes a has second moments m a^2 / 5; rotated by 90 degrees about x."""
    axes = np.array([0.3, 0.2, 0.1])
    moments = 2.0 * (np.sum(axes**2) - axes**2) / 5
    inertia = {"Ixx": moments[0], "Iyy": moments[1], "Izz": moments[2]}
    inertia |= {"Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0}
    link = {"link": 1, "mass_kg": 2.0, "com_m": [0.0, 0.0, 0.5], "inertia_com_kg_m2": inertia}
    assert_allclose(5 * second_moments(inertia_tensor(link)) / 2.0, np.diag(axes**2), atol=1e-12)
    pose = np.eye(4)
    pose[:3, :3] = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    x, z = body_outline(pose, link, (0, 2)).T
    assert (x.max(), z.max()) == (pytest.approx(0.3, rel=0.01), pytest.approx(0.2, rel=0.01))
    front = body_outline(pose, link, (1, 2))
    assert front[:, 0].min() == pytest.approx(-0.6, rel=0.01)
    figure = bodies_figure(gathered.robot, gathered.result.links())
    assert [len(axis.texts) for axis in figure.axes] == [gathered.robot.n] * 2


def test_names_of_joints_are_no_formulas(motion, robot):
    hostile = replace(robot, joints=tuple(replace(j, name="$\\frac$") for j in robot.joints))
    for figure in (coverage_figure(motion, hostile), residual_figure(motion, hostile)):
        figure.draw_without_rendering()
