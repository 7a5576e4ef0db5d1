"""Which names the evidence gives: the best first, all others again beside it, and none that the rest does without."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap import tuning
from dynid.gap.candidates import (
    Candidate,
    candidate,
    candidates_of,
    gains,
    likeness,
    visible_share,
    without_rounding,
)
from dynid.gap.evidence import NONE, Evidence, evidence_of
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.shapes import integrated
from dynid.gap.significance import Key, SignificanceTest, significance_test, whitened_columns
from dynid.gap.sizes import sizes_of
from dynid.gap.stepwise_selection import SelectionOptions, wanted_effects
from dynid.gap.whitened_regression import EffectColumns
from dynid.model.effects.interface import Effect, Floats, Joints
from dynid.progress import Progress

#: Joints whose rest is sized beside an effect that acts on all: those that show it most.
MOST_JOINTS = 3
#: Candidates of one joint that are looked at.
MOST_OF_A_JOINT = 4
#: Log odds behind the first from which shapes are not integrated any more: it cannot come near.
BEHIND = 25.0
#: Rounds of exchanging a name for a better one.
EXCHANGES = 3
#: Effects that are a special case of others, which always fit as well: they are no rivals, and have to win.
SIMPLER = {
    "torque_offset": ("spring", "end_stop", "torque_drift"),
    "coulomb": (
        "presliding_hysteresis",
        "stribeck",
        "position_friction",
        "nonlinear_viscous",
        "warmup_friction",
    ),
    "viscous": ("nonlinear_viscous", "asymmetric_viscous", "warmup_friction"),
}
#: A delay found by moving torques wins by so much evidence.
LATE = 12.0


@dataclass(frozen=True)
class Look:
    """A candidate with the rest sized beside it.

    Attributes:
        candidate: what is looked at.
        shape: its best shape.
        scale: of its prior, in units of the noise.
        log_odds: that it is there, against nothing with a name.
        beside: the evidence without it, the rest sized as with it.
        joints: whose rest was sized.
    """

    candidate: Candidate
    shape: dict[str, float]
    scale: float
    log_odds: float
    beside: Evidence
    joints: tuple[int, ...]

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.candidate.key


@dataclass(frozen=True)
class Named:
    """An effect that explains rows beside all others.

    Attributes:
        effect: the effect, exact at its size.
        joints: where it sits.
        shape: its shape.
        scale: of its prior, in units of the noise.
        log_odds: that it is there.
        rivals: other names with their log odds in its place.
    """

    effect: Effect
    joints: Joints
    shape: dict[str, float]
    scale: float
    log_odds: float
    rivals: tuple[tuple[Key, float], ...] = ()

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.effect.name, self.joints

    @property
    def probability(self) -> float:
        """Posterior probability against what has no name and all rivals."""
        odds = np.array([0.0, self.log_odds, *(x for _, x in self.rivals)])
        weights = np.exp(odds - odds.max())
        return float(weights[1] / weights.sum())

    @property
    def equals(self) -> tuple[Key, ...]:
        """Rivals that are not ruled out."""
        limit = np.log(tuning.AGAINST_OTHERS / (1.0 - tuning.AGAINST_OTHERS))
        return tuple(key for key, x in self.rivals if x > self.log_odds - limit)


def log_odds_of(probability: float) -> float:
    """Return log odds."""
    return float(np.log(probability / (1.0 - probability)))


def contains(wide: Key, narrow: Key) -> bool:
    """Return whether one effect holds the other as a special case at the same place."""
    return wide[1] == narrow[1] and wide[0] in SIMPLER.get(narrow[0], ())


def simplest(looks: Sequence[Look]) -> Look | None:
    """Return the best look, or the special case of it that is not ruled out; None where there are none.

    The same effect with fewer amplitudes is such a case: a line is one of a cubic.
    """
    if not looks:
        return None
    best, limit = looks[0], looks[0].log_odds - log_odds_of(tuning.AGAINST_OTHERS)
    likely = [one for one in looks[1:] if one.log_odds > limit]
    fewer = [one for one in likely if one.key == best.key and _amplitudes(one) < _amplitudes(best)]
    return next(
        (one for one in likely if contains(best.key, one.key)),
        min(fewer, key=_amplitudes, default=best),
    )


def _precision(products: Mapping[int, tuple[Floats, Floats]], strength: Floats) -> Floats:
    """Return the prior precision of amplitudes, (k, k), of columns of so much rms over their prior size, (k,)."""
    return np.asarray(
        likeness(np.sum([own for own, _ in products.values()], axis=0))
        * np.outer(strength, strength)
    )


def _amplitudes(look: Look) -> int:
    return int(look.candidate.rms.shape[1])


def without_rest(evidence: Evidence) -> Evidence:
    """Return evidence in which hardly anything is missing."""
    if "without_rest" not in evidence.__dict__:
        none = {
            j: replace(m, log_rms=np.where(m.missing, np.minimum(m.log_rms, NONE), m.log_rms))
            for j, m in enumerate(evidence.joints)
        }
        evidence.__dict__["without_rest"] = evidence.replaced(none)
    found: Evidence = evidence.__dict__["without_rest"]
    return found


class EvidenceSelection:
    """Names by evidence on one problem.

    Args:
        problem: what is searched.
        options: which effects are tried.
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
        self.named: list[Named] = []
        self.barred: set[Key] = set()
        self.in_place: list[list[Look]] = []
        self.selected: list[SelectedEffect] = []
        self.regression = problem.regression()
        bare = problem.regression(nuisance=False)
        self.first, self.rows = evidence_of(bare, problem.repeats)
        self.evidence, self.added = self.first, list[EffectColumns]()
        self.candidates = self.at_first = self._candidates()
        self.visibility: dict[Key, float] = {}
        for one in self.candidates:
            seen = visible_share(self.first, one, problem.base.reduction.rank)
            self.visibility[one.key] = max(seen, self.visibility.get(one.key, 0.0))

    def _candidates(self) -> list[Candidate]:
        """Return all candidates beside what is named; those that do not scale with the model as they were."""
        old = [c for c in getattr(self, "at_first", []) if not c.effect.needs_model]
        done = {c.key for c in old}
        found = list(old)
        for k, (effect, joints) in enumerate(self.wanted):
            if (effect.name, joints) not in done:
                found += candidates_of(self.rows, [(effect, joints)])
            self.progress.advance(k + 1, len(self.wanted), effect.name)
        at = self.first.width
        for columns in self.added:
            found = [one.beside(columns, at) for one in found]
            at += len(next(iter(columns.values())))
        return found

    def run(self) -> SignificanceTest | None:
        """Search until nothing is sure; returns the test of a delay, which has to be taken out first."""
        sure = log_odds_of(tuning.SURE)
        if self.late is not None and self.late.score > LATE:
            return self.late.test
        likely: Look | None = None
        while len(self.named) < self.options.most:
            best = simplest(self.looks(self.evidence))
            if best is None or best.log_odds < sure:
                likely = best
                break
            if best.key[0] == "torque_delay":
                columns = whitened_columns(self.regression, best.candidate.effect, (), [{}])
                return significance_test(self.regression, {j: C[0] for j, C in columns.items()})
            self._take(best)
            self._exchange(sure)
        self._conclude(likely)
        return None

    # ------------------------------------------------------------ looking
    def looks(self, evidence: Evidence, most: int = tuning.MOST_LOOKS) -> list[Look]:
        """Return the leading candidates beside some evidence, each with the rest sized beside it, the best first."""
        taken = {one.key for one in self.named} | self.barred
        picked: dict[int, float] = {}
        for some, count in ((evidence, most // 2), (without_rest(evidence), most)):
            found = [
                (k, gains(some, one))
                for k, one in enumerate(self.candidates)
                if one.key not in taken
            ]
            order = sorted(found, key=lambda pair: -float(pair[1].log_odds.max()))
            joint: dict[tuple[int, ...], int] = {}
            for k, gain in order:
                place = self.candidates[k].joints[:1]
                if sum(joint.values()) >= count:
                    break
                if (
                    gain.log_odds.max() < tuning.WORTH_A_LOOK
                    or joint.get(place, 0) >= MOST_OF_A_JOINT
                ):
                    continue
                joint[place] = joint.get(place, 0) + 1
                picked.setdefault(k, float(gain.log_odds.max()))
        looks = [self._look(evidence, self.candidates[k]) for k in picked]
        # Why first: a long log is sure of torques that matter to nobody, and they are no rivals of what does.
        looks = [
            one for one in looks if one.log_odds > 0.0 and self._visible(one) >= tuning.MATERIAL
        ]
        top = max((one.log_odds for one in looks), default=0.0)
        exact = [
            self._integrated(evidence, one)
            for one in looks
            if one.log_odds > max(top - BEHIND, 0.0)
        ]
        return sorted(exact, key=lambda one: -one.log_odds)

    def _prior(self, one: Candidate) -> float:
        return -float(np.log(len({c.key for c in self.candidates}) * one.groups))

    def _look(self, evidence: Evidence, one: Candidate) -> Look:
        """Return a candidate with the rest sized beside it, from its best shape beside the rest and without it."""
        found = gains(evidence, one)
        g = int(np.argmax(found.log_odds))
        # Why refined: beside a shape of the grid the rest holds what that one misses, and does the work of the effect.
        _, shape, scale = integrated(without_rest(evidence), self.rows, one, self.added)
        starts = {g: float(found.scale[g])}
        if shape not in one.shapes:
            one = one.and_also(
                candidate(self.rows, one.effect, one.joints, [shape], self.added, keep=True)
            )
        starts.setdefault(one.shapes.index(shape), scale)
        looks = [self._look_from(evidence, one, *start) for start in starts.items()]
        return max(looks, key=lambda look: look.log_odds)

    def _look_from(self, evidence: Evidence, one: Candidate, g: int, scale: float) -> Look:
        """Return a candidate with the rest sized beside one of its shapes."""
        k, t = one.rms.shape[1], evidence.width
        products, rms = one.at(g)
        strength = {
            j: float(np.trace(own) / evidence.joints[j].count) for j, (own, _) in products.items()
        }
        joints = tuple(sorted(strength, key=lambda j: -strength[j])[:MOST_JOINTS])
        precision = _precision(products, rms / scale)
        beside = evidence.with_columns(products, precision).sized(joints).without(t, t + k)
        again = gains(beside, one)
        best = int(np.argmax(again.log_odds))
        odds = (
            beside.log_evidence
            - evidence.log_evidence
            + float(again.log_odds[best])
            + self._prior(one)
        )
        return Look(one, dict(one.shapes[best]), float(again.scale[best]), odds, beside, joints)

    def _integrated(self, evidence: Evidence, look: Look) -> Look:
        """Return a look with the shapes of its effect integrated out."""
        gain, shape, scale = integrated(look.beside, self.rows, look.candidate, self.added)
        odds = look.beside.log_evidence - evidence.log_evidence + gain + self._prior(look.candidate)
        return replace(look, shape=shape, scale=scale, log_odds=odds)

    def _visible(self, look: Look) -> float:
        """Return the visible size of a candidate in units of the noise, beside what is named."""
        one = look.candidate
        found = whitened_columns(self.rows.regression, one.effect, one.joints, [look.shape])
        columns = {j: C[0] for j, C in found.items()}
        return significance_test(self.rows.regression.with_effects(self.added), columns).visible_rms

    # ------------------------------------------------------------ numbers
    def _with_numbers(self, k: int, told: SelectedEffect) -> SelectedEffect:
        """Return an effect with sizes and errors, everything else and its own shape being integrated out."""
        one, effect = self.named[k], self.named[k].effect
        counts = [len(next(iter(columns.values()))) for columns in self.added]
        at = self.first.width + sum(counts[:k])
        others = [columns for i, columns in enumerate(self.added) if i != k]
        beside = self.evidence.without(at, at + counts[k])
        found = sizes_of(beside, self.rows, effect, one.joints, one.shape, others)
        names, sizes = list(effect.amplitudes(one.shape)), found.amplitudes
        power = np.diag(found.covariance)
        seen = power > 0
        z = float(
            np.sqrt(
                sizes[seen] @ np.linalg.solve(found.covariance[np.ix_(seen, seen)], sizes[seen])
            )
        )
        errors = np.where(seen, np.sqrt(power), np.inf)
        return replace(
            told,
            shape=found.shape,
            values=dict(zip(names, sizes.tolist(), strict=True)) | found.shape,
            std_errors=dict.fromkeys(effect.steps, float("inf"))
            | found.shape_errors
            | dict(zip(names, errors.tolist(), strict=True)),
            test=replace(told.test, amplitudes=sizes),
            z=z,
        )

    # ------------------------------------------------------------ names
    def _take(self, look: Look) -> None:
        one = look.candidate
        self.named.append(Named(one.effect, one.joints, look.shape, look.scale, look.log_odds))
        self._rebuild(look.beside)

    def _rebuild(self, sized: Evidence) -> None:
        """Make all columns again with what is named, at the parameters and sizes that go with it."""
        for _ in range(2):
            bare = replace(
                self.first,
                joints=tuple(
                    replace(m, log_rms=s.log_rms, level=s.level)
                    for m, s in zip(self.first.joints, sized.joints, strict=True)
                ),
            )
            bare.__dict__.pop("parts", None)
            evidence, self.added = bare, []
            for one in self.named:
                columns = self._columns(one)
                rms, whole = (
                    self._rms(columns) / one.scale,
                    np.sum([C @ C.T for C in columns.values()], axis=0),
                )
                precision = likeness(whole) * np.outer(rms, rms)
                evidence = evidence.with_columns(self.rows.products(columns, self.added), precision)
                self.added.append(columns)
            touched = sorted({j for columns in self.added for j in columns})
            self.evidence = sized = evidence.sized(touched, level=True)
            if not self._relinearised():
                break
        self.candidates = self._candidates()

    def _relinearised(self) -> bool:
        """Scale what is named with the parameters and sizes that were found; returns whether that changes a column."""
        theta = self.evidence.estimate
        p, t = self.problem.base.reduction.rank, self.first.width
        bare = self.problem.regression(theta[:p], nuisance=False)
        self.rows = replace(self.rows, regression=bare)
        self.regression = self.problem.regression(theta[:p])
        before = [one.effect for one in self.named]
        at = t
        for k, one in enumerate(self.named):
            names = list(one.effect.amplitudes(one.shape))
            sizes = dict(zip(names, theta[at : at + len(names)].tolist(), strict=True))
            at += len(names)
            self.named[k] = replace(one, effect=one.effect.at_size(sizes))
        effects = {one.key: one.effect for one in self.named}
        self.wanted = [
            (effects.get((effect.name, joints), effect), joints) for effect, joints in self.wanted
        ]
        return any(effect.needs_model for effect in before)

    def _columns(self, one: Named) -> EffectColumns:
        found = without_rounding(
            whitened_columns(self.rows.regression, one.effect, one.joints, [one.shape])
        )
        return {j: C[0] for j, C in found.items() if C.any()}

    def _rms(self, columns: EffectColumns) -> Floats:
        rms = np.max([np.sqrt(np.mean(C**2, axis=1)) for C in columns.values()], axis=0)
        return np.asarray(np.where(rms > 0, rms, 1.0))

    def _without(self, k: int) -> Evidence:
        """Return the evidence without one name, the rest of its joints sized again."""
        counts = [len(next(iter(columns.values()))) for columns in self.added]
        first = self.first.width + sum(counts[:k])
        return self.evidence.without(first, first + counts[k]).sized(
            sorted(self.added[k])[:MOST_JOINTS]
        )

    def _in_place_of(self, k: int) -> list[Look]:
        """Return what explains the rows in place of one name, itself included."""
        others = [one for i, one in enumerate(self.named) if i != k]
        names, added, evidence, candidates = self.named, self.added, self.evidence, self.candidates
        without = self._without(k)
        try:
            self.named, self.added, self.evidence = (
                others,
                [x for i, x in enumerate(added) if i != k],
                without,
            )
            first = self.first.width + sum(len(next(iter(x.values()))) for x in added[:k])
            last = first + len(next(iter(added[k].values())))
            self.candidates = [one.without(first, last) for one in candidates]
            found = self.looks(without)
            if all(look.key != names[k].key for look in found):
                own = [c for c in self.candidates if c.key == names[k].key]
                found += [self._integrated(without, self._look(without, c)) for c in own]
            return sorted(found, key=lambda one: -one.log_odds)
        finally:
            self.named, self.added, self.evidence, self.candidates = (
                names,
                added,
                evidence,
                candidates,
            )

    def _exchange(self, sure: float) -> None:
        """Exchange names for better ones, and drop those that the others do without."""
        for _ in range(EXCHANGES):
            self.in_place = []
            for k, one in enumerate(self.named):
                self.in_place.append(self._in_place_of(k))
                best = simplest(self.in_place[k])
                if best is None or best.log_odds < sure:
                    self.barred.add(one.key)
                    del self.named[k]
                    self._rebuild(self.evidence)
                    break
                if best.key != one.key and best.key[0] != "torque_delay":
                    c = best.candidate
                    self.named[k] = Named(c.effect, c.joints, best.shape, best.scale, best.log_odds)
                    self._rebuild(self.evidence)
                    break
            else:
                return

    def _conclude(self, likely: Look | None) -> None:
        """Find the probability of each name and its rivals, and test it as it is told."""
        for k, one in enumerate(self.named):
            looks = (
                self.in_place[k] if len(self.in_place) == len(self.named) else self._in_place_of(k)
            )
            own = next(look for look in looks if look.key == one.key)
            beside = {c.key: float(gains(self.evidence, c).log_odds.max()) for c in self.candidates}
            rivals = tuple(
                (look.key, look.log_odds)
                for look in looks
                if look.key != one.key
                and not contains(look.key, one.key)
                and beside.get(look.key, 0.0) < tuning.INSTEAD * look.log_odds
            )
            self.named[k] = replace(one, log_odds=own.log_odds, rivals=rivals)
        found = list(self.named)
        if (
            likely is not None
            and likely.log_odds > log_odds_of(tuning.LIKELY)
            and likely.key[0] != "torque_delay"
        ):
            c = likely.candidate
            found.append(Named(c.effect, c.joints, likely.shape, likely.scale, likely.log_odds))
        self.named, self.barred = found, set()
        if likely is not None:
            self._rebuild(likely.beside)
        found = list(self.named)
        columns = [self._columns(one) for one in found]
        for k, one in enumerate(found):
            rest = self.rows.regression.with_effects([x for i, x in enumerate(columns) if i != k])
            test = significance_test(rest, columns[k])
            told = SelectedEffect(
                one.effect,
                one.joints,
                one.shape,
                test,
                2.0 * one.log_odds,
                one.equals,
                probability=one.probability,
            )
            self.selected.append(self._with_numbers(k, told))
        self.regression = self.regression.with_effects(columns)
