"""The charts of a page show the numbers that they are made from; read back from their SVG."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace
from xml.etree import ElementTree

import numpy as np
import pytest

from dynid.estimation.prediction import EstimatedMotion
from dynid.reports.chart import PARTS, Curve, Panel, chart, outline, ticks
from dynid.reports.charts import (
    coverage_chart,
    error_chart,
    residual_averages,
    residual_chart,
    residual_model_chart,
    spectrum_chart,
    torque_chart,
)

SVG = "{http://www.w3.org/2000/svg}"


def paths(svg, color):
    return [
        e
        for e in ElementTree.fromstring(svg).iter(f"{SVG}path")
        if e.get("stroke") == f"var(--{color})"
    ]


def points(path):
    return np.array(re.findall(r"[ML](-?[0-9.]+) (-?[0-9.]+)", path.get("d")), dtype=float)


def rectangles(svg, color):
    return [
        {key: float(e.get(key)) for key in ("x", "y", "width", "height")}
        for e in ElementTree.fromstring(svg).iter(f"{SVG}rect")
        if e.get("fill") == f"var(--{color})"
    ]


def test_a_curve_is_a_straight_image_of_its_numbers():
    x, y = np.linspace(0.0, 3.0, 50), np.random.default_rng(1).uniform(-1.0, 2.0, 50)
    svg = chart(
        [Panel("a", (Curve(x, y, "measured", 1.0),), -1.5, 2.5)],
        "time [s]",
        "a",
        width=300,
        height=100,
    )
    (path,) = paths(svg, "measured")
    found = points(path)
    for drawn, values in zip(found.T, (x, y), strict=True):
        slope, start = np.polyfit(values, drawn, 1)
        np.testing.assert_allclose(
            start + slope * values, drawn, atol=0.06
        )  # a tenth of a pixel is written
    assert np.polyfit(y, found[:, 1], 1)[0] == pytest.approx(-25.0, rel=0.01)


def test_no_line_crosses_a_gap_in_time(motion, robot):
    for color in ("measured", "estimated", "residual"):
        (path,) = paths(torque_chart(motion, robot, 2, "torque"), color)
        assert path.get("d").count("M") == 2


def test_an_outline_keeps_every_extreme_and_both_ends():
    rng = np.random.default_rng(3)
    x, y = np.arange(50_000.0), rng.standard_normal(50_000)
    y[[11, 40_000]] = 9.0, -9.0
    kept, values = outline(x, y)
    assert len(kept) <= 2 * PARTS + 2
    assert {11.0, 40_000.0, 0.0, 49_999.0} <= set(kept)
    np.testing.assert_array_equal(values, y[kept.astype(int)])


@pytest.mark.parametrize(
    ("low", "high"), [(0.0, 1.0), (-3.2, 17.0), (1e-9, 3e-9), (-5e6, 2.0), (4.0, 4.0)]
)
def test_ticks_are_few_round_and_inside(low, high):
    found = ticks(low, high, 5)
    assert 1 <= len(found) <= 12
    assert all(low - 1e-9 * abs(low) <= value <= high + 1e-9 * abs(high) for value in found)


def test_coverage_shows_the_range_of_each_joint_over_its_limits(motion, robot):
    svg = coverage_chart(motion, robot, "coverage")
    blue, grey = rectangles(svg, "estimated"), rectangles(svg, "measured")
    both = np.concatenate([np.ptp(motion.q_estimated, axis=0), np.ptp(motion.qd_estimated, axis=0)])
    drawn = np.array([bar["width"] for bar in blue])
    for part in (slice(0, robot.n), slice(robot.n, None)):
        np.testing.assert_allclose(
            drawn[part] / drawn[part][0], both[part] / both[part][0], rtol=0.02
        )
    limits = [joint.limits.position for joint in robot.joints if joint.limits.position]
    wide = np.array([bar["width"] for bar in grey[: len(limits)]])
    np.testing.assert_allclose(wide / drawn[0], np.ptp(limits, axis=1) / both[0], rtol=0.02)


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


@pytest.mark.parametrize("count", [0, 1, 25, 26])
def test_a_residual_of_so_few_samples_is_drawn(robot, count):
    some = np.ones((count, robot.n))
    motion = EstimatedMotion(np.arange(float(count)), *[some] * 6, 0.9 * some, 0.0 * some, some > 0)
    assert len(ElementTree.fromstring(residual_chart(motion, robot, "load", "few"))) > 0


def test_singular_values_stand_at_their_decades():
    svg = spectrum_chart(np.array([4.0, 0.4, 0.04, 0.002]), "spectrum")
    heights = points(paths(svg, "estimated")[0])[:, 1]
    np.testing.assert_allclose(np.diff(heights)[:2], heights[1] - heights[0], atol=0.11)
    np.testing.assert_allclose(
        heights[3] - heights[0], np.log10(2000) * (heights[1] - heights[0]), atol=0.3
    )


def test_bars_are_standard_errors_in_percent_cut_at_300(gathered):
    """0.01 over the value; a parameter that is not determined, or zero, has no bar."""
    found = gathered.result
    shown = np.isfinite(found.std_error) & (found.theta != 0)
    assert not shown.all()
    svg = error_chart(found, "errors")
    bars = sorted(
        [*rectangles(svg, "estimated"), *rectangles(svg, "measured")], key=lambda bar: bar["x"]
    )
    assert len(bars) == shown.sum()
    percent = np.clip(1 / np.abs(found.theta[shown]), 0.05, 300)
    heights = np.array([bar["height"] for bar in bars])
    np.testing.assert_allclose(
        heights, 120 * np.log(percent / 0.05) / np.log(300 / 0.05), atol=0.06
    )


def test_the_residual_model_is_drawn_in_percent_of_each_joints_torque():
    """Two joints of 10 and 2 N m: what is held by group, and what is left, as bars of one joint each."""
    rms = np.array([[1.0, 0.5, 0.2, 1.2], [0.2, 0.4, 0.0, 0.5]])
    joints = [
        SimpleNamespace(joint="one", torque_rms=10.0, rms=0.3),
        SimpleNamespace(joint="two", torque_rms=2.0, rms=0.1),
    ]
    svg = residual_model_chart(
        SimpleNamespace(model_error=SimpleNamespace(rms=rms), joints=joints), "residual model"
    )
    rects = [
        e for e in ElementTree.fromstring(svg).iter(f"{SVG}rect") if float(e.get("height")) == 7.0
    ]
    wide = np.array([float(e.get("width")) for e in rects]).reshape(2, 4)
    np.testing.assert_allclose(
        wide / wide.max() * 20.0, [[10.0, 5.0, 2.0, 3.0], [10.0, 20.0, 0.0, 5.0]], atol=0.01
    )


def test_names_are_text(motion, robot):
    hostile = replace(robot, joints=tuple(replace(j, name="<b>&\u202e") for j in robot.joints))
    svg = torque_chart(motion, hostile, 0, "<b>")
    assert [e.tag for e in ElementTree.fromstring(svg).iter() if e.tag == f"{SVG}b"] == []
    assert "<U+202E>" in "".join(
        e.text or "" for e in ElementTree.fromstring(svg).iter(f"{SVG}text")
    )


def test_an_axis_has_three_ticks_at_least():
    """From -28 to 27 with room for two labels, 0 alone would tell no scale."""
    assert ticks(-28, 27, 2.5) == [-20, 0, 20]
