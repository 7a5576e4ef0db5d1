"""Where model and measurement disagree: which joint, at which speed, position, load, time and direction."""

from __future__ import annotations

import numpy as np
from scipy.ndimage import binary_dilation

from dynid.arrays import Floats, Ints, Mask
from dynid.gap.regression import Regression
from dynid.judgement.gap import JointGap

#: Share of the noise's power that may be left: a joint with more is above its noise floor. Clean joints have 0.9 to 1.1
#: of the power that repeats tell.
NEGLIGIBLE = 0.10
#: A region stands out when what it has above the noise is so many times that of its joint's next one.
STANDS_OUT = 1.6
#: Fewest rows of a region that is judged: its mean square is then known to a fifth.
FEWEST = 60
#: Time about a reversal that counts as the reversal [s]: three quarters of a period of the cut-off of 10 Hz.
REVERSAL = 0.075

#: Regions of each kind, in the order in which they are drawn, and how one is said.
KINDS = {
    "speed": (("slow", "medium", "fast"), "when {}"),
    "position": (("lower end", "middle", "upper end"), "at the {} of its travel"),
    "load": (("low", "medium", "high"), "at {} load"),
    "time": (("early", "middle", "late"), "{} in the recording"),
    "direction": (("forward", "backward"), "when moving {}"),
    "reversal": (("at reversals", "between reversals"), "{}"),
}


def localise_residual(regression: Regression) -> list[JointGap]:
    """Return the disagreement of every joint."""
    noise, chi, energy, root = regression.noise, [], [], regression.root
    for j, (e, gram) in enumerate(zip(regression.e, regression.gram, strict=True)):
        # Mean square, freedom taken off.
        freedom = len(e) - float(np.sum((gram[:-1, :-1] @ root) * root))
        chi.append(float(noise.count[j] * (e @ e) / freedom) if freedom > 20 else 1.0)
        energy.append(max(0.0, chi[j] - 1.0) * len(e) * noise.sigma[j] ** 2)
    shares = np.array(energy) / (sum(energy) or 1.0)
    gaps = []
    for j, each in enumerate(chi):
        regions = _regions(regression, j)
        text = _words(regions) if each > 1 + NEGLIGIBLE else "at the noise level"
        gaps.append(JointGap(j, each, float(shares[j]), tuple(regions), text))
    return gaps


def _regions(regression: Regression, joint: int) -> list[tuple[str, str, float]]:
    """Cut one joint's whitened residual by what the arm did."""
    rows, noise = regression.rows, regression.noise
    use, e = noise.counting(rows, joint), regression.e[joint] * noise.count[joint] ** 0.5
    if len(e) < 3 * FEWEST:
        return []
    q, qd, tau = (x[use, joint] for x in (rows.q, rows.qd, rows.tau))
    near = [near_reversal(rows.qd[part, joint], rows.rate) for part in rows.parts]

    def third(signal: Floats) -> Ints:
        return np.searchsorted(np.quantile(signal, [1 / 3, 2 / 3]), signal)

    number = {
        "speed": third(np.abs(qd)),
        "position": third(q),
        "load": third(np.abs(tau)),
        "time": third((rows.t + 1e6 * rows.part)[use]),
        "direction": 1 * (qd <= 0),
        "reversal": 1 * ~np.concatenate(near)[use],
    }
    regions = []
    for kind, (names, _) in KINDS.items():
        for k, name in enumerate(names):
            power = e[number[kind] == k] ** 2
            if len(power) >= FEWEST:
                regions.append((kind, name, float(np.mean(power))))
    return regions


def near_reversal(qd: Floats, rate: float) -> Mask:
    """Return which rows are at a reversal of a joint, (M,)."""
    turns = np.diff(np.sign(qd), prepend=np.sign(qd[:1])) != 0
    return binary_dilation(turns, iterations=max(1, round(REVERSAL * rate)))


def _words(regions: list[tuple[str, str, float]]) -> str:
    """Return the strongest contrasts in words."""
    strong = []
    for kind, (_, phrase) in KINDS.items():
        of = sorted(((chi, name) for k, name, chi in regions if k == kind), reverse=True)
        if len(of) > 1 and of[0][0] - 1 > STANDS_OUT * max(of[1][0] - 1, 0.05):
            strong.append((of[0][0] / of[1][0], phrase.format(of[0][1])))
    if not strong:
        return "equally in all parts of its motion"
    return ", ".join(text for _, text in sorted(strong, reverse=True)[:2])
