"""Pictures of the gap: where it is, joint by joint, and how far it shrank."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynid.gap.formulas import HeldOutFormula
from dynid.gap.localisation import JointGap
from dynid.gap.record import GapEffect
from dynid.gap.refit import HeldOutImprovement
from dynid.reports.figures import ESTIMATED, MEASURED, RESIDUAL
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Least times the noise's power at which the colours end; they go on to the worst that there is.
WORST = 10.0
#: Seconds of held-out motion, and parts of a formula's range, that are drawn.
SHOWN, PARTS = 12.0, 10


def residual_figure(gaps: Sequence[JointGap], joints: Sequence[str], title: str) -> Figure:
    """Draw the mean square of the residual, in units of the noise's, over speed, position, load, time and direction."""
    from matplotlib.figure import Figure as NewFigure

    names = list(dict.fromkeys((r.kind, r.name) for g in gaps for r in g.regions))
    figure = NewFigure(figsize=(0.42 * max(len(names), 4) + 2.0, 0.36 * len(joints) + 2.0), layout="constrained")
    axis = figure.subplots()
    chi = np.full((len(joints), max(len(names), 1)), np.nan)
    for g in gaps:
        for r in g.regions:
            chi[g.joint, names.index((r.kind, r.name))] = r.chi
    ticks = [1.0, 3.0, 10.0, 100.0, 1000.0, 1e4]
    worst = max(WORST, float(np.nanmax(chi, initial=WORST)))
    image = axis.imshow(np.log10(np.clip(chi, 0.5, None)), cmap="YlOrBr", vmin=0.0, vmax=np.log10(worst), aspect="auto")
    for j, k in zip(*np.nonzero(np.isfinite(chi)), strict=True):
        axis.text(
            k,
            j,
            f"{chi[j, k]:.1f}" if chi[j, k] < 100 else f"{chi[j, k]:.0f}",
            ha="center",
            va="center",
            fontsize=7,
            color="white" if chi[j, k] > worst**0.75 else "black",
        )
    axis.set_yticks(range(len(joints)), [label(name) for name in joints], fontsize=8)
    axis.set_xticks(range(len(names)), [f"{kind}: {name}" for kind, name in names], rotation=50, ha="right", fontsize=7)
    ticks = [tick for tick in ticks if tick <= worst]
    bar = figure.colorbar(image, ax=axis, ticks=np.log10(ticks))
    bar.ax.set_yticklabels([f"{tick:g}" for tick in ticks], fontsize=8)
    if title:
        what = "residual power over noise power. 1 is the noise; above 1.25 something is missing"
        figure.suptitle(f"{label(title, TITLE_LENGTH)}: {what}", fontsize=9)
    return figure


def improvement_figure(
    improvement: HeldOutImprovement, joints: Sequence[str], units: Sequence[str], title: str
) -> Figure:
    """Draw the held-out residual of each joint before and after, with the noise floor."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(7.0, 0.42 * len(joints) + 1.2), layout="constrained")
    axis = figure.subplots()
    place = np.arange(len(joints))
    axis.barh(place - 0.19, improvement.before, 0.36, color=RESIDUAL, label="before")
    error = np.abs(improvement.ratio.T * improvement.before - improvement.after)
    error = np.where(np.isfinite(error), error, 0.0)
    axis.barh(
        place + 0.19,
        improvement.after,
        0.36,
        color=ESTIMATED,
        label="after",
        xerr=error,
        error_kw={"lw": 1.0, "ecolor": mpl.rcParams["text.color"]},
    )
    for j, floor in enumerate(improvement.floor):
        axis.plot([floor, floor], [j - 0.42, j + 0.42], color=MEASURED, lw=2.0, label="noise floor" if j == 0 else None)
    axis.set_yticks(place, [f"{label(name)} [{unit}]" for name, unit in zip(joints, units, strict=True)], fontsize=8)
    axis.invert_yaxis()
    axis.set_xlabel("root mean square on held-out rows, with 95 % interval", fontsize=8)
    axis.legend(fontsize=8, frameon=False)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    figure.suptitle(label(title, TITLE_LENGTH), fontsize=10)
    return figure


def formula_figure(formulas: Sequence[GapEffect], proofs: Sequence[HeldOutFormula], title: str) -> Figure:
    """Draw each formula through what is left of held-out rows: over time, and against what it says."""
    import matplotlib as mpl
    from matplotlib.figure import Figure as NewFigure

    figure = NewFigure(figsize=(9.0, 2.6 * len(formulas) + 0.5), layout="constrained")
    for (over_time, against), one, proof in zip(
        figure.subplots(len(formulas), 2, width_ratios=[3, 2], squeeze=False), formulas, proofs, strict=True
    ):
        # Why not the residual without it: there the other parameters have taken up part of it.
        data, shown = proof.left + proof.torque, proof.t < proof.t[0] + SHOWN
        over_time.plot(proof.t[shown], data[shown], ".", ms=3, color=MEASURED, label="what the model leaves for it")
        over_time.plot(proof.t[shown], proof.torque[shown], ".", ms=3, color=ESTIMATED, label="the formula")
        over_time.set_xlabel("time on held-out rows [s]", fontsize=8)
        over_time.set_ylabel(f"{label(one.where)} [{one.unit}]", fontsize=8)
        over_time.set_title(label(one.formula, TITLE_LENGTH), fontsize=9, loc="left")
        over_time.legend(fontsize=7, frameon=False)
        part = np.searchsorted(np.quantile(proof.torque, np.linspace(0, 1, PARTS + 1)[1:-1]), proof.torque)
        groups = [part == k for k in range(PARTS) if np.any(part == k)]
        x, y = (np.array([values[group].mean() for group in groups]) for values in (proof.torque, data))
        spread = np.array([data[group].std() for group in groups])
        against.plot(proof.torque, data, ".", ms=1.5, color=RESIDUAL, alpha=0.3)
        against.errorbar(x, y, spread, fmt="o", ms=4, color=MEASURED, lw=1.0)
        ends = [proof.torque.min(), proof.torque.max()]
        against.plot(ends, ends, color=mpl.rcParams["text.color"], lw=1.0)
        against.set_xlabel(f"the formula [{one.unit}]", fontsize=8)
        against.set_ylabel(f"what the model leaves for it [{one.unit}]", fontsize=8)
        for axis in (over_time, against):
            axis.tick_params(labelsize=7)
            for side in ("top", "right"):
                axis.spines[side].set_visible(False)
    figure.suptitle(label(f"{title}: not in the catalogue, on unseen data", TITLE_LENGTH), fontsize=10)
    return figure
