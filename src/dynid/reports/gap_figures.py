"""Pictures of the gap: where it is, joint by joint, and how far it shrank."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np

from dynid.gap.formulas import HeldOutEffect
from dynid.gap.localisation import JointGap
from dynid.gap.record import GapEffect
from dynid.gap.refit import HeldOutImprovement
from dynid.reports.charts import Floats, binned
from dynid.reports.figures import ESTIMATED, MEASURED, RESIDUAL
from dynid.reports.style import own_style
from dynid.text import TITLE_LENGTH, label

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Least times the noise's power at which the colours end; they go on to the worst that there is.
WORST = 10.0
#: Seconds of held-out motion that are drawn.
SHOWN = 12.0


@own_style()
def residual_figure(gaps: Sequence[JointGap], joints: Sequence[str], title: str) -> Figure:
    """Draw the mean square of the residual, in units of the noise's, over speed, position, load, time and direction."""
    from matplotlib.figure import Figure as NewFigure

    names = list(dict.fromkeys((r.kind, r.name) for g in gaps for r in g.regions))
    figure = NewFigure(
        figsize=(0.42 * max(len(names), 4) + 2.0, 0.36 * len(joints) + 2.0), layout="constrained"
    )
    axis = figure.subplots()
    chi = np.full((len(joints), max(len(names), 1)), np.nan)
    for g in gaps:
        for r in g.regions:
            chi[g.joint, names.index((r.kind, r.name))] = r.chi
    ticks = [1.0, 3.0, 10.0, 100.0, 1000.0, 1e4]
    worst = max(WORST, float(np.nanmax(chi, initial=WORST)))
    image = axis.imshow(
        np.log10(np.clip(chi, 0.5, None)),
        cmap="YlOrBr",
        vmin=0.0,
        vmax=np.log10(worst),
        aspect="auto",
    )
    for j, k in zip(*np.nonzero(np.isfinite(chi)), strict=True):
        axis.text(
            k,
            j,
            f"{chi[j, k]:.1f}" if chi[j, k] < 100 else f"{chi[j, k]:.0f}",
            ha="center",
            va="center",
            fontsize=7,
            color="white" if chi[j, k] > worst**0.75 else "black",
            # Why: it stands inside the axes, and measuring hundreds of them takes longer than the rest of the picture.
            in_layout=False,
        )
    axis.set_yticks(range(len(joints)), [label(name) for name in joints], fontsize=8)
    axis.set_xticks(
        range(len(names)),
        [f"{kind}: {name}" for kind, name in names],
        rotation=50,
        ha="right",
        fontsize=7,
    )
    ticks = [tick for tick in ticks if tick <= worst]
    bar = figure.colorbar(image, ax=axis, ticks=np.log10(ticks))
    bar.ax.set_yticklabels([f"{tick:g}" for tick in ticks], fontsize=8)
    if title:
        what = "residual power over noise power. 1 is the noise; above 1.25 something is missing"
        figure.suptitle(f"{label(title, TITLE_LENGTH)}: {what}", fontsize=9)
    return figure


@own_style()
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
    # Why: of few rows an interval has no upper end.
    ratio = np.where(np.isfinite(improvement.ratio), improvement.ratio, np.nan)
    error = np.nan_to_num(np.abs(ratio.T * improvement.before - improvement.after))
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
        axis.plot(
            [floor, floor],
            [j - 0.42, j + 0.42],
            color=MEASURED,
            lw=2.0,
            label="noise floor" if j == 0 else None,
        )
    axis.set_yticks(
        place,
        [f"{label(name)} [{unit}]" for name, unit in zip(joints, units, strict=True)],
        fontsize=8,
    )
    axis.invert_yaxis()
    axis.set_xlabel("root mean square on held-out rows, with 95 % interval", fontsize=8)
    axis.legend(fontsize=8, frameon=False)
    for side in ("top", "right"):
        axis.spines[side].set_visible(False)
    figure.suptitle(label(title, TITLE_LENGTH), fontsize=10)
    return figure


@own_style()
def effect_figure(one: GapEffect, curve: HeldOutEffect, title: str) -> Figure:
    """Draw an effect on held-out rows: the error over the worst stretch without and with it, and its curve in the data.

    Args:
        one: the effect or formula.
        curve: its torque and what the model leaves for it.
        title: of the figure, before the name of the effect; "" for none.
    """
    from dynid.reports.figures import new_figure

    figure = new_figure(9.0, 3.0)
    over_time, against = figure.subplots(1, 2, width_ratios=[3, 2])
    shown = _worst_stretch(curve.t, curve.residual)
    over_time.plot(
        curve.t[shown], curve.residual[shown], ".", ms=3, color=RESIDUAL, label="error without it"
    )
    over_time.plot(
        curve.t[shown], curve.left[shown], ".", ms=3, color=ESTIMATED, label="error with it"
    )
    over_time.axhline(0, lw=0.6, color=MEASURED)
    over_time.set_xlabel("time, worst stretch of unseen data [s]", fontsize=8)
    over_time.set_ylabel(f"{label(one.joint)} [{one.unit}]", fontsize=8)
    over_time.legend(fontsize=7, frameon=False)
    centre, mean, spread = binned(curve.against, curve.data)
    says = binned(curve.against, curve.torque)[1]
    against.plot(curve.against, curve.data, ".", ms=1.5, color=MEASURED, alpha=0.4)
    against.errorbar(
        centre, mean, spread, fmt="o", ms=3.5, color=RESIDUAL, lw=0.8, label="unseen data"
    )
    low, high = _interval(one)
    against.fill_between(centre, low * says, high * says, color=ESTIMATED, alpha=0.3, lw=0)
    against.plot(centre, says, color=ESTIMATED, lw=1.4, label="the effect, 95 % interval")
    against.set_xlabel(label(curve.follows), fontsize=8)
    against.set_ylabel(f"torque left for it [{one.unit}]", fontsize=8)
    against.legend(fontsize=7, frameon=False)
    for axis in (over_time, against):
        axis.tick_params(labelsize=7)
        for side in ("top", "right"):
            axis.spines[side].set_visible(False)
    if title:
        name = f"{one.formula} (not in the catalogue)" if one.formula else one.effect
        figure.suptitle(label(f"{title}: {name} on {one.where}", TITLE_LENGTH), fontsize=10)
    return figure


def _worst_stretch(t: Floats, error: Floats) -> slice:
    """Return the rows of the ``SHOWN`` seconds with the largest sum of squared errors."""
    power = np.concatenate([[0.0], np.cumsum(error**2)])
    ends = (
        np.searchsorted(t, t + SHOWN)
        if np.all(np.diff(t) > 0)
        else np.minimum(np.arange(len(t)) + 500, len(t))
    )
    start = int(np.argmax(power[ends] - power[: len(t)]))
    return slice(start, int(ends[start]))


def _interval(one: GapEffect) -> tuple[float, float]:
    """Return the ends of the 95 % interval of the largest amplitude, as shares of it."""
    sizes = {
        name: abs(one.values[name]) for name, error in one.std_errors.items() if np.isfinite(error)
    }
    largest = max(sizes, key=lambda name: sizes[name], default="")
    spread = 1.96 * one.std_errors[largest] / sizes[largest] if largest and sizes[largest] else 0.0
    return 1 - spread, 1 + spread
