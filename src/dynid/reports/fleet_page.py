"""fleet.html: which arms have changed, in one file that needs no network."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from dynid.text import chance, html

if TYPE_CHECKING:
    from dynid.estimation.fleet import Change, FleetFindings

#: Changes that are drawn, and rows of the tables; all of them are in fleet.csv.
DRAWN, ROWS = 40, 200
#: Size of a drawing [px].
WIDTH, HEIGHT, EDGE = 360.0, 90.0, 8.0


@dataclass(frozen=True)
class _Kind:
    robot: str
    arms: int
    changed: list[dict[str, Any]]
    odd: list[dict[str, str]]
    usual: list[dict[str, str]]
    more: int


def fleet_page(
    verdict: str,
    types: Sequence[tuple[str, FleetFindings, Mapping[float, str], Mapping[str, str]]],
    runs: int,
    unread: Sequence[tuple[str, str]],
) -> str:
    """Return the page; every text is escaped, drawings are dynid's own.

    Args:
        verdict: the sentence on top.
        types: robot, what was found, the words for days, and units of the parameters, for each type of arm.
        runs: number of results.
        unread: results that could not be read, and why.
    """
    from dynid.reports.page import templates

    kinds = [_kind(*each) for each in types]
    return (
        templates()
        .get_template("fleet.html")
        .render(verdict=verdict, kinds=kinds, runs=runs, unread=list(unread)[:ROWS])
    )


def _kind(
    robot: str, found: FleetFindings, words: Mapping[float, str], units: Mapping[str, str]
) -> _Kind:
    changed = []
    for number, c in enumerate(found.changes[:ROWS]):
        unit = units.get(c.parameter, "")
        changed.append(
            {
                "arm": c.arm,
                "parameter": c.parameter,
                "since": words.get(c.since, f"{c.since:g}"),
                "before": f"{c.before:.4g}",
                "after": f"{c.after:.4g} {unit}".strip(),
                "apart": f"{c.after - c.before:+.3g} ± {1.96 * c.std_error:.2g}",
                "p": chance(c.p_value),
                "drawing": drawing(found, c, unit) if number < DRAWN else "",
            }
        )
    odd = [
        {
            "arm": o.arm,
            "parameter": o.parameter,
            "value": f"{o.value:.4g}",
            "usual": f"{o.usual:.4g} {units.get(o.parameter, '')}".strip(),
            "apart": f"{abs(o.value - o.usual) / o.spread:.1f}",
            "than": o.other or "the fleet",
            "p": chance(o.p_value),
        }
        for o in found.outliers[:ROWS]
    ]
    usual = [
        {
            "parameter": w.parameter,
            "level": f"{w.level:.4g} {units.get(w.parameter, '')}".strip(),
            "error": f"{w.std_error:.2g}",
            "drift": f"{w.between_runs:.2g}",
            "memory": "none" if w.memory < 0.1 else f"{w.memory:g} days",
            "common": f"{w.common:.2g}",
        }
        for w in found.usual
    ]
    return _Kind(
        robot, len(found.history.arms), changed, odd, usual, max(0, len(found.changes) - ROWS)
    )


def drawing(found: FleetFindings, change: Change, unit: str) -> str:
    """Return the runs of one parameter of one arm with two standard errors, and both levels, as SVG."""
    history = found.history
    a, k = history.arms.index(change.arm), history.names.index(change.parameter)
    t, y, s = (
        np.asarray(x, dtype=float)
        for x in (history.t[a], history.value[a, :, k], history.std_error[a, :, k])
    )
    good = np.isfinite(t) & np.isfinite(y) & np.isfinite(s)
    t, y, s = t[good], y[good], s[good]
    low, high = (
        min(float((y - 2 * s).min()), change.before, change.after),
        max(float((y + 2 * s).max()), change.after),
    )
    wide, tall = max(float(t[-1] - t[0]), 1e-9), max(high - low, 1e-300)

    def place(time: float, value: float) -> tuple[float, float]:
        x = EDGE + (WIDTH - 2 * EDGE) * (time - t[0]) / wide
        return x, HEIGHT - EDGE - (HEIGHT - 2 * EDGE) * (value - low) / tall

    parts = []
    for time, value, error in zip(t.tolist(), y.tolist(), s.tolist(), strict=True):
        x, top = place(time, value + 2 * error)
        _, middle = place(time, value)
        _, bottom = place(time, value - 2 * error)
        parts.append(f'<path d="M{x:.1f} {top:.1f}V{bottom:.1f}" stroke="var(--measured)"/>')
        parts.append(f'<circle cx="{x:.1f}" cy="{middle:.1f}" r="2" fill="var(--ink)"/>')
    for level, first, last in (
        (change.before, t[0], change.since),
        (change.after, change.since, t[-1]),
    ):
        (x1, y1), (x2, _) = place(float(first), level), place(float(last), level)
        parts.append(
            f'<path d="M{x1:.1f} {y1:.1f}H{x2:.1f}" stroke="var(--residual)" stroke-width="2"/>'
        )
    what = html(
        f"{change.parameter} of {change.arm}: {change.before:.4g} before, {change.after:.4g} {unit} after"
    )
    return (
        f'<svg viewBox="0 0 {WIDTH:g} {HEIGHT:g}" style="width:100%;min-width:14rem;height:auto" role="img" '
        f'aria-label="{what}">{"".join(parts)}</svg>'
    )
