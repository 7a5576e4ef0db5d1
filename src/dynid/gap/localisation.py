"""Where model and measurement disagree: which joint, at which speed, position, load, time and direction."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.interface import Floats

#: Share of the noise's power that may be left: a joint with more is above its noise floor. Clean joints have 0.9 to 1.1
#: of the power that repeats tell.
NEGLIGIBLE = 0.10
#: A region stands out when what it has above the noise is so many times that of its joint's next one.
STANDS_OUT = 1.6
#: Fewest rows of a region that is judged: its mean square is then known to a fifth.
FEWEST = 60
#: Time after a reversal that counts as the reversal [s]: one and a half periods of the cut-off of 10 Hz.
REVERSAL = 0.15

#: How a region of each kind is told.
PHRASES = {
    "speed": "when {}",
    "position": "at the {} of its travel",
    "load": "at {} load",
    "time": "{} in the recording",
    "direction": "when moving {}",
    "reversal": "{}",
}


@dataclass(frozen=True)
class ResidualRegion:
    """The residual in one part of one joint's rows.

    Attributes:
        kind: what it is cut by: speed, position, load, time, direction, reversal.
        name: which part.
        chi: mean square of the whitened residual there.
        rows: number of rows.
    """

    kind: str
    name: str
    chi: float
    rows: int


@dataclass(frozen=True)
class JointGap:
    """The disagreement of one joint.

    Attributes:
        joint: index.
        chi: mean square of the whitened residual; 1 at the noise floor.
        share: of what all joints have above their floors, 0 to 1.
        regions: its parts.
        text: where it is, in words.
    """

    joint: int
    chi: float
    share: float
    regions: tuple[ResidualRegion, ...]
    text: str


def localise_residual(regression: WhitenedRegression) -> list[JointGap]:
    """Return the disagreement of every joint."""
    chi, sigma = regression.reduced_chi_square(), regression.noise.sigma
    energy = np.array(
        [
            max(0.0, c - 1) * len(e) * s**2
            for c, e, s in zip(chi, regression.fit.e, sigma, strict=True)
        ]
    )
    total = energy.sum()
    found = []
    for j in range(len(chi)):
        regions = regions_of(regression, j)
        text = _words(regions) if chi[j] > 1 + NEGLIGIBLE else "at the noise floor"
        found.append(
            JointGap(
                j,
                float(chi[j]),
                float(energy[j] / total) if total > 0 else 0.0,
                tuple(regions),
                text,
            )
        )
    return found


def regions_of(regression: WhitenedRegression, joint: int) -> list[ResidualRegion]:
    """Cut one joint's whitened residual by what the arm did."""
    rows, e = (
        regression.joints[joint],
        regression.fit.e[joint] * regression.noise.count[joint] ** 0.5,
    )
    if len(e) < 3 * FEWEST:
        return []
    signals = {
        key: np.concatenate([getattr(s, key)[:, joint] for s in regression.segments])[rows.index]
        for key in ("q", "qd", "tau")
    }
    t = np.concatenate([s.t + 1e6 * s.number for s in regression.segments])[rows.index]
    reversing = np.concatenate(
        [near_reversal(s.qd[:, joint], s.rate) for s in regression.segments]
    )[rows.index]
    speed = np.abs(signals["qd"])
    parts: list[tuple[str, str, NDArray[np.bool_]]] = []
    for kind, signal, names in (
        ("speed", speed, ("slow", "medium", "fast")),
        ("position", signals["q"], ("lower end", "middle", "upper end")),
        ("load", np.abs(signals["tau"]), ("low", "medium", "high")),
        ("time", t, ("early", "middle", "late")),
    ):
        edges = np.quantile(signal, [1 / 3, 2 / 3])
        third = np.searchsorted(edges, signal)
        parts += [(kind, name, third == k) for k, name in enumerate(names)]
    parts += [
        ("direction", "forward", signals["qd"] > 0),
        ("direction", "backward", signals["qd"] <= 0),
    ]
    parts += [
        ("reversal", "at reversals", reversing),
        ("reversal", "between reversals", ~reversing),
    ]
    return [
        ResidualRegion(kind, name, float(np.mean(e[mask] ** 2)), int(mask.sum()))
        for kind, name, mask in parts
        if mask.sum() >= FEWEST
    ]


def near_reversal(qd: Floats, rate: float) -> NDArray[np.bool_]:
    """Return which rows are at a reversal of a joint, (M,)."""
    near = np.zeros(len(qd), dtype=bool)
    width = max(1, round(REVERSAL * rate))
    for k in np.flatnonzero(np.diff(np.sign(qd)) != 0):
        near[max(0, k - width // 2) : k + width] = True
    return near


def _words(regions: list[ResidualRegion]) -> str:
    """Return the strongest contrasts in words."""
    strong = []
    for kind in dict.fromkeys(r.kind for r in regions):
        of = [r for r in regions if r.kind == kind]
        top = max(of, key=lambda r: r.chi)
        rest = [r.chi for r in of if r is not top]
        if rest and top.chi - 1 > STANDS_OUT * max(max(rest) - 1, 0.05):
            strong.append((top.chi / max(rest), _phrase(top)))
    if not strong:
        return "equally in all parts of its motion"
    return ", ".join(text for _, text in sorted(strong, reverse=True)[:2])


def _phrase(region: ResidualRegion) -> str:
    return PHRASES[region.kind].format(region.name)
