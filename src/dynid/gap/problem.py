"""One search: which rows are searched, which are held out, the noise, and the baseline."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.estimation.result import Identification
from dynid.estimation.stack import scale_with_model, settled, stack_logs
from dynid.estimation.tuning import REPEATED
from dynid.gap.change import with_always_missing
from dynid.gap.known_errors import reversal_columns, with_reversals
from dynid.gap.matched_motion import subtract_matched_motion
from dynid.gap.noise import (
    NoiseModel,
    RepeatPair,
    find_repeats,
    measure_noise,
    with_misfit,
    with_steps,
)
from dynid.gap.possible_arm import PossibleArm, best_possible, possible_arm, prior_rows
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
#: Old and new logs fitted together count as leaving at most so many times what each leaves alone, before anything is
#: found. More would be found a second time with less noise; where too little is, nothing is named before it is more.
AT_FIRST = 1.2


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
    """One search.

    Attributes:
        base: model and base parameters.
        kept: the kept model; None when the baseline is fitted.
        segments: all rows.
        train: rows that are searched, one mask (M,) per segment.
        held: held-out rows, one mask (M,) per segment.
        held_text: what is held out, in words.
        repeats: segments of the same motion.
        noise: the noise floor.
        theta: base parameters that effects are scaled with, (p,).
        unexplained: what a kept model left unexplained when it was identified, of what is judged, (n,) [N m or N]; None
            where it cancels, and when the baseline is refitted.
        matched: how many rows of earlier logs each row is compared with, because the motion is the same; 0 when it is
            compared with the model alone.
        in_force: noise with which held-out rows are judged by the best possible arm, as what is applied will be; None
            where the plain estimate is in force.
        arm: the prior of possible links, where it is asked what only an implausible arm would absorb.
        held_by: rows [columns, value] on the base parameters that say how implausible an arm is, near the best one,
            or how large what has always been missing may be, (k, p + 1).
        pooled: whether the earlier logs are among the rows, and what is looked for acts in the new ones alone.
    """

    base: BaseModel
    kept: KeptModel | None
    segments: list[SegmentRows]
    train: list[Mask]
    held: list[Mask]
    held_text: str
    repeats: list[RepeatPair]
    noise: NoiseModel
    theta: Floats
    unexplained: Floats | None = None
    matched: float = 0.0
    pooled: bool = False
    in_force: NoiseModel | None = None
    arm: PossibleArm | None = None
    held_by: Floats | None = None

    @property
    def since(self) -> bool:
        """Whether it is asked what has changed since a model was identified."""
        return self.kept is not None or self.pooled

    def regression(
        self, theta: Floats | None = None, *, nuisance: bool = True
    ) -> WhitenedRegression:
        """Return the whitened training rows, effects scaled with given base parameters.

        Args:
            theta: base parameters, those of the problem when None, (p,).
            nuisance: whether shapes of reversals are left unjudged.
        """
        # Why not of many rows: they take memory, and little time compared with what is made of them.
        kept = few(self.segments)
        found = (
            (self._judged if nuisance else self._bare)
            if kept
            else self._whitened(nuisance=nuisance)
        )
        if theta is None or np.array_equal(theta, self.theta):
            return found
        return replace(found, segments=self._searched(theta))

    @cached_property
    def _judged(self) -> WhitenedRegression:
        return self._whitened(nuisance=True)

    @cached_property
    def _bare(self) -> WhitenedRegression:
        return self._whitened(nuisance=False)

    @cached_property
    def _own(self) -> list[SegmentRows]:
        """The rows that are searched, effects scaled with the parameters of the problem."""
        return self._searched(self.theta)

    def _searched(self, theta: Floats) -> list[SegmentRows]:
        reference = model_torques(self.base.model, self.base.reduction, theta)
        return cut(with_reference(self.segments, reference), self.train)

    def _whitened(self, *, nuisance: bool) -> WhitenedRegression:
        prior = self.held_by if self.kept is None else self.kept.prior_rows
        columns = [nuisance_columns(s, nuisance) for s in self.segments]
        return replace(
            whitened_regression(self._own, self.noise, columns, prior),
            link_prior=self.arm is not None,
        )


def _baseline(
    segments: Sequence[SegmentRows],
    train: Sequence[Mask],
    prior: Floats | None,
    noise: NoiseModel,
    nuisance: Sequence[Sequence[Floats]],
) -> WhitenedRegression:
    return whitened_regression(cut(segments, train), noise, nuisance, prior)


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
    segments, matched = segments_of(logs, base, reference), 0.0
    if kept is not None and earlier:
        before = segments_of(earlier, base, reference)
        compared = subtract_matched_motion(segments, before, kept.theta)
        if compared is None:
            return _problem_since(before, segments, base, kept)
        segments, matched = compared
        # Why: what its parameters are off by is in both, but for what the motions differ.
        kept = replace(kept, covariance=REPEATED**2 * kept.covariance)
    repeats = find_repeats(segments)
    train, held, text = split(segments, repeats, HELD_OUT if kept is None else HELD_OUT_KEPT)
    first = unwhitened_fit(segments, train, kept, nuisance=False)[0] if kept is None else kept.theta
    segments = with_reversals(segments, base, first)
    theta, residuals = unwhitened_fit(segments, train, kept)
    unexplained = None
    if kept is not None:
        residuals = unwhitened_fit(segments, train, None)[1]
    if kept is not None and not matched:
        whole = unwhitened_fit(segments, train, None, nuisance=False)[1]
        # Why: the earlier identification knew no nuisance columns; they take what it left at reversals.
        share = _rms(segments, residuals, train) / _rms(segments, whole, train)
        unexplained = kept.unexplained * np.minimum(1.0, share)
    noise = measure_noise(segments, residuals, repeats, train)
    found = GapProblem(
        base, kept, segments, train, held, text, repeats, noise, theta, unexplained, matched
    )
    return with_noise(found, noise, residuals)


def judged_by_possible(problem: GapProblem, residuals: Sequence[Floats]) -> GapProblem:
    """Return a problem whose held-out rows are judged by the best possible arm jointly with the effects.

    A refit without bounds moves what the rows hardly determine, and with it joints that an effect has nothing to do
    with.

    Args:
        problem: the problem.
        residuals: what the model leaves, one (M, n) per segment: so uncertain are the rows.
    """
    level = _rms(problem.segments, residuals, problem.train)
    return replace(problem, in_force=with_misfit(problem.noise, problem.segments, residuals, level))


def near_possible(problem: GapProblem, regression: WhitenedRegression) -> WhitenedRegression:
    """Return a regression held near the best possible arm jointly with its effects."""
    rows = prior_rows(regression, possible_arm(regression, problem.base))
    return replace(regression, prior=_wide(rows, regression.size))


def at_possible(problem: GapProblem, regression: WhitenedRegression) -> WhitenedRegression:
    """Return a regression held at the best possible arm jointly with its effects, exactly fitted."""
    rows = best_possible(regression, problem.base)
    return replace(regression, prior=_wide(rows, regression.size))


def problem_of_arm(logs: Sequence[ConditionedLog], base: BaseModel) -> GapProblem:
    """Arrange a search for what only an implausible arm would absorb.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
    """
    found = with_misfit_of_numbers(make_problem(logs, base, None))
    bare = found.regression()
    found = replace(found, arm=possible_arm(bare, base))
    return held_near_possible(found, bare)


def with_misfit_of_numbers(problem: GapProblem) -> GapProblem:
    """Return a problem whose noise is at least what parameters without any bounds leave of each joint.

    What they do not explain says nothing about links.

    Args:
        problem: a search of what no numbers absorb.
    """
    residuals = unwhitened_fit(problem.segments, problem.train, None)[1]
    level = _rms(problem.segments, residuals, problem.train)
    return replace(
        problem,
        noise=with_misfit(problem.noise, problem.segments, residuals, level),
        unexplained=level,
    )


def held_near_possible(problem: GapProblem, regression: WhitenedRegression) -> GapProblem:
    """Return a problem held near the best possible arm jointly with what a regression has selected.

    Args:
        problem: the problem; one that asks for anything else stays as it is.
        regression: its rows, with effects.
    """
    if problem.arm is None:
        return problem
    arm = possible_arm(regression, problem.base)
    rows = prior_rows(regression, arm)
    theta = rows[:, :-1]
    best = replace(regression, prior=_wide(rows, regression.size)).fit.theta[: theta.shape[1]]
    return replace(problem, arm=arm, held_by=rows, theta=best)


def _wide(rows: Floats, size: int) -> Floats:
    """Return rows [columns, value] with zeros for further columns, (k, size + 1)."""
    wide = np.zeros((len(rows), size + 1))
    wide[:, : rows.shape[1] - 1], wide[:, -1] = rows[:, :-1], rows[:, -1]
    return wide


def _problem_since(
    earlier: Sequence[SegmentRows],
    segments: Sequence[SegmentRows],
    base: BaseModel,
    kept: KeptModel,
) -> GapProblem:
    """Arrange a search for what has changed between earlier and new logs of other motion, all fitted together.

    What is looked for acts in the new logs alone, with what may always have been missing. Each joint's noise is at
    least what is left of old and new logs together.

    Args:
        earlier: rows of the logs that a model was identified from.
        segments: rows of the new logs.
        base: model and base parameters.
        kept: the model that was identified from the earlier logs.
    """
    first = 1 + max(s.number for s in earlier)
    before = [replace(s, is_new=False) for s in earlier]
    after = [replace(s, number=first + s.number) for s in segments]
    train, held, text = split(after, find_repeats(after), HELD_OUT_KEPT)
    train = [*(np.ones(len(s), dtype=bool) for s in before), *train]
    held = [*(np.zeros(len(s), dtype=bool) for s in before), *held]
    every, old, new = [*before, *after], slice(0, len(before)), slice(len(before), None)
    every = with_reversals(every, base, kept.theta)
    level = _rms(every[old], unwhitened_fit(every[old], train[old], None)[1], train[old])
    every, held_by = with_always_missing(every, kept.theta, level)
    repeats = [
        pair
        for pair in find_repeats(every)
        if every[pair.first].is_new == every[pair.second].is_new
    ]
    theta, together = unwhitened_fit(every, train, None, held_by)
    alone = [
        r for era in (old, new) for r in unwhitened_fit(every[era], train[era], None, held_by)[1]
    ]
    noise = with_steps(measure_noise(every, alone, repeats, train), every)
    # Why not all: what has changed is in it too, and is looked for first.
    level = np.minimum(_rms(every, together, train), AT_FIRST * _rms(every, alone, train))
    noise = with_misfit(noise, cut(every, train), alone, level)
    theta = theta[: len(kept.theta)]
    return GapProblem(
        base, None, every, train, held, text, repeats, noise, theta, pooled=True, held_by=held_by
    )


def without_always_missing(problem: GapProblem) -> GapProblem:
    """Return a comparison with earlier logs with the base parameters of the arm alone."""
    narrow = [
        replace(s, rows=replace(s.rows, columns=s.rows.columns[:1])) for s in problem.segments
    ]
    return replace(problem, segments=narrow, held_by=None)


def first_guess(logs: Sequence[ConditionedLog], base: BaseModel) -> Floats:
    """Return base parameters that columns of the model's own effects scale with; zeros where none does, (p,)."""
    if not scale_with_model(base):
        return np.zeros(base.reduction.rank)
    return stack_logs(
        settled([with_effects(s, base.model) for s in logs], base), base
    ).first_fit.theta


def with_noise(problem: GapProblem, noise: NoiseModel, residuals: Sequence[Floats]) -> GapProblem:
    """Return the problem with its noise, and with what a kept model lacks jointly with it.

    Args:
        problem: rows, and what a kept model left unexplained when it was identified.
        noise: measured from repeats or high frequencies.
        residuals: what a model leaves of the rows, one (M, n) per segment.
    """
    noise = with_steps(noise, problem.segments)
    if not problem.since and problem.arm is None:
        return replace(problem, noise=noise)
    if problem.matched and noise.repeats:
        # Why: what repeats show is the noise of one recording; rows are the difference to so many earlier ones.
        more = np.sqrt(1.0 + 1.0 / problem.matched)
        return replace(
            problem, noise=replace(noise, sigma=more * noise.sigma, floor=more * noise.floor)
        )
    level = (
        _rms(problem.segments, residuals, problem.train)
        if problem.unexplained is None
        else problem.unexplained
    )
    # Why not held-out rows: what few seconds of new logs determine leaves much more there, for seconds.
    rows = cut(problem.segments, problem.train) if problem.pooled else problem.segments
    return replace(problem, noise=with_misfit(noise, rows, residuals, level))


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
    kept: KeptModel | None,
    held_by: Floats | None = None,
    *,
    nuisance: bool = True,
) -> tuple[Floats, list[Floats]]:
    """Fit the baseline without whitening, weighted by joint.

    Args:
        segments: rows.
        train: rows that are fitted, one mask (M,) per segment.
        kept: the model that holds the parameters; None for none.
        held_by: rows [columns, value] that hold them where no model is kept, (k, p + 1).
        nuisance: whether shapes of reversals are left unjudged.

    Returns:
        Base parameters, (p,), and residuals of all rows, one (M, n) per segment.
    """
    columns = [nuisance_columns(s, nuisance) for s in segments]
    n, p = segments[0].W.shape[1:]
    prior = held_by if kept is None else kept.prior_rows
    regression = _baseline(segments, train, prior, NoiseModel.white(np.ones(n)), columns)
    sigma = [np.sqrt(max(float(np.mean(e**2)), 1e-18)) if len(e) else 1.0 for e in regression.fit.e]
    regression = _baseline(segments, train, prior, NoiseModel.white(np.array(sigma)), columns)
    return regression.fit.theta[:p], torque_residuals(regression, segments, columns)
