"""One search: which rows are searched, which are held out, the noise, and what is known of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.estimation.result import Identification
from dynid.estimation.stack import scale_with_model, settled, stack_logs
from dynid.gap.known_errors import reversal_columns, with_reversals
from dynid.gap.noise import (
    NoiseModel,
    RepeatPair,
    find_repeats,
    measure_noise,
    with_misfit,
    with_steps,
)
from dynid.gap.segments import Mask, SegmentRows, cut, segments_of, with_reference
from dynid.gap.whitened_regression import (
    WhitenedRegression,
    few,
    torque_residuals,
    whitened_regression,
)
from dynid.model.base_model import BaseModel, model_torques
from dynid.model.effects.interface import Floats
from dynid.signals.conditioned_log import ConditionedLog, with_effects

#: Share of each log that is held out where there are fewer than three motions, as ``dynid identify`` does.
HELD_OUT = 0.2
#: The same when a model is kept: little is fitted then, and what is slow makes short parts no proof.
HELD_OUT_KEPT = 0.4
#: Rows between training and held-out part that belong to neither, longer than residuals go on for [s].
BETWEEN = 1.0
#: Directions of an earlier identification's covariance below this share of the largest are those that its logs left
#: open: nothing is known of them, and nothing holds them.
OPEN = 1e-12
#: Errors of an earlier identification are taken this much larger, for what its own model lacked.
TRUST = 1.5


@dataclass(frozen=True)
class KeptModel:
    """A model that is kept: what an earlier identification found.

    Attributes:
        theta: base parameters that the data gave, without a prior, (p,).
        covariance: of them, (p, p); no spread along directions that the data left open.
        unexplained: rms of what the model left of the torques when it was identified, of held-out ones if that is
            more, (n,) [N m or N].
    """

    theta: Floats
    covariance: Floats
    unexplained: Floats

    @property
    def prior_rows(self) -> Floats:
        """Rows [L^T, L^T theta] that hold parameters where they were, at most p of them, (r, p + 1)."""
        root = information_root(self.covariance) / TRUST
        return np.column_stack([root, root @ self.theta])


def kept_model(found: Identification) -> KeptModel:
    """Return what an identification found as a model that is kept."""
    left = np.einsum("jkp,p->jk", found.factors, np.append(-found.plain, 1.0))
    rms = np.linalg.norm(left, axis=1) / np.sqrt(np.maximum(found.counts, 1))
    # Why the larger one: on other motion a model leaves more than on what it was fitted to, and that is no change.
    unexplained = np.array(
        [max(r, j.heldout_rms or 0.0) for r, j in zip(rms, found.joints, strict=True)]
    )
    return KeptModel(found.plain, found.plain_covariance, unexplained)


def information_root(covariance: Floats) -> Floats:
    """Return L^T with (L L^T)^-1 the covariance, without the directions that it leaves open, (r, p)."""
    size = np.sqrt(np.maximum(np.diag(covariance), 1e-18))
    values, V = np.linalg.eigh(covariance / np.outer(size, size))
    seen = values > OPEN * values[-1]
    root: Floats = (V[:, seen] / np.sqrt(np.maximum(values[seen], 1e-8))).T / size
    return root


@dataclass(frozen=True)
class GapProblem:
    """Rows that are searched, with their noise and what is known of the base parameters.

    Attributes:
        base: model and base parameters.
        segments: all rows, those of earlier logs first, where these are at hand and it is asked what has changed.
        train: rows that are searched, one mask (M,) per segment.
        held: held-out rows, one mask (M,) per segment.
        held_text: what is held out, in words.
        repeats: segments of the same motion.
        noise: the noise floor.
        theta: base parameters that effects are scaled with, (p,).
        since: whether it is asked what has changed since a model was identified.
        prior: rows [columns, value] on the base parameters that an earlier identification knows, (k, p + 1); None for
            none, and where its logs are among the rows.
        in_force: noise with which held-out rows are judged by the best possible arm, as what is applied will be; None
            where the plain estimate is in force.
        arm: whether that arm is fitted exactly, because only an implausible one would absorb what is looked for.
    """

    base: BaseModel
    segments: list[SegmentRows]
    train: list[Mask]
    held: list[Mask]
    held_text: str
    repeats: list[RepeatPair]
    noise: NoiseModel
    theta: Floats
    since: bool = False
    prior: Floats | None = None
    in_force: NoiseModel | None = None
    arm: bool = False

    @property
    def compared(self) -> bool:
        """Whether earlier logs are among the rows, and what is looked for acts in the new ones alone."""
        return not all(s.is_new for s in self.segments)

    @property
    def same_motion(self) -> bool:
        """Whether earlier and new logs hold the same motion, so that what always was cancels."""
        new = [s.is_new for s in self.segments]
        return any(new[pair.first] != new[pair.second] for pair in self.repeats)

    def regression(
        self, theta: Floats | None = None, *, nuisance: bool = True
    ) -> WhitenedRegression:
        """Return the whitened training rows, effects scaled with given base parameters.

        Args:
            theta: base parameters, those of the problem when None, (p,).
            nuisance: whether shapes of reversals are left unjudged.
        """
        # Why not of many rows: they take memory, and little time compared with what is made of them.
        kept = self._judged if nuisance else self._bare
        found = kept if few(self.segments) else self._whitened(nuisance=nuisance)
        if theta is None or np.array_equal(theta, self.theta):
            return found
        return replace(found, segments=self._searched(theta))

    @cached_property
    def _judged(self) -> WhitenedRegression:
        return self._whitened(nuisance=True)

    @cached_property
    def _bare(self) -> WhitenedRegression:
        return self._whitened(nuisance=False)

    def _searched(self, theta: Floats) -> list[SegmentRows]:
        reference = model_torques(self.base.model, self.base.reduction, theta)
        return cut(with_reference(self.segments, reference), self.train)

    def _whitened(self, *, nuisance: bool) -> WhitenedRegression:
        columns = [nuisance_columns(s, nuisance) for s in self.segments]
        return whitened_regression(self._searched(self.theta), self.noise, columns, self.prior)


def nuisance_columns(segment: SegmentRows, nuisance: bool = True) -> list[Floats]:
    """Return known errors of each joint, (7, M); none, (0, M), where there shall be none."""
    n = segment.motion.n
    return [
        reversal_columns(segment, j) if nuisance else np.zeros((0, len(segment))) for j in range(n)
    ]


def make_problem(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    earlier: Sequence[ConditionedLog] = (),
) -> GapProblem:
    """Arrange a search over conditioned logs.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, None to refit it.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
    """
    start = first_guess(logs, base) if kept is None else kept.theta
    reference = model_torques(base.model, base.reduction, start)
    segments = segments_of(logs, base, reference)
    share = HELD_OUT if kept is None else HELD_OUT_KEPT
    train, held, text = split(segments, find_repeats(segments), share)
    eras = [slice(0, len(segments))]
    if kept is not None and earlier:
        before = [replace(s, is_new=False) for s in segments_of(earlier, base, reference)]
        later = 1 + max(s.number for s in before)
        segments = [*before, *(replace(s, number=later + s.number) for s in segments)]
        train = [*(np.ones(len(s), dtype=bool) for s in before), *train]
        held = [*(np.zeros(len(s), dtype=bool) for s in before), *held]
        eras = [slice(0, len(before)), slice(len(before), None)]
    alone = kept is not None and len(eras) == 1
    prior = kept.prior_rows if kept is not None and alone else None
    first = unwhitened_fit(segments, train, nuisance=False)[0] if kept is None else kept.theta
    segments = with_reversals(segments, base, first)
    theta = unwhitened_fit(segments, train, prior)[0]
    # Why each era for itself: what has changed is no noise.
    residuals = [r for era in eras for r in unwhitened_fit(segments[era], train[era])[1]]
    repeats = find_repeats(segments)
    same = [x for x in repeats if segments[x.first].is_new == segments[x.second].is_new]
    noise = with_steps(measure_noise(segments, residuals, same, train), segments)
    if kept is not None and alone:
        whole = unwhitened_fit(segments, train, nuisance=False)[1]
        # Why: the earlier identification knew no nuisance columns; they take what it left at reversals.
        left = _rms(segments, residuals, train) / _rms(segments, whole, train)
        noise = with_misfit(noise, segments, residuals, kept.unexplained * np.minimum(1.0, left))
    since = kept is not None
    return GapProblem(base, segments, train, held, text, repeats, noise, theta, since, prior)


def judged_by_possible(problem: GapProblem, *, arm: bool = False) -> GapProblem:
    """Return a problem whose held-out rows are judged by the best possible arm jointly with the effects.

    A refit without bounds moves what the rows hardly determine, and with it joints that an effect has nothing to do
    with. What parameters without any bounds do not explain says nothing about links.

    Args:
        problem: the problem.
        arm: whether that arm is fitted exactly.
    """
    residuals = unwhitened_fit(problem.segments, problem.train)[1]
    level = _rms(problem.segments, residuals, problem.train)
    noise = with_misfit(problem.noise, problem.segments, residuals, level)
    return replace(problem, in_force=noise, arm=arm)


def first_guess(logs: Sequence[ConditionedLog], base: BaseModel) -> Floats:
    """Return base parameters that columns of the model's own effects scale with; zeros where none does, (p,)."""
    if not scale_with_model(base):
        return np.zeros(base.reduction.rank)
    return stack_logs(
        settled([with_effects(s, base.model) for s in logs], base), base
    ).first_fit.theta


def _rms(
    segments: Sequence[SegmentRows], residuals: Sequence[Floats], train: Sequence[Mask]
) -> Floats:
    """Return the root mean square of residuals over rows that count, (n,)."""
    power, count = np.zeros(segments[0].motion.n), np.zeros(segments[0].motion.n)
    for s, r, rows in zip(segments, residuals, train, strict=True):
        use = s.use & rows[:, None]
        power, count = power + np.sum(np.where(use, r, 0.0) ** 2, axis=0), count + use.sum(axis=0)
    return np.sqrt(np.maximum(power, 1e-30) / np.maximum(count, 1))


def split(
    segments: Sequence[SegmentRows], repeats: Sequence[RepeatPair], share: float
) -> tuple[list[Mask], list[Mask], str]:
    """Hold out the last of three or more motions with its repeats, or else the last share of each log."""
    motion = list(range(len(segments)))
    for pair in repeats:
        motion[pair.second] = min(motion[pair.second], motion[pair.first])
    logs = {s.number: motion[k] for k, s in reversed(list(enumerate(segments)))}
    kinds = list(dict.fromkeys(logs[log] for log in sorted(logs)))
    if len(kinds) >= 3:
        out = [logs[s.number] == kinds[-1] for s in segments]
        masks = [np.full(len(s), value) for s, value in zip(segments, out, strict=True)]
        names = {s.log.name for s, value in zip(segments, out, strict=True) if value}
        return [~m for m in masks], masks, ", ".join(sorted(names))
    border = {log: _border([s for s in segments if s.number == log], share) for log in logs}
    train = [s.t < border[s.number] - BETWEEN for s in segments]
    held = [s.t >= border[s.number] for s in segments]
    return train, held, f"last {100 * share:.0f} % of each log's motion"


def _border(segments: Sequence[SegmentRows], share: float) -> float:
    """Return the time from which the last share of a log's rows that count begins [s]; rest proves nothing."""
    t = np.concatenate([s.t[s.use.any(axis=1)] for s in segments])
    return float(np.quantile(t, 1 - share)) if len(t) else float(segments[0].t[0])


def unwhitened_fit(
    segments: Sequence[SegmentRows],
    train: Sequence[Mask],
    prior: Floats | None = None,
    *,
    nuisance: bool = True,
) -> tuple[Floats, list[Floats]]:
    """Fit the baseline without whitening, weighted by joint.

    Args:
        segments: rows.
        train: rows that are fitted, one mask (M,) per segment.
        prior: rows [columns, value] that hold base parameters, (k, p + 1); None for none.
        nuisance: whether shapes of reversals are left unjudged.

    Returns:
        Base parameters, (p,), and residuals of all rows, one (M, n) per segment.
    """
    columns = [nuisance_columns(s, nuisance) for s in segments]
    n, p = segments[0].W.shape[1:]
    sigma, searched = np.ones(n), cut(segments, train)
    for _ in range(2):
        found = whitened_regression(searched, NoiseModel.white(sigma), columns, prior)
        sigma = sigma * np.array(
            [np.sqrt(max(float(np.mean(e**2)), 1e-18)) if len(e) else 1.0 for e in found.fit.e]
        )
    return found.fit.theta[:p], torque_residuals(found, segments, columns)
