"""What no effect of the catalogue explains, put into words: a formula over the motion of a joint and its neighbours.

All products of a library are screened on the rows, the leading ones are evaluated exactly, and the shortest of those
that the best is not clearly better than is taken, term by term. It is told only if halves of the blocks of time choose
the same, the rows that were never fitted agree, and no other joint gets worse.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from dynid.gap.formula_library import cost_of, forms
from dynid.gap.formula_rows import ABSORBED, FactorRows
from dynid.gap.localisation import NEGLIGIBLE
from dynid.gap.noise import measure_noise
from dynid.gap.problem import GapProblem
from dynid.gap.refit import GROWN, fitted_with, ratio_interval
from dynid.gap.search import EffectSearch, residuals_of_fit
from dynid.gap.segments import SegmentRows, cut, jackknife_blocks
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_selected
from dynid.gap.significance import significance_test, whitened_columns
from dynid.gap.stepwise_selection import EQUAL, SURE
from dynid.gap.verdict import unrepeatable
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.formula import Formula, formula_text
from dynid.model.effects.interface import Floats
from dynid.progress import SILENT, Progress

#: Most steps, and most columns after them; a longer formula explains nothing to anybody.
MOST, LONGEST = 3, 4
#: How often a formula is chosen: once more with the loads of the arm with the first one, where that leaves something.
PASSES = 2
#: Most joints that are put into words, the loudest ones.
JOINTS = 3
#: Products that are evaluated exactly after the screening.
EXACT = 40
#: Draws of half the blocks, and the share of them that has to choose the same or what looks the same.
DRAWS, STABLE, SAME_SHAPE = 20, 0.8, 0.9
#: Chance of a term by accident, over all products that are tried.
CHANCE = 0.01
#: Share of the joint's excess that a formula explains, and that a further term explains of what is left.
SHARE, MORE = 0.5, 0.15
#: Upper end of the 95 % interval of the held-out error, after over before.
SMALLER = 0.97
#: Chance below which a formula differs between parts of the logs.
CONSTANT = 1e-3
#: Parts of a signal's range that tell whether the residual follows it, and the share of its power from which it does.
PARTS, FOLLOWED = 12, 0.1
#: Bins in which the quantity that an effect follows is sought.
BINS = 24
#: Share of its power that a formula follows a quantity with, to be drawn over that; else it is drawn over itself.
FOLLOWS_ONE = 0.9
#: Why a joint that has nothing to repeat has no formula.
STRAY = "what disturbs it does not repeat"
#: By how much more of its power an effect has to follow time than anything else.
TIME_LEAD = 0.1


@dataclass(frozen=True)
class Clue:
    """What is known of a joint for which no formula passed.

    Attributes:
        joint: its index.
        signal: what the residual follows most, such as ``qd4``.
        share: share of its power that a curve over this signal explains, where it was not fitted.
        repeats: share of its power that is the same whenever the motion is; None without repeats.
        near: the formula that came nearest, and why it is not told; "" for none.
    """

    joint: int
    signal: str
    share: float
    repeats: float | None
    near: str = ""


@dataclass(frozen=True)
class HeldOutEffect:
    """An effect or formula on rows that were never fitted, of the joint that shows it most.

    Attributes:
        t: times, (M,) [s].
        residual: what is left without it, (M,) [N m or N].
        torque: what it says, (M,) [N m or N].
        left: what is left with it, everything fitted again, (M,) [N m or N].
        against: values of the quantity that its torque follows most, (M,).
        follows: that quantity with its unit, such as ``"speed of joint_3 [rad/s]"``.
    """

    t: Floats
    residual: Floats
    torque: Floats
    left: Floats
    against: Floats
    follows: str

    @property
    def data(self) -> Floats:
        """What the model leaves for the effect, (M,) [N m or N].

        Why not the residual without it: there the other parameters have taken up part of it.
        """
        return self.left + self.torque


@dataclass(frozen=True)
class FormulaResults:
    """What was put into words.

    Attributes:
        formulas: formulas that passed, with numbers; each is one selected effect.
        proofs: each on held-out rows.
        clues: joints for which none did.
    """

    formulas: tuple[SelectedEffect, ...] = ()
    proofs: tuple[HeldOutEffect, ...] = ()
    clues: tuple[Clue, ...] = ()


@dataclass(frozen=True)
class Candidate:
    """One or several columns that may become terms.

    Attributes:
        terms: their texts.
        cost: what they cost a reader.
        columns: whitened, jointly with what explains the rows already, (k, M).
        gram: of them in each block of time, (B, k, k).
        right: their products with the residual in each block, (B, k).
    """

    terms: tuple[str, ...]
    cost: float
    columns: Floats
    gram: Floats
    right: Floats

    @cached_property
    def beta(self) -> Floats:
        """Amplitudes, (k,)."""
        return _solved(self.gram.sum(axis=0), self.right.sum(axis=0))

    @cached_property
    def gains(self) -> Floats:
        """Gain in each block, (B,)."""
        found: Floats = 2 * self.right @ self.beta - np.einsum(
            "k,bkl,l->b", self.beta, self.gram, self.beta
        )
        return found

    @property
    def score(self) -> float:
        """Gain less what its freedom costs (BIC)."""
        return float(self.gains.sum()) - self.penalty

    @property
    def penalty(self) -> float:
        """What its freedom costs (BIC)."""
        return len(self.terms) * float(np.log(self.columns.shape[1]))

    def only(self, chosen: Sequence[int], cost: float) -> Candidate:
        """Return some of its columns as a candidate."""
        k = list(chosen)
        gram = self.gram[:, k][:, :, k]
        return Candidate(
            tuple(self.terms[i] for i in k), cost, self.columns[k], gram, self.right[:, k]
        )


def find_formulas(
    search: EffectSearch, joints: Sequence[int], progress: Progress = SILENT
) -> FormulaResults:
    """Put what is left of joints into words.

    Args:
        search: a search; what it has selected explains part of the rows already.
        joints: joints with more left than noise, 0-based; of many the loudest are looked at.
        progress: told how far the work is.
    """
    found: list[SelectedEffect] = []
    proofs, clues = [], []
    silent = unrepeatable(search)
    loudest = sorted(joints, key=lambda j: -search.after[j])[:JOINTS]
    for k, j in enumerate(loudest):
        progress.advance(k + 1, len(loudest), "formula")
        formula, why = (_growing if j in silent else _formula_of)(search, j, found)
        if formula is None:
            clues.append(_clue(search, j, why))
        else:
            proofs.append(
                held_out_effect(
                    search.problem, [*search.selected, *found], formula, formula.joints[0]
                )
            )
            found.append(formula)
    return FormulaResults(tuple(found), tuple(proofs), tuple(clues))


def _formula_of(
    search: EffectSearch, joint: int, others: Sequence[SelectedEffect]
) -> tuple[SelectedEffect | None, str]:
    """Return the formula of one joint, or why there is none."""
    problem, effects, theta = search.problem, [*search.selected, *others], None
    for _ in range(PASSES):
        regression = with_selected(problem.regression(theta), effects)
        before = float(regression.reduced_chi_square()[joint])
        if before - 1 < NEGLIGIBLE:
            return None, "the other effects leave nothing for a formula"
        rows = screened_rows(regression, joint)
        terms, stable = short_formula(regression, rows)
        if not terms:
            return None, ""
        formula = fitted_formula(problem, effects, formula_text(terms), joint)
        extended = with_selected(regression, [*effects, formula])
        after = float(extended.reduced_chi_square()[joint])
        if after - 1 < NEGLIGIBLE:
            break
        # Why again: without the formula the links took up part of it, and loads were those of wrong links.
        theta = extended.fit.theta[: problem.base.reduction.rank]
    share = 1 - (after - 1) / (before - 1)
    why = _weak_evidence(formula, share, stable, rows.columns) or _unproved(
        problem, effects, formula, joint
    )
    return (None, f"{formula_text(terms)}: {why}") if why else (formula, "")


def _growing(
    search: EffectSearch, joint: int, others: Sequence[SelectedEffect]
) -> tuple[SelectedEffect | None, str]:
    """Return the formula of a joint whose repeats differ, or why there is none.

    What grows with time is all that a repeat does not repeat and a formula can say, and it has to explain most of that.
    What differs between repeats is no noise floor for it, so that comes from high frequencies.
    """
    problem, effects = search.problem, [*search.selected, *others]
    residuals = residuals_of_fit(problem, with_selected(problem.regression(), effects), effects)
    noise = problem.noise.with_joint(
        joint, measure_noise(problem.segments, residuals, (), problem.train)
    )
    formula, why = _formula_of(
        replace(search, problem=replace(problem, noise=noise)), joint, others
    )
    if formula is None or not isinstance(formula.effect, Formula):
        return None, f"{why}; {STRAY}" if why else STRAY
    regression = with_selected(problem.regression(), [*effects, formula])
    left = residuals_of_fit(problem, regression, [*effects, formula])
    ratio = (
        measure_noise(problem.segments, left, problem.repeats, problem.train).floor
        / problem.noise.floor
    )
    if ratio[joint] ** 2 > 1 - SHARE or "t" not in formula.effect.text.split():
        return None, f"{formula.effect.text}: {STRAY}"
    return formula, ""


def _weak_evidence(formula: SelectedEffect, share: float, stable: float, tests: int) -> str:
    """Return why a formula is not believed on the rows that it was found in, or nothing."""
    if share < SHARE:
        return f"explains only {100 * max(share, 0):.0f} % of the rest"
    if stable < STABLE:
        return f"only {100 * stable:.0f} % of the halves of the logs agree on it"
    if formula.test.chow_p_value < CONSTANT:
        return "its size differs between parts of the logs"
    if tests * max(formula.test.p_value, formula.test.gain_p_value) > CHANCE:
        return "it may be an accident"
    return ""


# ---------------------------------------------------------------- choosing
def screened_rows(regression: WhitenedRegression, joint: int) -> FactorRows:
    """Return the products that explain most of a part of the rows of a joint."""
    rows = FactorRows(regression, joint)
    rows.screen(regression)
    return rows


def short_formula(regression: WhitenedRegression, rows: FactorRows) -> tuple[list[str], float]:
    """Return the terms of the best short formula of a joint, and the least share of half logs that agree.

    Args:
        regression: the rows, with what explains part of them already.
        rows: the products that may become terms.
    """
    joint, terms = rows.joint, list[str]()
    stable, fixed = 1.0, list(regression.effects)
    for _ in range(MOST):
        excess = float(regression.reduced_chi_square()[joint]) - 1
        if excess < NEGLIGIBLE:
            break
        exact = [
            one
            for one in leading(regression, rows, terms)
            if len(terms) + len(one.terms) <= LONGEST
        ]
        best = max(exact, key=lambda one: one.score, default=None)
        if best is None or best.score <= 2 * np.log(rows.columns):
            break
        chosen = _shortest(best, exact)
        fixed.append({joint: rows.made(regression, chosen.terms)})
        regression = regression.with_effects(fixed)
        left = float(regression.reduced_chi_square()[joint]) - 1
        agreed = _stability(chosen, exact)
        if terms and (1 - left / excess < MORE or agreed < STABLE):
            break
        stable = min(stable, agreed)
        terms += chosen.terms
    return terms, stable


def _columns(regression: WhitenedRegression, joint: int, formula: Formula) -> Floats:
    columns: Floats = whitened_columns(regression, formula, (joint,), [{}])[joint][0]
    return columns


def leading(
    regression: WhitenedRegression, rows: FactorRows, taken: Sequence[str] = ()
) -> list[Candidate]:
    """Return the leading products, evaluated before the filter: single columns, pairs, and all of a product.

    Args:
        regression: what is left.
        rows: the library on the rows of a joint.
        taken: terms that are there already.
    """
    joint = rows.joint
    Q, e, block = regression.basis(joint), regression.fit.e[joint], regression.joints[joint].block
    starts = np.flatnonzero(np.diff(block, prepend=block[0] - 1))
    found = []
    for factors in rows.best(regression, EXACT):
        terms = [" ".join(form) for form in forms(factors)]
        is_new = [k for k, term in enumerate(terms) if term not in taken]
        if not is_new:
            continue
        C = rows.made(regression, [terms[k] for k in is_new])
        raw = np.einsum("km,km->k", C, C)
        C = C - (C @ Q) @ Q.T
        seen = np.flatnonzero(np.einsum("km,km->k", C, C) > ABSORBED * raw).tolist()
        if not seen:
            continue
        C, terms = C[seen], [terms[is_new[k]] for k in seen]
        gram = np.add.reduceat(np.einsum("km,lm->mkl", C, C), starts)
        right = np.add.reduceat((C * e).T, starts)
        whole = Candidate(tuple(terms), cost_of(factors, len(terms)), C, gram, right)
        sets = [[k] for k in range(len(terms))] + [
            [k, m] for k in range(len(terms)) for m in range(k)
        ]
        found += [
            whole.only(one, cost_of(factors, len(one))) for one in sets if len(one) < len(terms)
        ]
        found.append(whole)
    return found


def _shortest(best: Candidate, others: Sequence[Candidate]) -> Candidate:
    """Return the shortest of those that the best is not clearly better than."""
    equal = []
    for one in others:
        spread = float(np.std(best.gains - one.gains) * np.sqrt(len(one.gains)))
        if one is best or (one.score > 0 and best.score - one.score <= max(EQUAL, SURE * spread)):
            equal.append(one)
    return min(equal, key=lambda one: (one.cost, -one.score))


def _stability(chosen: Candidate, others: Sequence[Candidate]) -> float:
    """Return the share of draws of half the blocks in which the chosen is as good as the best, or looks like it."""
    rng = np.random.default_rng(0)
    count = len(chosen.gains)
    halves = np.zeros((DRAWS, count))
    for half in halves:
        half[rng.permutation(count)[: count // 2]] = 1.0
    scores = np.array([_gains_in(one, halves) - one.penalty for one in others])
    own = _gains_in(chosen, halves) - chosen.penalty
    agree = own > SAME_SHAPE * scores.max(axis=0)
    shape = chosen.beta @ chosen.columns
    size = float(np.linalg.norm(shape))
    for k in np.flatnonzero(~agree):
        other = others[int(np.argmax(scores[:, k]))]
        torque = other.beta @ other.columns
        agree[k] = float(shape @ torque) > SAME_SHAPE * size * float(np.linalg.norm(torque))
    return float(np.mean(agree))


def _gains_in(one: Candidate, draws: Floats) -> Floats:
    """Return the gain of a candidate fitted to the blocks of each draw, (D,)."""
    gram = np.tensordot(draws, one.gram, axes=1)
    right = draws @ one.right
    size = np.sqrt(np.maximum(np.diagonal(gram, axis1=1, axis2=2), 1e-300))
    scaled = gram / (size[:, :, None] * size[:, None, :]) + 1e-6 * np.eye(gram.shape[1])
    gains: Floats = np.einsum(
        "dk,dk->d", right / size, np.linalg.solve(scaled, (right / size)[..., None])[..., 0]
    )
    return gains


def _solved(gram: Floats, right: Floats) -> Floats:
    size = np.sqrt(np.maximum(np.diag(gram), 1e-300))
    found: Floats = (
        np.linalg.solve(gram / np.outer(size, size) + 1e-6 * np.eye(len(size)), right / size) / size
    )
    return found


# ---------------------------------------------------------------- proof
def fitted_formula(
    problem: GapProblem, others: Sequence[SelectedEffect], text: str, joint: int
) -> SelectedEffect:
    """Return a formula with its numbers, fitted jointly with the model and other effects without what is not judged."""
    revolute = [one.revolute for one in problem.base.robot.joints]
    formula = Formula(text, revolute, joint)
    regression = problem.regression(nuisance=False)
    for _ in range(2):
        extended = with_selected(regression, others)
        columns = {joint: _columns(extended, joint, formula)}
        whole = extended.with_effects([*extended.effects, columns])
        regression = problem.regression(
            whole.fit.theta[: problem.base.reduction.rank], nuisance=False
        )
    test = significance_test(extended, columns)
    names = list(formula.amplitudes({}))
    values = dict(zip(names, whole.amplitudes[-len(names) :].tolist(), strict=True))
    errors = dict(
        zip(names, np.sqrt(np.maximum(np.diag(test.covariance), 0.0)).tolist(), strict=True)
    )
    return SelectedEffect(formula, (joint,), {}, test, float(test.gains.sum()), (), values, errors)


def _unproved(
    problem: GapProblem, others: Sequence[SelectedEffect], formula: SelectedEffect, joint: int
) -> str:
    """Return why a formula is not believed on rows that were not fitted, or nothing."""
    before = held_out_squares(problem, others)
    after = held_out_squares(problem, [*others, formula])
    for j, (x, y) in enumerate(zip(before, after, strict=True)):
        low, high, ratio = _ratio(x, y)
        if j == joint and not high < SMALLER:
            return f"changes the error on unseen data by {100 * (low - 1):+.0f} to {100 * (high - 1):+.0f} %"
        if j != joint and low > 1 and ratio > GROWN:
            return f"increases the error of {problem.base.robot.joint_names[j]} on unseen data"
    return ""


def held_out_squares(problem: GapProblem, selected: Sequence[SelectedEffect]) -> list[Floats]:
    """Return sum of squares of the held-out error and number of rows in each block of time, for each joint, (2, B)."""
    held, e, _ = _held_out(problem, selected)
    blocks, use = np.concatenate(jackknife_blocks(held)), np.concatenate([s.use for s in held])
    found = []
    for j in range(e.shape[1]):
        _, at = np.unique(blocks[use[:, j]], return_inverse=True)
        found.append(
            np.array([np.bincount(at, e[use[:, j], j] ** 2), np.bincount(at)], dtype=np.float64)
        )
    return found


def held_out_effect(
    problem: GapProblem, others: Sequence[SelectedEffect], one: SelectedEffect, joint: int
) -> HeldOutEffect:
    """Return what an effect says of the held-out rows of a joint, and what is left there without it.

    Args:
        problem: the rows.
        others: effects that are fitted with the model, and with it.
        one: the effect.
        joint: 0-based joint whose torque is looked at.
    """
    held, residual, _ = _held_out(problem, others)
    _, left, torques = _held_out(problem, [*others, one], one)
    use = np.concatenate([s.use[:, joint] for s in held])
    t = np.concatenate([s.t for s in held])
    torque = torques[:, joint][use]
    robot, quantities = problem.base.robot, {"time [s]": t[use]}
    for j in dict.fromkeys((joint, *one.joints)):
        unit = "rad" if robot.joints[j].revolute else "m"
        name = robot.joints[j].name
        quantities[f"position of {name} [{unit}]"] = np.concatenate([s.q[:, j] for s in held])[use]
        quantities[f"speed of {name} [{unit}/s]"] = np.concatenate([s.qd[:, j] for s in held])[use]
        load = np.concatenate([s.tau[:, j] for s in held])[use]
        quantities[f"torque of {name} [{robot.joints[j].torque_unit}]"] = load
    shares = {name: _follows(x, torque) for name, x in quantities.items()}
    # Why: on seconds of a smooth motion every torque is also one of time.
    shares["time [s]"] -= TIME_LEAD
    follows = max(shares, key=lambda name: shares[name])
    if isinstance(one.effect, Formula) and shares[follows] < FOLLOWS_ONE:
        follows = f"torque that the formula says [{robot.joints[joint].torque_unit}]"
        quantities[follows] = torque
    return HeldOutEffect(
        t[use], residual[:, joint][use], torque, left[:, joint][use], quantities[follows], follows
    )


def _follows(x: Floats, y: Floats) -> float:
    """Return the share of the variance of y, (M,), that lies between bins of equal count over x, (M,)."""
    parts = np.array_split(y[np.argsort(x, kind="stable")], BINS)
    means, counts = (
        np.array([part.mean() for part in parts if len(part)]),
        [len(part) for part in parts if len(part)],
    )
    return (
        float(np.average((means - y.mean()) ** 2, weights=counts) / max(float(y.var()), 1e-30))
        if len(y)
        else 0.0
    )


def _held_out(
    problem: GapProblem, selected: Sequence[SelectedEffect], shown: SelectedEffect | None = None
) -> tuple[list[SegmentRows], Floats, Floats]:
    """Return the segments with held-out rows alone, what effects leave of all rows, and the torque of the last, (M, n).

    Args:
        problem: the rows.
        selected: effects that are fitted with the model to the training rows.
        shown: the last of them, where its torque is wanted.
    """
    regression = fitted_with(problem, selected)
    theta, beta = regression.fit.theta[: problem.segments[0].W.shape[2]], regression.amplitudes
    held = cut(problem.segments, problem.held)
    e, torques = [], []
    for s, row in zip(held, regression.segments, strict=True):
        e.append(s.tau - s.W @ theta - torque_in_rows(row, selected, beta).T)
        if shown is not None:
            own = beta[len(beta) - len(shown.effect.amplitudes(shown.shape)) :]
            torques.append(torque_in_rows(row, [shown], own).T)
    return held, np.concatenate(e), np.concatenate(torques) if torques else np.zeros((0, 0))


def _ratio(before: Floats, after: Floats) -> tuple[float, float, float]:
    """Return the 95 % interval of the ratio of rms values over drawn blocks, and the ratio."""
    if before.shape[1] < 3 or after.shape != before.shape:
        return 0.0, float("inf"), 1.0
    low, high = ratio_interval(before[0], after[0], 0)
    return float(low), float(high), float(np.sqrt(after[0].sum() / max(before[0].sum(), 1e-30)))


# ---------------------------------------------------------------- what is known all the same
def clue_text(clue: Clue, names: Sequence[str]) -> str:
    """Return what is known of a joint, in words."""
    repeats = (
        ""
        if clue.repeats is None
        else f"{100 * clue.repeats:.0f} % of the rest repeats with the motion; "
    )
    near = f"; closest formula {clue.near}" if clue.near else ""
    follows = f"it depends most on {clue.signal} ({100 * clue.share:.0f} % of its power)"
    follows = follows if clue.share > FOLLOWED else "it depends on no single signal"
    return f"{names[clue.joint]}: {repeats}{follows}{near}"


def advice_on_formulas(formula_results: FormulaResults, names: Sequence[str]) -> str:
    """Return what to do where formulas say what no effect of the catalogue explains."""
    described = ", ".join(names[one.joints[0]] for one in formula_results.formulas)
    left = ", ".join(names[clue.joint] for clue in formula_results.clues)
    more = f" The rest on {left} has no formula: see where.png." if left else ""
    return (
        f"No effect of the catalogue explains it, but a formula describes the rest on {described}. If it makes sense, "
        f"add it with --apply formula, then check the result on a new log with dynid validate.{more}"
    )


def _clue(search: EffectSearch, joint: int, why: str) -> Clue:
    """Return what the residual of a joint follows, and whether it repeats."""
    regression = with_selected(search.problem.regression(), search.selected)
    rows, e, noise = regression.joints[joint], regression.fit.e[joint], search.problem.noise
    e = e * noise.count[joint] ** 0.5
    signals = {"t": np.concatenate([s.t for s in regression.segments])[rows.index]}
    near = [k for k in (joint, joint - 1, joint + 1) if 0 <= k < len(regression.joints)]
    for k in near:
        for name, part in (("q", "q"), ("qd", "qd"), ("tau", "tau")):
            signals[f"{name}{k + 1}"] = np.concatenate(
                [getattr(s, part)[:, k] for s in regression.segments]
            )[rows.index]
    shares = {name: _followed(values, e, rows.block) for name, values in signals.items()}
    best = max(shares, key=lambda name: shares[name])
    power = float(np.mean(e**2))
    repeats = max(0.0, 1 - 1 / power) if noise.repeats and power > 0 else None
    return Clue(joint, best, max(0.0, shares[best]), repeats, why)


def _followed(signal: Floats, e: Floats, block: np.ndarray) -> float:
    """Return the share of a residual's power that its mean over parts of a signal's range explains elsewhere."""
    part = np.searchsorted(np.quantile(signal, np.linspace(0, 1, PARTS + 1)[1:-1]), signal)
    left = 0.0
    even = (np.unique(block, return_inverse=True)[1] // 4) % 2 == 0
    for fitted in (even, ~even):
        count = np.maximum(np.bincount(part[fitted], minlength=PARTS), 1)
        mean = np.bincount(part[fitted], e[fitted], PARTS) / count
        left += float(np.sum((e[~fitted] - mean[part[~fitted]]) ** 2))
    return 1 - left / max(float(np.sum(e**2)), 1e-30)
