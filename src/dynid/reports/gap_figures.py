"""Figures of the gap search: the residual by joint, and the error before and after."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynid.judgement.gap import GapEffect, HeldOutEffect, HeldOutImprovement, JointGap
from dynid.reports.figures import (
    ESTIMATED,
    MEASURED,
    RESIDUAL,
    TEXT,
    bar_figure,
    curves_over_time,
    new_figure,
    styled,
)
from dynid.reports.section_figures import binned
from dynid.sim.comparison import SimulatorGap
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Least times the noise's power at which the colours end; they go on to the worst that there is.
WORST = 10.0


@styled
def residual_figure(gaps: Sequence[JointGap], joints: Sequence[str], title: str) -> Figure:
    """Draw the mean square of the residual, in units of the noise's, over speed, position, load, time and direction."""
    names = list(dict.fromkeys((kind, name) for g in gaps for kind, name, _ in g.regions))
    chi = np.full((len(joints), max(len(names), 1)), np.nan)
    for g in gaps:
        for kind, name, power in g.regions:
            chi[g.joint, names.index((kind, name))] = power
    figure, (axis,) = bar_figure(joints, 0.25, 1.8)
    worst = max(WORST, float(np.nanmax(chi, initial=WORST)))
    shades = np.log10(np.clip(chi, 0.5, None))
    axis.grid(visible=False)
    axis.imshow(shades, cmap="YlOrBr", vmin=0.0, vmax=np.log10(worst), aspect="auto")
    for j, k in zip(*np.nonzero(np.isfinite(chi)), strict=True):
        axis.text(
            k,
            j,
            f"{chi[j, k]:.{1 * (chi[j, k] < 100)}f}",
            ha="center",
            va="center",
            fontsize=TEXT - 3,
            color="white" if chi[j, k] > worst**0.75 else "black",
            # Why: it stands inside the axes; measuring hundreds of them takes longer than the rest.
            in_layout=False,
        )
    words = [f"{kind}: {name}" for kind, name in names]
    axis.set_xticks(range(len(names)), words, rotation=50, ha="right")
    if title:
        what = "residual power over noise power. 1 is the noise; above 1.25 an effect is missing"
        figure.suptitle(f"{label(title, TITLE_LENGTH)}: {what}", wrap=True)
    return figure


@styled
def improvement_figure(
    improvement: HeldOutImprovement, joints: Sequence[str], units: Sequence[str], title: str
) -> Figure:
    """Draw the held-out residual of each joint before and after, with the noise floor."""
    rows = [f"{name} [{unit}]" for name, unit in zip(joints, units, strict=True)]
    figure, (axis,) = bar_figure(rows, 0.36, 1.1)
    place = np.arange(len(joints))
    axis.barh(place - 0.19, improvement.before, 0.36, color=RESIDUAL, label="before")
    # Why: of few rows an interval has no upper end.
    ratio = np.where(np.isfinite(improvement.ratio), improvement.ratio, np.nan)
    error = np.nan_to_num(np.abs(ratio.T * improvement.before - improvement.after))
    ink = axis.xaxis.label.get_color()
    axis.barh(
        place + 0.19,
        improvement.after,
        0.36,
        color=ESTIMATED,
        label="after",
        xerr=error,
        ecolor=ink,
    )
    axis.vlines(
        improvement.floor, place - 0.42, place + 0.42, color=MEASURED, lw=2.0, label="noise level"
    )
    axis.set_xlabel("root mean square on held-out rows, with 95 % interval")
    axis.legend()
    figure.suptitle(label(title, TITLE_LENGTH))
    return figure


@styled
def effect_figure(one: GapEffect, curve: HeldOutEffect, title: str) -> Figure:
    """Draw an effect on held-out rows: its torque over what it follows, and what the model leaves for it.

    Args:
        one: the effect.
        curve: its torque and what the model leaves for it.
        title: of the figure, before the name of the effect; "" for none.
    """
    figure = new_figure(2.8)
    axis = figure.subplots()
    centre, mean, spread = binned(curve.against, curve.data)
    effect = binned(curve.against, curve.torque)[1]
    axis.plot(curve.against, curve.data, ".", ms=1.5, color=MEASURED, alpha=0.4, rasterized=True)
    axis.errorbar(
        centre, mean, spread, fmt="o", ms=3.5, color=RESIDUAL, lw=0.8, label="held-out data"
    )
    axis.plot(centre, effect, color=ESTIMATED, lw=1.4, label="the effect")
    axis.set(xlabel=label(curve.follows), ylabel=f"{label(one.joint)} [{one.unit}]")
    axis.legend()
    if title:
        words = label(f"{title}: {one.effect} on {one.where}", TITLE_LENGTH)
        figure.suptitle(words, wrap=True)
    return figure


@styled
def simulator_figure(gap: SimulatorGap) -> Figure:
    """Draw the position error of each model in a simulator, one panel per joint."""
    titles = [
        f"{label(joint.name)} [{'mrad' if joint.revolute else 'mm'}]" for joint in gap.robot.joints
    ]
    runs = list(zip(gap.models, gap.simulated, (RESIDUAL, ESTIMATED, MEASURED), strict=False))
    panels = [
        {label(name): (1000 * (q - gap.q)[:, j], color, 0.9) for name, q, color in runs}
        for j in range(gap.robot.n)
    ]
    return curves_over_time(
        titles, gap.t, panels, f"simulated less measured position, {gap.engine}"
    )
