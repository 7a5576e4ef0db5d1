"""The scene of one search: what is searched, what is held out, the noise, and the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.estimation.effect_columns import fitted, scale_with_model, settled, with_effects
from dynid.estimation.result import Identification
from dynid.estimation.stack import Source
from dynid.gap.matched_motion import against
from dynid.gap.noise import ALIKE, Noise, Pair, find_repeats, noise_of, with_misfit
from dynid.gap.segments import Mask, Stretch, cut, stretches_of, with_reference
from dynid.gap.whitened_regression import Board, build_board
from dynid.model.effects.interface import Floats, sign_of
from dynid.model.reference import model_torques
from dynid.model.store import BaseModel

#: Share of each log that is held out where there are fewer than three motions.
HELD_OUT = 0.2
#: The same when a model is kept: little is fitted then, and slow disturbances make short parts no proof.
HELD_OUT_KEPT = 0.4
#: Rows between training and held-out part that belong to neither [s].
BETWEEN = 1.0
#: Shapes of a reversal below about 1 cm/s are not judged: two more widths of the Coulomb sign join the baseline, this
#: narrow one [rad/s] and one so many times wider than the model's, at least ``WIDE``.
NARROW, WIDER, WIDE = 0.0025, 3.0, 8e-3
#: Directions of an earlier identification's covariance below this share of the largest are those that its logs left
#: open: nothing is known of them, and nothing holds them.
OPEN = 1e-12
#: Errors of an earlier identification are taken this much larger, for what its own model lacked.
TRUST = 1.5


@dataclass(frozen=True)
class Known:
    """A model that is kept: what an earlier identification found.

    Attributes:
        theta: base parameters that the data gave, without a prior, (p,).
        covariance: of them, (p, p); no spread along directions that the data left open.
        left: rms of what the model left of the torques when it was identified, of held-out ones if that is more,
            (n,) [N m].
    """

    theta: Floats
    covariance: Floats
    left: Floats


def kept(found: Identification) -> Known:
    """Return what an identification found as a model that is kept."""
    # Why the larger one: on other motion a model leaves more than on what it was fitted to, and that is no change.
    left = [max(joint.rms, joint.heldout_rms or 0.0) for joint in found.joints]
    return Known(found.plain, found.covariance, np.array(left))


@dataclass(frozen=True)
class Setting:
    """One search.

    Attributes:
        base: model and base parameters.
        known: the kept model; None when the baseline is refitted.
        stretches: all rows.
        train: rows that are searched, one mask a stretch.
        held: rows that prove, one mask a stretch.
        held_text: what is held out, for people.
        pairs: repeats.
        noise: the noise floor.
        theta: base parameters that effects are scaled with, (p,).
        left: what a kept model left unexplained when it was identified, of what is judged, (n,) [N m]; None where it
            cancels, and when the baseline is refitted.
        matched: how many rows of earlier logs each row is compared with, because the motion is the same; 0 when it is
            compared with the model alone.
    """

    base: BaseModel
    known: Known | None
    stretches: list[Stretch]
    train: list[Mask]
    held: list[Mask]
    held_text: str
    pairs: list[Pair]
    noise: Noise
    theta: Floats
    left: Floats | None = None
    matched: float = 0.0

    def board(self, theta: Floats | None = None, *, nuisance: bool = True, held: bool = False) -> Board:
        """Return the whitened training rows, effects scaled with given base parameters.

        Args:
            theta: base parameters, those of the setting when None.
            nuisance: whether shapes of reversals are left unjudged.
            held: the held-out rows instead.
        """
        reference = model_torques(self.base.model, self.base.reduction, self.theta if theta is None else theta)
        stretches = cut(with_reference(self.stretches, reference), self.held if held else self.train)
        columns = [nuisance_columns(s, judged=not nuisance) for s in stretches]
        return build_board(stretches, self.noise, columns, prior_rows(self.known))


def nuisance_columns(stretch: Stretch, *, judged: bool = False) -> list[Floats]:
    """Return the columns that are not judged, (2, M) a joint; none, (0, M), when all is judged."""
    motion = stretch.motion
    if judged:
        return [np.zeros((0, len(stretch)))] * motion.n
    found = []
    for j in range(motion.n):
        shape = motion.robot.coulomb_shape
        qd, sign = motion.qd[:, j], sign_of(motion, j)
        wide = max(WIDE, WIDER * shape.velocity[j])
        found.append(stretch.filtered(np.array([np.tanh(qd / NARROW) - sign, np.tanh(qd / wide) - sign])))
    return found


def prior_rows(known: Known | None) -> Floats | None:
    """Return rows [L^T, L^T theta0] that hold parameters where they were, at most p of them, (r, p + 1)."""
    if known is None:
        return None
    root = information_root(known.covariance) / TRUST
    return np.column_stack([root, root @ known.theta])


def information_root(covariance: Floats) -> Floats:
    """Return L^T with (L L^T)^-1 the covariance, without the directions that it leaves open, (r, p)."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
    values, V = np.linalg.eigh(covariance / np.outer(size, size))
    seen = values > OPEN * values[-1]
    root: Floats = (V[:, seen] / np.sqrt(np.maximum(values[seen], 1e-8))).T / size
    return root


def make_setting(
    sources: Sequence[Source], base: BaseModel, known: Known | None, earlier: Sequence[Source] = ()
) -> Setting:
    """Arrange a search over conditioned logs.

    Args:
        sources: conditioned logs, all with the same filter.
        base: model and base parameters.
        known: the model that is kept, None to refit it.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
    """
    start = first_guess(sources, base) if known is None else known.theta
    reference = model_torques(base.model, base.reduction, start)
    stretches, matched = stretches_of(sources, base, reference), 0.0
    if known is not None and earlier:
        compared = against(stretches, stretches_of(earlier, base, reference), known.theta)
        if compared is not None:
            stretches, matched = compared
            # Why: what its parameters are off by is in both, but for what the motions differ.
            known = replace(known, covariance=ALIKE**2 * known.covariance)
    pairs = find_repeats(stretches)
    train, held, text = split(stretches, pairs, HELD_OUT if known is None else HELD_OUT_KEPT)
    theta, residuals = plain_fit(stretches, train, known)
    left = None
    if known is not None:
        residuals = plain_fit(stretches, train, None)[1]
    if known is not None and not matched:
        whole = plain_fit(stretches, train, None, nuisance=False)[1]
        # Why: the earlier identification knew no columns that are not judged; they take what it left at reversals.
        left = known.left * np.minimum(1.0, _rms(stretches, residuals, train) / _rms(stretches, whole, train))
    noise = noise_of(stretches, residuals, pairs, train)
    found = Setting(base, known, stretches, train, held, text, pairs, noise, theta, left, matched)
    return with_noise(found, noise, residuals)


def first_guess(sources: Sequence[Source], base: BaseModel) -> Floats:
    """Return base parameters that columns of the model's own effects scale with; zeros where none does, (p,)."""
    if not scale_with_model(base):
        return np.zeros(base.reduction.rank)
    return fitted(settled([with_effects(s, base.model) for s in sources], base), base)


def with_noise(setting: Setting, noise: Noise, residuals: Sequence[Floats]) -> Setting:
    """Return the setting with its noise measured, and what a kept model lacks beside it.

    Args:
        setting: rows, and what a kept model left when it was identified.
        noise: measured from repeats or high frequencies.
        residuals: what a model leaves of the rows, one (M, n) a stretch.
    """
    if setting.known is None:
        return replace(setting, noise=noise)
    if setting.matched and noise.repeats:
        # Why: what repeats show is the noise of one recording; rows are the difference to so many earlier ones.
        more = np.sqrt(1.0 + 1.0 / setting.matched)
        return replace(setting, noise=replace(noise, sigma=more * noise.sigma, floor=more * noise.floor))
    left = setting.left if setting.left is not None else _rms(setting.stretches, residuals, setting.train)
    return replace(setting, noise=with_misfit(noise, setting.stretches, residuals, left))


def _rms(stretches: Sequence[Stretch], residuals: Sequence[Floats], train: Sequence[Mask]) -> Floats:
    """Return the root mean square of residuals over rows that count, (n,)."""
    power, count = np.zeros(stretches[0].motion.n), np.zeros(stretches[0].motion.n)
    for s, r, rows in zip(stretches, residuals, train, strict=True):
        use = s.use & rows[:, None]
        power, count = power + np.sum(np.where(use, r, 0.0) ** 2, axis=0), count + use.sum(axis=0)
    return np.sqrt(np.maximum(power, 1e-30) / np.maximum(count, 1))


def split(stretches: Sequence[Stretch], pairs: Sequence[Pair], share: float) -> tuple[list[Mask], list[Mask], str]:
    """Hold out the last of three or more motions with its repeats, or else the last share of each log."""
    motion = list(range(len(stretches)))
    for pair in pairs:
        motion[pair.second] = min(motion[pair.second], motion[pair.first])
    logs = {s.log: motion[k] for k, s in reversed(list(enumerate(stretches)))}
    kinds = list(dict.fromkeys(logs[log] for log in sorted(logs)))
    if len(kinds) >= 3:
        out = [logs[s.log] == kinds[-1] for s in stretches]
        masks = [np.full(len(s), value) for s, value in zip(stretches, out, strict=True)]
        names = {s.source.name for s, value in zip(stretches, out, strict=True) if value}
        return [~m for m in masks], masks, ", ".join(sorted(names))
    border = {log: _border([s for s in stretches if s.log == log], share) for log in logs}
    train = [s.t < border[s.log] - BETWEEN for s in stretches]
    held = [s.t >= border[s.log] for s in stretches]
    return train, held, f"last {100 * share:.0f} % of each log's motion"


def _border(stretches: Sequence[Stretch], share: float) -> float:
    """Return the time from which the last share of a log's rows that count begins [s]; rest proves nothing."""
    t = np.concatenate([s.t[s.use.any(axis=1)] for s in stretches])
    return float(np.quantile(t, 1 - share)) if len(t) else float(stretches[0].t[0])


def plain_fit(
    stretches: Sequence[Stretch], train: Sequence[Mask], known: Known | None, *, nuisance: bool = True
) -> tuple[Floats, list[Floats]]:
    """Fit the baseline without whitening, weighted by joint; returns base parameters and residuals (M, n) a stretch."""
    n, p = stretches[0].W.shape[1:]
    columns = [nuisance_columns(s, judged=not nuisance) for s in stretches]
    weights, extra = np.ones(n), len(columns[0][0])
    theta, gamma = np.zeros(p), np.zeros((n, extra))
    for _ in range(2):
        board = [
            _rows(stretches, columns, [s.use[:, j] & rows for s, rows in zip(stretches, train, strict=True)], j, n)
            for j in range(n)
        ]
        gram = np.asarray(sum(w * A.T @ A for w, (A, _) in zip(weights, board, strict=True)))
        right = np.asarray(sum(w * A.T @ y for w, (A, y) in zip(weights, board, strict=True)))
        if known is not None:
            rows = prior_rows(known)
            assert rows is not None
            gram[:p, :p] += rows[:, :-1].T @ rows[:, :-1]
            right[:p] += rows[:, :-1].T @ rows[:, -1]
        solution = solve_gram(gram, right)
        theta, gamma = solution[:p], solution[p:].reshape(n, extra)
        weights = np.array(
            [1 / max(float(np.mean((y - A @ solution) ** 2)), 1e-18) if len(y) else 1.0 for A, y in board]
        )
    residuals = [
        s.tau - s.W @ theta - np.stack([gamma[j] @ c[j] for j in range(n)], axis=1)
        for s, c in zip(stretches, columns, strict=True)
    ]
    return theta, residuals


def _rows(
    stretches: Sequence[Stretch], columns: Sequence[Sequence[Floats]], use: Sequence[Mask], joint: int, n: int
) -> tuple[Floats, Floats]:
    parts = []
    for s, c, rows in zip(stretches, columns, use, strict=True):
        extra = len(c[joint])
        wide = np.zeros((int(rows.sum()), extra * n))
        wide[:, extra * joint : extra * (joint + 1)] = c[joint][:, rows].T
        parts.append(np.hstack([s.W[rows, joint], wide]))
    return np.concatenate(parts), np.concatenate([s.tau[rows, joint] for s, rows in zip(stretches, use, strict=True)])


def solve_gram(gram: Floats, right: Floats) -> Floats:
    """Solve normal equations in normalised columns, weak directions left at zero."""
    size = np.sqrt(np.diag(gram))
    size = np.where(size > 0, size, 1.0)
    values, V = np.linalg.eigh(gram / np.outer(size, size))
    kept = values > 1e-9 * values[-1]
    return np.asarray(V[:, kept] @ ((V[:, kept].T @ (right / size)) / values[kept]) / size)
