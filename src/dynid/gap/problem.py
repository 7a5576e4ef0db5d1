"""One search: which rows are searched, which are held out, the noise, and what is known of the parameters."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import compress

import numpy as np

from dynid.arrays import Floats
from dynid.errors import LogTooShort
from dynid.estimation.factor import of_unit_diagonal
from dynid.estimation.noise_floor import RepeatPair, find_repeats
from dynid.estimation.result import Identification
from dynid.estimation.stack import scale_with_model, stack_with_settled_effects
from dynid.gap.gap_rows import GapRows, gap_rows
from dynid.gap.known_errors import with_known_friction, with_reversals
from dynid.gap.noise import SHORTEST, NoiseModel, measure_noise, with_misfit, with_steps
from dynid.gap.regression import Regression, whitened_regression
from dynid.model.base_model import BaseModel
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


def known_parameters(kept: Identification) -> Floats:
    """Return products of rows [L^T, L^T theta] that hold base parameters where a model found them, (p + 1, p + 1)."""
    scaled, unit = of_unit_diagonal(kept.plain_covariance)
    values, V = np.linalg.eigh(scaled)
    determined = values > OPEN * values[-1]
    scale = TRUST * np.sqrt(np.maximum(values[determined], 1e-8))
    root = (V[:, determined] / scale).T * unit
    rows = np.column_stack([root, root @ kept.plain])
    return rows.T @ rows


def unexplained_before(kept: Identification) -> Floats:
    """Return the rms of what a model left of the torques when it was identified, (n,) [N m or N]."""
    left = np.einsum("jkp,p->jk", kept.factors, np.append(-kept.plain, 1.0))
    rms = np.linalg.norm(left, axis=1) / np.sqrt(np.maximum(kept.counts, 1))
    # Why the larger one: on other motion a model leaves more than on what it was fitted to, and that is no change.
    unseen = np.array([joint.heldout_rms or 0.0 for joint in kept.joints])
    return np.maximum(rms, unseen)


@dataclass(frozen=True)
class GapProblem:
    """Rows that are searched, with their noise and what is known of the base parameters.

    Attributes:
        base: model and base parameters.
        rows: all rows, those of earlier logs first, where these are at hand and it is asked what has changed.
        every: the same with rows whose friction nobody knows: when a joint turns tells how late its torque is.
        held_text: what is held out, in words.
        repeats: parts of the same motion.
        noise: the noise floor.
        theta: base parameters that effects are scaled with, (p,).
        since: whether it is asked what has changed since a model was identified.
        prior: products of rows [columns, value] on the base parameters that an earlier identification knows,
            (p + 1, p + 1); zeros for none, and where its logs are among the rows.
        in_force: noise with which held-out rows are judged by the best possible arm, as what is applied will be; None
            where the plain estimate is in force.
    """

    base: BaseModel
    rows: GapRows
    every: GapRows
    held_text: str
    repeats: list[RepeatPair]
    noise: NoiseModel
    theta: Floats
    prior: Floats
    since: bool = False
    in_force: NoiseModel | None = None

    @property
    def same_motion(self) -> bool:
        """Whether earlier and new logs hold the same motion, so that what always was cancels."""
        new = self.rows.new
        return any(new[pair.first] != new[pair.second] for pair in self.repeats)

    def searched(self, theta: Floats) -> GapRows:
        """Return the rows that are searched, effects scaled with base parameters, (p,)."""
        return self.rows.only(self.rows.train).with_reference(self.base, theta)

    def regression(self, theta: Floats | None = None, *, nuisance: bool = True) -> Regression:
        """Return the whitened training rows, effects scaled with given base parameters.

        Args:
            theta: base parameters, those of the problem when None, (p,).
            nuisance: whether shapes of reversals are left unjudged.
        """
        rows = self.searched(self.theta if theta is None else theta)
        return whitened_regression(rows, self.noise, self.prior, nuisance=nuisance)


def make_problem(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: Identification | None,
    earlier: Sequence[ConditionedLog] = (),
) -> GapProblem:
    """Arrange a search over conditioned logs.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, None to refit it.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.

    Raises:
        LogTooShort: no part of the logs, earlier ones apart, is long enough to be searched.
    """
    start = _first_guess(logs, base) if kept is None else kept.plain
    reference = base.torques(start)
    rows = gap_rows(logs, base, reference, () if kept is None else earlier)
    repeats = find_repeats([rows.q[part] for part in rows.parts], rows.rate)
    rows, text = split(rows, repeats, HELD_OUT if kept is None else HELD_OUT_KEPT)
    if np.bincount(rows.part, rows.train & rows.is_new).max() < SHORTEST:
        raise LogTooShort(
            f"no part of the logs has {SHORTEST} usable rows, which the noise level needs",
            why="residuals are compared with the noise",
        )
    alone = kept is not None and not rows.compared
    prior = np.zeros((base.rank + 1, base.rank + 1))
    if kept is not None and alone:
        prior = known_parameters(kept)
    first = unwhitened_fit(rows, nuisance=False)[0] if kept is None else kept.plain
    every = with_reversals(rows, base, first)
    rows = with_known_friction(every, _measured(every, base, prior, repeats)[-1].floor)
    theta, residual, noise = _measured(rows, base, prior, repeats)
    if kept is not None and alone:
        of_all = unwhitened_fit(rows, nuisance=False)[1]
        # Why: the earlier identification knew no nuisance columns; they take what it left at reversals.
        left = searched_rms(rows, residual) / searched_rms(rows, of_all)
        noise = with_misfit(noise, rows, residual, unexplained_before(kept) * np.minimum(1.0, left))
    return GapProblem(base, rows, every, text, repeats, noise, theta, prior, kept is not None)


def _measured(
    rows: GapRows, base: BaseModel, prior: Floats, repeats: Sequence[RepeatPair]
) -> tuple[Floats, Floats, NoiseModel]:
    """Return base parameters of a fit, (p,), its residuals of all rows, (M, n), and the noise in them."""
    theta, residual = unwhitened_fit(rows, prior)
    if rows.compared:
        # Why each era for itself: what has changed is no noise.
        old, new = (unwhitened_fit(rows.only(era))[1] for era in (~rows.is_new, rows.is_new))
        residual = np.where(rows.is_new[:, None], new, old)
    elif prior.any():
        residual = unwhitened_fit(rows)[1]
    same = [pair for pair in repeats if rows.new[pair.first] == rows.new[pair.second]]
    return (
        theta,
        residual,
        with_steps(measure_noise(rows, residual, same), rows.with_reference(base, theta)),
    )


def possible_noise(problem: GapProblem) -> NoiseModel:
    """Return the noise that the best possible arm is fitted with: at least what parameters without any bounds leave."""
    residual = unwhitened_fit(problem.rows)[1]
    return with_misfit(problem.noise, problem.rows, residual, searched_rms(problem.rows, residual))


def judged_by_possible(problem: GapProblem) -> GapProblem:
    """Return a problem whose held-out rows are judged by the best possible arm jointly with the effects.

    A refit without bounds moves what the rows hardly determine, and with it joints that an effect has nothing to do
    with. What parameters without any bounds do not explain says nothing about links.
    """
    return replace(problem, in_force=possible_noise(problem))


def _first_guess(logs: Sequence[ConditionedLog], base: BaseModel) -> Floats:
    """Return base parameters that columns of the model's own effects scale with; zeros where none does, (p,)."""
    if not scale_with_model(base):
        return np.zeros(base.rank)
    return stack_with_settled_effects(
        [with_effects(log, base.model) for log in logs], base
    ).first_fit.theta


def searched_rms(rows: GapRows, residual: Floats) -> Floats:
    """Return the root mean square of residuals, (M, n), over searched rows that count, (n,)."""
    use = rows.use & rows.train[:, None]
    power = np.sum(np.where(use, residual, 0.0) ** 2, axis=0)
    return np.sqrt(np.maximum(power, 1e-30) / np.maximum(use.sum(axis=0), 1))


def split(rows: GapRows, repeats: Sequence[RepeatPair], share: float) -> tuple[GapRows, str]:
    """Hold out the last of three or more new motions with its repeats, or else the last share of each new log."""
    motion = np.arange(len(rows.logs))
    for pair in repeats:
        if rows.new[pair.first]:
            motion[pair.second] = min(motion[pair.second], motion[pair.first])
    # Of each log, that of its first part.
    motion = motion[np.searchsorted(rows.number, rows.number)]
    kinds = list(dict.fromkeys(motion[rows.new].tolist()))
    if len(kinds) >= 3:
        last = motion == kinds[-1]
        text = ", ".join(sorted({log.name for log in compress(rows.logs, last)}))
        held = last[rows.part]
        return replace(rows, train=~held, held=held), text
    border, number = np.full(len(rows), np.inf), rows.number[rows.part]
    for k in np.unique(rows.number[rows.new]):
        own = number == k
        # Why of rows that count: rest proves nothing.
        t = rows.t[own & rows.use.any(axis=1)]
        border[own] = np.quantile(t, 1 - share) if len(t) else rows.t[own][0]
    train, held = rows.t < border - BETWEEN, rows.t >= border
    return replace(rows, train=train, held=held), f"last {100 * share:.0f} % of each log's motion"


def unwhitened_fit(
    rows: GapRows, prior: Floats | float = 0.0, *, nuisance: bool = True
) -> tuple[Floats, Floats]:
    """Fit the baseline without whitening, weighted by joint, to rows that are searched.

    Args:
        rows: the rows.
        prior: products of rows [columns, value] that hold base parameters, (p + 1, p + 1); 0 for none.
        nuisance: whether shapes of reversals are left unjudged.

    Returns:
        Base parameters, (p,), and residuals of all rows, (M, n).
    """
    n, p = rows.W.shape[1:]
    sigma, searched = np.ones(n), rows.only(rows.train)
    for _ in range(2):
        fit = whitened_regression(searched, NoiseModel.white(sigma), prior, nuisance=nuisance)
        power = [float(np.mean(e**2)) if len(e) else 1.0 for e in fit.e]
        sigma = sigma * np.sqrt(np.maximum(power, 1e-18))
    residual = rows.tau - rows.W @ fit.theta[:p]
    if nuisance:
        for j, size in enumerate(fit.theta[p:].reshape(n, -1)):
            residual[:, j] -= size @ rows.turns[j]
    return fit.theta[:p], residual
