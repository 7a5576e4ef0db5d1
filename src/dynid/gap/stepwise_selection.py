"""Stepwise selection: add the candidate with the most evidence, drop what it makes superfluous, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap.possible_arm import COUNTERBALANCE, LEAST_GAIN, imitated_counterbalances, least_gain
from dynid.gap.problem import GapProblem, held_near_possible
from dynid.gap.selected_effects import SelectedEffect, at_sizes, stepped
from dynid.gap.significance import (
    CandidateScore,
    EffectCandidate,
    Key,
    SignificanceTest,
    candidate_of,
    candidates_at,
    score_candidate,
    significance_test,
    whitened_columns,
)
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Effect, Floats, Joints
from dynid.progress import Progress

Ranking = list[tuple[CandidateScore, EffectCandidate]]

#: Smallest visible size in units of the noise: below, wrong names are as likely as right ones.
SMALLEST = 0.3
#: The chance of a false name is divided over at least so many candidates.
FEWEST_TESTS = 150
#: Names whose evidence differs by less are equally good: in score, 12 is a chance of one in four hundred; and in
#: units of the difference's own spread over blocks of time (Vuong 1989), which is what 12 comes to when all that is
#: left is noise, and more when what is left is what the model lacks.
EQUAL, SURE = 12.0, 1.73
#: Chance of what further freedom explains, below which it is of use.
BY_CHANCE = 0.05
#: Effects that are a simpler special case of others, which then have to be better by more than ``EQUAL``.
SIMPLER = {
    "torque_offset": ("spring", "end_stop", "torque_drift"),
    "coulomb": ("presliding_hysteresis", "stribeck"),
}
#: Candidates that are refined before they are compared: refinement moves the order by a few places, and costs time.
RIVALS = 6
#: A rival has at least this share of an effect's evidence, and loses all but this share of its gain with it: what
#: explains something else is no rival.
NEAR, INSTEAD = 0.7, 0.5
#: Steps of the refinement of a shape, in shares of its first step; it ends early where there is little to gain: what a
#: large effect leaves when its shape is a little off would be taken for a second effect.
REFINED = (1.0, 0.5, 0.25, 0.25, 0.12, 0.06, 0.03, 0.015)
SETTLED = 100.0
#: Candidates that scale with the model stay as they are while its torques change by less than this share on each joint.
SAME_MODEL = 0.02
#: Fits of effects that are not in proportion to their size, one after the other, before the search goes on.
TWICE = 2


@dataclass(frozen=True)
class SelectionOptions:
    """What is searched.

    Attributes:
        effects: identifiers; all when empty.
        joints: 0-based joints; all when empty.
        false_alarm: chance of naming something on logs that hold nothing.
        most: largest number of effects that are added.
        also: further effects at their joints that are tried, whatever is asked.
    """

    effects: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()
    false_alarm: float = 0.01
    most: int = 3
    also: tuple[Key, ...] = ()


class StepwiseSelection:
    """Greedy addition with backward elimination on one problem.

    Args:
        problem: what is searched.
        options: which effects are tried, and how sure they must be.
        progress: told how far the work is.
        delay: whether a delay is tried.
        late: a delay that was found by moving the torques, where that is of use.
    """

    def __init__(
        self,
        problem: GapProblem,
        options: SelectionOptions,
        progress: Progress,
        *,
        delay: bool,
        late: SelectedEffect | None = None,
    ) -> None:
        self.problem, self.options, self.progress = problem, options, progress
        self.wanted = wanted_effects(problem, options, delay=delay)
        self.late = (
            late if any(effect.name == "torque_delay" for effect, _ in self.wanted) else None
        )
        self.selected: list[SelectedEffect] = []
        self.barred: set[Key] = set()
        self.visibility: dict[Key, float] = {}
        self._columns: dict[tuple[Key, tuple[tuple[str, float], ...]], dict[int, Floats]] = {}
        self.regression = problem.regression()
        self._scaled_with, self._stale = problem.theta, False
        self.candidates = self._candidates()

    def _candidates(self, old: Sequence[EffectCandidate] = ()) -> list[EffectCandidate]:
        """Make all candidates; those that do not depend on the model are taken from the old ones."""
        made = [c for c in old if not c.effect.needs_model]
        done = {c.key for c in made}
        for k, (effect, joints) in enumerate(self.wanted):
            if (effect.name, joints) not in done:
                made += candidates_at(self.regression, effect, joints)
            self.progress.advance(k + 1, len(self.wanted), f"{effect.name}")
        return made

    def run(self) -> SignificanceTest | None:
        """Search until nothing passes; returns the test of a delay, which has to be taken out first."""
        while len(self.selected) < self.options.most:
            best = self._best()
            # Why only now: to make candidates again takes longer than all else, and most searches end here.
            if (
                best is not None
                and (best.effect.needs_model or self.selected)
                and self._refreshed()
            ):
                best = self._best()
            late = None if self.selected else self.late
            if (
                late is not None
                and self._passes(late)
                and (best is None or late.score > best.score)
            ):
                best = late
            if best is None:
                break
            if best.effect.name == "torque_delay":
                return best.test
            self._select([*self.selected, best])
            self._eliminate()
            self._relinearise()
        self._note_rivals()
        return None

    def _ranked(self, regression: WhitenedRegression, skip: Sequence[SelectedEffect]) -> Ranking:
        """Return all other candidates that are not barred, the one with the largest score first."""
        taken = self.barred | {one.key for one in skip}
        found: Ranking = []
        for candidate in self.candidates:
            if candidate.key not in taken:
                found.append((score_candidate(regression, candidate), candidate))
        return sorted(found, key=lambda pair: -pair[0].score)

    def _best(self) -> SelectedEffect | None:
        """Return the strongest candidate that passes the tests.

        Where the strongest on a joint is large but not sure, weaker ones there would only stand in for it.
        """
        balanced = self._most_plausible()
        if balanced is not None:
            return balanced
        ranked = self._ranked(self.regression, self.selected)
        if not self.visibility:
            for score, c in ranked:
                self.visibility[c.key] = max(score.visibility, self.visibility.get(c.key, 0.0))
        unclear: set[int] = set()
        while True:
            clear = [
                (score, c)
                for score, c in ranked
                if score.score > 0 and not unclear & set(c.joints[:1])
            ]
            refined = [self._refined(self.regression, score, c) for score, c in clear[:RIVALS]]
            leading = sorted(
                (one for one in refined if one.test.joint not in unclear),
                key=lambda one: -one.score,
            )
            for one in leading:
                if self._passes(one):
                    if not self._possible_absorbs(one):
                        return self._simplest(one, leading)
                    self.barred.add(one.key)
                    continue
                if one.test.visible_rms >= SMALLEST:
                    unclear.add(one.test.joint)
                    break
            else:
                if not any(one.key in self.barred for one in leading):
                    return None
                ranked = [(score, c) for score, c in ranked if c.key not in self.barred]

    def _most_plausible(self) -> SelectedEffect | None:
        """Return the counterbalance without which links are least plausible, where they imitate it and none would do.

        Why not by its score: the parabola of the prior is wide, and knows nothing of where possible links end.
        """
        if self.problem.arm is None:
            return None
        found = []
        for joint, columns in imitated_counterbalances(self.regression, self.problem.base).items():
            key = COUNTERBALANCE, (joint,)
            place = next(
                (c for c in self.candidates if c.key == key and key not in self.barred), None
            )
            if place is not None and key not in {one.key for one in self.selected}:
                test = significance_test(self.regression, columns)
                one = SelectedEffect(place.effect, place.joints, dict(place.shapes[0]), test, 0.0)
                self._columns[_form(one)] = dict(columns)
                found.append(replace(one, score=self._worth(self.regression, one)))
        best = max(found, key=lambda one: one.score, default=None)
        return best if best is not None and best.score >= LEAST_GAIN else None

    def _exact(self, one: SelectedEffect) -> bool:
        """Return whether an effect is judged by exact fits of possible links."""
        return self.problem.arm is not None and one.name == COUNTERBALANCE

    def _worth(self, regression: WhitenedRegression, one: SelectedEffect) -> float:
        """Return how much an effect brings jointly with possible links, exactly fitted, after its price."""
        assert self.problem.arm is not None
        gain = least_gain(regression, self.problem.arm, self._columns_of(one))
        return gain - one.freedom * float(np.log(sum(len(e) for e in regression.fit.e)))

    def _possible_absorbs(self, one: SelectedEffect) -> bool:
        """Return whether a possible arm, exactly fitted, absorbs an effect, for some masses of the prior's links."""
        if self.problem.arm is None or one.effect.name == "torque_delay":
            return False
        return self._worth(self.regression, one) < LEAST_GAIN

    def _simplest(self, best: SelectedEffect, others: Sequence[SelectedEffect]) -> SelectedEffect:
        """Return what has the least freedom among those that the best is not clearly better than."""
        here = [one for one in others if one.test.joint == best.test.joint]
        good = [
            one
            for one in here
            if one is best or (not clearly_better(best, one) and self._passes(one))
        ]
        return min(good, key=lambda one: (one.freedom, -one.score))

    def _passes(self, one: SelectedEffect) -> bool:
        """Return whether an effect explains more than its freedom costs, is large enough and significant."""
        tests = max(FEWEST_TESTS, len({c.key for c in self.candidates}))
        tests *= one.effect.trials
        p_value = tests * max(one.test.p_value, one.test.gain_p_value)
        return (
            one.score > 0
            and one.test.visible_rms >= SMALLEST
            and p_value < self.options.false_alarm
        )

    def _refined(
        self, regression: WhitenedRegression, score: CandidateScore, candidate: EffectCandidate
    ) -> SelectedEffect:
        """Return the candidate at its best shape, refined off the grid."""
        found, columns = refined(regression, score, candidate)
        self._columns[_form(found)] = columns
        return found

    def _columns_of(self, one: SelectedEffect) -> dict[int, Floats]:
        form = _form(one)
        if form not in self._columns:
            columns = whitened_columns(self.regression, one.effect, one.joints, [one.shape])
            self._columns[form] = {j: C[0] for j, C in columns.items()}
        return self._columns[form]

    def _with(self, selected: Sequence[SelectedEffect]) -> WhitenedRegression:
        return self.regression.with_effects([self._columns_of(one) for one in selected])

    def _select(self, selected: Sequence[SelectedEffect]) -> None:
        self.selected = list(selected)
        self.regression = self._with(self.selected)

    def _eliminate(self) -> None:
        """Drop what is no longer needed; a dropped name is barred, otherwise the search need not end."""
        while len(self.selected) > 1:
            tested, failing = [], []
            for old in self.selected:
                rest = self._with([other for other in self.selected if other is not old])
                one = replace(old, test=significance_test(rest, self._columns_of(old)))
                tested.append(one)
                if not (
                    self._worth(rest, one) >= LEAST_GAIN if self._exact(one) else self._passes(one)
                ):
                    failing.append(one)
            self.selected = tested
            if not failing:
                return
            worst = min(failing, key=lambda one: one.test.visible_rms)
            self.barred.add(worst.key)
            self._select([one for one in tested if one is not worst])

    def _relinearise(self) -> None:
        """Scale what is selected with new parameters and sizes, and hold these near the arm that is possible now."""
        self.problem = held_near_possible(self.problem, self.regression)
        for _ in range(TWICE):
            theta = self.regression.fit.theta[: self.problem.base.reduction.rank]
            self._stale = change_of_torques(self.regression, self._scaled_with, theta) > SAME_MODEL
            self.regression = self.problem.regression(theta)
            self._columns = {}
            self._select(self.selected)
            exact = at_sizes(self.selected, self.regression.amplitudes)
            if all(new.effect == old.effect for new, old in zip(exact, self.selected, strict=True)):
                return
            self._keep_exact(exact)

    def _keep_exact(self, exact: Sequence[SelectedEffect]) -> None:
        """Make the columns of selected effects at their sizes, where they are not in proportion to these.

        Why of the candidates too: what is left to the first order would be taken for a companion, or for another name.
        """
        effects = {one.key: one.effect for one in exact}
        self.wanted = [
            (effects.get((effect.name, joints), effect), joints) for effect, joints in self.wanted
        ]
        self.candidates = [c for c in self.candidates if c.effect == effects.get(c.key, c.effect)]
        made = {c.key for c in self.candidates}
        for effect, joints in self.wanted:
            if (effect.name, joints) not in made:
                self.candidates += candidates_at(self.regression, effect, joints)
        self._columns = {}
        self._select(exact)

    def _refreshed(self) -> bool:
        """Scale candidates with the parameters as they are now; returns whether that changes any."""
        if not self._stale:
            return False
        self._stale = False
        self._scaled_with = self.regression.fit.theta[: self.problem.base.reduction.rank]
        self.candidates = self._candidates(self.candidates)
        return True

    def _note_rivals(self) -> None:
        """Note for each selected effect what would explain as much in its stead."""
        for k, selected in enumerate(self.selected):
            rest = [one for one in self.selected if one is not selected]
            regression = self._with(rest)
            ranked = self._ranked(regression, rest)
            own = next(
                (self._refined(regression, s, c) for s, c in ranked if c.key == selected.key),
                selected,
            )
            near = [
                (s, c) for s, c in ranked if c.key != selected.key and s.score > NEAR * own.score
            ]
            if any(c.effect.needs_model for _, c in near) and self._refreshed():
                ranked = self._ranked(regression, rest)
                near = [
                    (s, c)
                    for s, c in ranked
                    if c.key != selected.key and s.score > NEAR * own.score
                ]
            near = [
                (s, c)
                for s, c in near
                if score_candidate(self.regression, c).gain < INSTEAD * s.gain
            ][:RIVALS]
            refined = [self._refined(regression, s, c) for s, c in near]
            rivals = tuple(
                r.key for r in refined if not told_apart(own, r) and not contains(r, own)
            )
            # Why not own: another form may have as much evidence, but the regression holds the columns of this one.
            self.selected[k] = replace(selected, score=own.score, rivals=rivals)


def change_of_torques(regression: WhitenedRegression, before: Floats, after: Floats) -> float:
    """Return the largest share by which other base parameters, (p,) each, change the torques of any joint (rms)."""
    power = np.zeros((2, len(regression.joints)))
    for s in regression.segments:
        for k, theta in enumerate((after - before, before)):
            power[k] += np.sum(np.where(s.use, s.W[..., : len(theta)] @ theta, 0.0) ** 2, axis=0)
    return float(np.sqrt(np.max(power[0] / np.maximum(power[1], 1e-300))))


def _form(one: SelectedEffect) -> tuple[Key, tuple[tuple[str, float], ...]]:
    return one.key, tuple(sorted(one.shape.items()))


def refined(
    regression: WhitenedRegression, score: CandidateScore, candidate: EffectCandidate
) -> tuple[SelectedEffect, dict[int, Floats]]:
    """Return a candidate at its best shape, refined off the grid, and its whitened columns, {joint: (k, M_j)}."""
    effect, gain, shape = candidate.effect, score.gain, dict(candidate.shapes[score.index])
    columns = {j: C[score.index] for j, C in candidate.columns.items()}
    for factor in REFINED if effect.steps else ():
        tried = [
            shape | {name: stepped(shape[name], kind, size, sign * factor)}
            for name, (kind, size) in effect.steps.items()
            for sign in (-1, 1)
        ]
        near = candidate_of(regression, effect, candidate.joints, tried)
        better = score_candidate(regression, near)
        if better.gain > gain:
            gain, shape = better.gain, tried[better.index]
            columns = {j: C[better.index] for j, C in near.columns.items()}
        elif gain < SETTLED / factor:
            break
    test = significance_test(regression, columns)
    return SelectedEffect(effect, candidate.joints, shape, test, gain - score.penalty), columns


def clearly_better(one: SelectedEffect, other: SelectedEffect) -> bool:
    """Return whether one effect explains the rows better than another beyond doubt."""
    lead = one.score - other.score
    if len(one.test.gains) != len(other.test.gains):
        return lead > EQUAL
    spread = np.std(one.test.gains - other.test.gains) * np.sqrt(len(one.test.gains))
    return bool(lead > max(EQUAL, SURE * spread))


def told_apart(one: SelectedEffect, rival: SelectedEffect) -> bool:
    """Return whether an effect is clearly better than a rival, and not for its smaller freedom alone.

    A rival whose further freedom explains more than chance would is not refuted by the price of that freedom.
    """
    from scipy import special

    more = rival.freedom - one.freedom
    gained = rival.test.gain - one.test.gain
    if more > 0 and special.chdtrc(more, max(gained, 0.0)) < BY_CHANCE:
        return False
    return clearly_better(one, rival)


def contains(wide: SelectedEffect, narrow: SelectedEffect) -> bool:
    """Return whether one effect holds the other as a special case on the same joint, and so always fits as well."""
    return wide.joints == narrow.joints and wide.effect.name in SIMPLER.get(narrow.effect.name, ())


def wanted_effects(
    problem: GapProblem, options: SelectionOptions, *, delay: bool = True
) -> list[tuple[Effect, Joints]]:
    """Return every effect that is worth a look, with every joint, pair of joints or arm that it may sit on.

    Args:
        problem: what is searched.
        options: which effects are tried, and where.
        delay: whether a delay is tried.
    """
    use = "frozen" if problem.since else "refit" if problem.arm is None else "arm"
    moves = np.sum([s.use.sum(axis=0) for s in problem.segments], axis=0) > 0
    return [
        (effect, joints)
        for effect in CATALOGUE.values()
        if delay or effect.name != "torque_delay"
        for joints in effect.candidate_joints(problem.base.robot.n)
        if (use in effect.uses or (effect.name, joints) in options.also)
        if not options.effects or effect.name in options.effects
        if not joints or ((not options.joints or joints[0] in options.joints) and moves[joints[0]])
        if not _in_model(effect, joints, problem)
    ]


def _in_model(effect: Effect, joints: Joints, problem: GapProblem) -> bool:
    """Return whether the baseline has it already, or has not what should have changed."""
    if not joints:
        return False
    joint = problem.base.robot.joints[joints[0]]
    refit = not problem.since
    has = {
        "torque_offset": refit and "offset" in joint.friction,
        "viscous": "viscous" in joint.friction,
        "coulomb": "coulomb" in joint.friction,
        "motor_inertia": refit and joint.motor_inertia,
        "coulomb_change": "coulomb" not in joint.friction,
        "viscous_change": "viscous" not in joint.friction,
    }
    return has.get(effect.name, False)
