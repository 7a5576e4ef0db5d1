"""Charts of a report: torques, residuals, excitation, errors."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.estimation.covariance import NEGLIGIBLE
from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.residual_model import GROUP_NAMES
from dynid.estimation.result import Identification
from dynid.reports.chart import (
    LINE,
    Curve,
    Panel,
    broken,
    chart,
    framed,
    number,
    reach,
    rectangle,
    stroke,
    text,
    ticks,
)
from dynid.robot import Joint, Robot

Floats = NDArray[np.float64]

#: Share of the largest singular value below which noise is amplified a thousandfold.
WEAK_DIRECTION = 1e-3
#: Errors are cut at these ends of their axis [%].
LEAST_ERROR, MOST_ERROR = 0.05, 300.0
#: Colours of the groups of the residual model, and of what it leaves.
GROUP_COLORS = ("estimated", "#009e73", "#cc79a7", "residual")
#: Bins of the residual's mean and spread.
BINS = 24
#: What the residual is drawn over, with the units of turning and sliding joints.
AGAINST = {"velocity": "rad/s, m/s", "position": "rad, m", "load": "N m, N", "time": "s"}


def torque_chart(motion: EstimatedMotion, robot: Robot, joint: int, label: str) -> str:
    """Draw measured, estimated and residual torque of one joint, counted from 0, small enough for a telephone."""
    measured, estimated = motion.tau_measured[:, joint], motion.tau_estimated[:, joint]
    shown = {
        "measured": (measured, 2.0),
        "estimated": (estimated, 0.9),
        "residual": (measured - estimated, 0.7),
    }
    curves = [
        Curve(*broken(motion.t, values), name, width) for name, (values, width) in shown.items()
    ]
    ends = reach([values for values, _ in shown.values()])
    panel = Panel(
        robot.joints[joint].name, tuple(curves), *ends, unit=robot.joints[joint].torque_unit
    )
    return chart([panel], "time [s]", label, width=330, height=85)


def residual_chart(motion: EstimatedMotion, robot: Robot, against: str, label: str) -> str:
    """Draw mean and spread of the residual torque over one of ``AGAINST``, one panel per joint, one below the other."""
    panels = []
    for j, joint in enumerate(robot.joints):
        centre, mean, spread, size = residual_averages(motion, j, against)
        curve, band = Curve(centre, mean, "estimated", 1.2), (centre, mean - spread, mean + spread)
        ends = centre[[0, -1]] if len(centre) else centre
        zero = Curve(ends, np.zeros(len(ends)), "measured", 0.8)
        panels.append(
            Panel(joint.name, (zero, curve), -3.2 * size, 3.2 * size, band, joint.torque_unit)
        )
    return chart(panels, f"{against} [{AGAINST[against]}]", label, width=165, height=44)


def residual_averages(
    motion: EstimatedMotion, joint: int, against: str
) -> tuple[Floats, Floats, Floats, float]:
    """Return centres of bins over one of ``AGAINST``, mean and spread of the residual in each, and the whole spread."""
    usable = motion.usable[:, joint]
    residual = (motion.tau_measured[:, joint] - motion.tau_estimated[:, joint])[usable]
    values = {
        "velocity": motion.qd_estimated[:, joint],
        "position": motion.q_estimated[:, joint],
        "load": motion.tau_estimated[:, joint],
        "time": motion.t,
    }[against][usable]
    return *binned(values, residual), float(np.std(residual)) if usable.any() else 1.0


def binned(x: Floats, y: Floats) -> tuple[Floats, Floats, Floats]:
    """Return centres, means and spreads of y, (M,), in bins of equal count over x, (M,); each (BINS,)."""
    order = np.argsort(x)
    parts = [part for part in np.array_split(order, BINS) if len(part) > 1]
    rows = [(float(x[part].mean()), float(y[part].mean()), float(y[part].std())) for part in parts]
    centre, mean, spread = np.array(rows).reshape(-1, 3).T
    return centre, mean, spread


# ---------------------------------------------------------------- logarithmic axes
def spectrum_chart(singular_values: Floats, label: str) -> str:
    """Draw the singular values of a stack with normalised columns, (p,), over the largest."""
    share = np.maximum(singular_values / singular_values[0], 1e-12)
    low = 10.0 ** np.floor(np.log10(min(share.min(), WEAK_DIRECTION)))
    room, step = Decades(low, 1.0, 130.0, 46.0, 620.0), (620.0 - 60.0) / max(1, len(share) - 1)
    dots = [(52.0 + step * k, room.height_of(float(value))) for k, value in enumerate(share)]
    parts = [*room.axes("singular value / largest"), room.line_at(WEAK_DIRECTION)]
    parts.append(stroke("M" + "L".join(f"{x:.1f} {y:.1f}" for x, y in dots), "estimated", 0.8))
    parts += [
        f'<circle cx="{x:.1f}" cy="{y:.1f}" r="1.8" fill="var(--estimated)"/>' for x, y in dots
    ]
    parts += [
        text(52.0 + step * k, 152.0, str(k + 1), "middle")
        for k in range(0, len(share), max(1, len(share) // 10))
    ]
    parts.append(text(330.0, 166.0, "direction in the space of base parameters", "middle"))
    return framed(parts, 620.0, 172.0, label)


def error_chart(found: Identification, label: str) -> str:
    """Draw the standard error of each base parameter in percent of its value; nothing where that is not determined."""
    finite = np.isfinite(found.std_error) & (np.abs(found.theta) > 0)
    share = np.clip(
        100 * found.std_error[finite] / np.abs(found.theta[finite]), LEAST_ERROR, MOST_ERROR
    )
    room, step = (
        Decades(LEAST_ERROR, MOST_ERROR, 120.0, 40.0, 620.0),
        (620.0 - 48.0) / max(1, len(found.theta)),
    )
    parts, places = room.axes("error / value [%]"), 44.0 + step * np.arange(len(found.theta))
    for k, percent in zip(np.flatnonzero(finite).tolist(), share.tolist(), strict=True):
        color, top = (
            "measured" if found.knowledge[k] == NEGLIGIBLE else "estimated",
            room.height_of(percent),
        )
        parts.append(rectangle(places[k], top, 0.8 * step, room.bottom - top, color))
    parts.append(room.line_at(10.0))
    size = min(7.0, step)
    names = [
        text(places[k] + 0.4 * step + 0.35 * size, room.bottom + 4, name, "end", True)
        for k, name in enumerate(found.names)
    ]
    longest = max((len(name) for name in found.names), default=0)
    parts.append(f'<g font-size="{size:.1f}">{"".join(names)}</g>')
    return framed(parts, 620.0, room.bottom + 10 + 0.6 * size * min(longest, 24), label)


@dataclass(frozen=True)
class Decades:
    """A logarithmic axis of y.

    Attributes:
        low: lower end.
        high: upper end.
        tall: height of the axes [px].
        left: where they begin [px].
        right: where they end [px].
    """

    low: float
    high: float
    tall: float
    left: float
    right: float

    @property
    def bottom(self) -> float:
        """Height of the axis of x [px]."""
        return self.tall + 0.8 * LINE

    def height_of(self, value: float) -> float:
        """Return where a value is [px]."""
        return float(
            self.bottom - self.tall * np.log(value / self.low) / np.log(self.high / self.low)
        )

    def axes(self, title: str) -> list[str]:
        """Return grid, axes, numbers and title."""
        first, last = (
            int(f(np.log10(end))) for f, end in ((np.ceil, self.low), (np.floor, self.high))
        )
        every = max(1, (last - first) // 5)
        marks = [(self.height_of(10.0**k), number(10.0**k)) for k in range(first, last + 1, every)]
        wide = self.right - 8.0 - self.left
        parts = [stroke("".join(f"M{self.left:g} {y:.1f}h{wide:.1f}" for y, _ in marks))]
        parts += [text(self.left - 3, y + 3, words, "end") for y, words in marks]
        parts.append(
            stroke(
                f"M{self.left:g} {self.bottom - self.tall:.1f}V{self.bottom:.1f}h{wide:.1f}",
                "",
                0.8,
            )
        )
        return [*parts, text(9.0, self.bottom - 0.5 * self.tall, title, "middle", True)]

    def line_at(self, value: float) -> str:
        """Return a dashed line at a value."""
        return stroke(
            f"M{self.left:g} {self.height_of(value):.1f}H{self.right - 8.0:.1f}",
            "residual",
            1.0,
            "4 3",
        )


# ---------------------------------------------------------------- ranges
def coverage_chart(motion: EstimatedMotion, robot: Robot, label: str) -> str:
    """Draw the range of positions and speeds of each joint beside its limits."""
    left, row, wide = 8.0 + 5.2 * min(24, max(len(name) for name in robot.joint_names)), 20.0, 230.0
    parts = [
        text(left - 5, LINE + row * (j + 0.5) + 3, name, "end")
        for j, name in enumerate(robot.joint_names)
    ]
    bottom = LINE + row * robot.n
    for k, (what, values) in enumerate(
        (("position", motion.q_estimated), ("velocity", motion.qd_estimated))
    ):
        done = np.column_stack([values.min(axis=0), values.max(axis=0)])
        limits = [limit_of(joint, what) for joint in robot.joints]
        ends = np.array([*done.ravel(), *(end for limit in limits if limit for end in limit)])
        first, last = float(ends.min()), float(ends.max())
        start, scale = left + k * (wide + 16.0), wide / max(last - first, 1e-12)
        marks = [
            (start + (value - first) * scale, number(value)) for value in ticks(first, last, 4)
        ]
        parts.append(stroke("".join(f"M{x:.1f} {LINE:g}V{bottom:.1f}" for x, _ in marks)))
        for j, limit in enumerate(limits):
            for ends_of, high, color, opacity in (
                (limit, 0.7, "measured", 0.35),
                (done[j], 0.35, "estimated", 1.0),
            ):
                if ends_of is not None:
                    low, top = float(ends_of[0]), LINE + row * (j + 0.5 - 0.5 * high)
                    size = (float(ends_of[1]) - low) * scale
                    parts.append(
                        rectangle(
                            start + (low - first) * scale, top, size, row * high, color, opacity
                        )
                    )
        parts += [text(x, bottom + 0.85 * LINE, words, "middle") for x, words in marks]
        unit = f"[rad{'/s' if what == 'velocity' else ''}; m for sliding joints]"
        parts.append(text(start + 0.5 * wide, bottom + 2.0 * LINE, f"{what} {unit}", "middle"))
        parts.append(stroke(f"M{start:.1f} {LINE:g}V{bottom:.1f}h{wide:g}", "", 0.8))
    return framed(parts, left + 2 * wide + 24.0, bottom + 2.4 * LINE, label)


def residual_model_chart(found: Identification, label: str) -> str:
    """Draw the rms torque that the residual model holds by group, and what it leaves, bars for each joint [%].

    Args:
        found: a result with a residual model.
        label: what it shows, for those who cannot see it.
    """
    error = found.model_error
    assert error is not None, "only results with a residual model have this chart"
    torque = np.array([max(joint.torque_rms, 1e-12) for joint in found.joints])
    left = 100 * np.array([joint.rms for joint in found.joints]) / torque
    shares = np.column_stack([100 * error.rms[:, :-1] / torque[:, None], left])
    names = [*(f"held: {name}" for name in GROUP_NAMES), "left"]
    start, row, each = (
        8.0 + 5.2 * min(24, max(len(joint.joint) for joint in found.joints)),
        34.0,
        7.0,
    )
    top, wide = 2.0 * LINE, 612.0 - start
    scale, bottom = wide / max(float(shares.max()), 1e-9), top + row * len(shares)
    marks = [(start + value * scale, number(value)) for value in ticks(0.0, float(shares.max()), 6)]
    parts = [stroke("".join(f"M{x:.1f} {top:g}V{bottom:.1f}" for x, _ in marks))]
    for j, (joint, values) in enumerate(zip(found.joints, shares.tolist(), strict=True)):
        parts.append(text(start - 5, top + row * (j + 0.5) + 3, joint.joint, "end"))
        for k, (value, color) in enumerate(zip(values, GROUP_COLORS, strict=True)):
            parts.append(
                rectangle(start, top + row * j + 3.0 + each * k, value * scale, each, color)
            )
    for k, (name, color) in enumerate(zip(names, GROUP_COLORS, strict=True)):
        parts += [
            rectangle(start + 140.0 * k, 4.0, 8.0, 8.0, color),
            text(start + 12.0 + 140.0 * k, 11.5, name, "start"),
        ]
    parts += [text(x, bottom + 0.85 * LINE, words, "middle") for x, words in marks]
    parts.append(
        text(
            start + 0.5 * wide, bottom + 2.0 * LINE, "rms, percent of the joint's torque", "middle"
        )
    )
    parts.append(stroke(f"M{start:.1f} {top:g}V{bottom:.1f}h{wide:.1f}", "", 0.8))
    return framed(parts, 620.0, bottom + 2.4 * LINE, label)


def limit_of(joint: Joint, what: str) -> tuple[float, float] | None:
    """Return the ends of what a joint may do, ``"position"`` or ``"velocity"``; None where there are none."""
    speed = joint.limits.velocity
    return joint.limits.position if what == "position" else (-speed, speed) if speed else None
