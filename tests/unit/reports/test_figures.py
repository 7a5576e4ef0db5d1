"""Figures show the numbers that they are made from."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.estimation.prediction import EstimatedMotion
from dynid.reports.figures import (
    PARTS,
    QUANTITIES,
    motion_figure,
    thinned,
    torque_figure,
    write_figure,
    write_motion_figures,
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
    figure = motion_figure(motion, robot, quantity, "run")
    assert len(panels(figure)) == robot.n
    for j, axis in enumerate(panels(figure)):
        joint = robot.joints[j]
        unit = quantity.units[0 if joint.revolute else 1]
        assert axis.get_title(loc="left") == f"{joint.name} [{unit}]"
        found = curves(axis)
        measured = getattr(motion, f"{quantity.key}_measured")[:, j]
        estimated = getattr(motion, f"{quantity.key}_estimated")[:, j]
        np.testing.assert_array_equal(found["measured"], measured)
        np.testing.assert_array_equal(found["estimated"], estimated)
        assert set(found) == {"measured", "estimated"} | (
            {"residual"} if quantity.key == "tau" else set()
        )


def test_titles_leave_room_for_numbers_which_stay_on_the_figure(motion, robot):
    wide = replace(motion, tau_measured=-1234.5 * motion.tau_measured)
    figure = motion_figure(wide, robot, QUANTITIES[3], "run")
    figure.draw_without_rendering()
    for above, below in zip(panels(figure), panels(figure)[1:], strict=False):
        assert below.title.get_window_extent().y1 < above.bbox.y0
    for axis in panels(figure):
        assert all(text.get_window_extent().x0 >= 0.0 for text in axis.get_yticklabels())
    assert panels(figure)[-1].xaxis.label.get_window_extent().y0 >= 0.0


def test_the_residual_is_measured_minus_estimated_torque(motion, robot):
    for only in (False, True):
        (axis,) = panels(torque_figure(motion, robot, ("slide",), "run", residual_only=only))
        found = curves(axis)
        j = robot.joint_names.index("slide")
        np.testing.assert_array_equal(
            found["residual"], motion.tau_measured[:, j] - motion.tau_estimated[:, j]
        )
        assert set(found) == ({"residual"} if only else {"measured", "estimated", "residual"})
        assert axis.get_title(loc="left") == "slide [N]"


def test_no_line_crosses_a_gap_in_time(motion, robot):
    """Nobody measured there: the curve has one break, at 5 s."""
    (axis,) = panels(torque_figure(motion, robot, ("slide",), "run", residual_only=True))
    x = np.asarray(axis.get_lines()[0].get_xdata())
    assert np.flatnonzero(np.isnan(x)).tolist() == [500]
    assert np.nanmax(np.diff(x)) < 0.011


def test_long_logs_are_thinned_to_what_a_screen_shows_and_keep_their_spikes(robot):
    n = 200 * PARTS
    t, wave = np.arange(n) * 0.01, np.zeros((n, robot.n))
    wave[777] = 5.0
    motion = EstimatedMotion(t, *(wave,) * 6, wave, 0 * wave, np.ones(wave.shape, dtype=bool))
    (axis,) = panels(torque_figure(motion, robot, ("slide",), "run", residual_only=True))
    x, y = axis.get_lines()[0].get_data()
    assert len(x) <= 2 * PARTS + 2
    assert (y.max(), x[np.argmax(y)]) == (5.0, t[777])
    assert (x[0], x[-1]) == (t[0], t[-1])


def test_names_are_labels_not_formulas(motion, robot):
    hostile = replace(
        robot,
        joints=tuple(
            replace(j, name=f"$\\frac{{{k}}}$\n\u202e") for k, j in enumerate(robot.joints)
        ),
    )
    figure = motion_figure(motion, hostile, QUANTITIES[0], "$x$")
    assert panels(figure)[0].get_title(loc="left") == r"\$\frac{0}\$<U+000A><U+202E> [rad]"
    assert figure.get_suptitle() == r"\$x\$: position"
    figure.draw_without_rendering()


def test_equal_figures_give_equal_files(motion, robot, tmp_path):
    """PNG and SVG, written by their suffix; no date and no random ids."""
    for suffix, start in ((".png", b"\x89PNG"), (".svg", b"<?xml")):
        paths = [
            write_figure(torque_figure(motion, robot, ("slide",), "run"), tmp_path / f"{k}{suffix}")
            for k in range(2)
        ]
        one, two = (path.read_bytes() for path in paths)
        assert one == two
        assert one.startswith(start)


def test_the_four_figures_of_a_validation_are_written(motion, robot, tmp_path):
    names = ["position", "velocity", "acceleration", "torque"]
    assert write_motion_figures(tmp_path, motion, robot, "run") == [
        tmp_path / f"{name}.png" for name in names
    ]
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(
        f"{n}{s}" for n in names for s in (".png", ".svg")
    )


def test_an_outline_keeps_every_extreme_and_both_ends():
    rng = np.random.default_rng(3)
    x, y = np.arange(50_000.0), rng.standard_normal(50_000)
    y[[11, 40_000]] = 9.0, -9.0
    kept, values = thinned(x, y)
    assert len(kept) <= 2 * PARTS + 2
    assert {11.0, 40_000.0, 0.0, 49_999.0} <= set(kept)
    np.testing.assert_array_equal(values, y[kept.astype(int)])
