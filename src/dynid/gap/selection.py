"""Which names the evidence gives: the best first, all others again beside it, and none that the rest does without."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import chdtrc

from dynid.gap import tuning
from dynid.gap.candidates import (
    Candidate,
    Place,
    SelectionOptions,
    candidate,
    candidates_of,
    gains,
    places_of,
    prior_precision,
    visible_share,
)
from dynid.gap.evidence import Evidence, EvidenceRows, evidence_of
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import Key, SelectedEffect
from dynid.gap.shapes import integrated
from dynid.gap.sizes import sizes_of
from dynid.gap.whitened_regression import EffectColumns
from dynid.model.effects.interface import Floats
from dynid.progress import Progress

#: Joints whose rest is sized beside an effect that acts on all: those that show it most.
MOST_JOINTS = 4
#: Log odds behind the first from which shapes are not integrated any more: it cannot come near.
BEHIND = 25.0
#: Rounds of exchanging a name for a better one, and most names, what always was included.
EXCHANGES, MOST_NAMES = 3, 12
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


@dataclass(frozen=True)
class Look:
    """A candidate with the rest sized beside it.

    Attributes:
        candidate: what is looked at.
        shape: its best shape.
        scale: of its prior, in units of the noise.
        log_odds: that it is there, against nothing with a name.
        beside: the evidence without it, the rest sized as with it.
        visible: its largest visible size, in units of the noise.
    """

    candidate: Candidate
    shape: dict[str, float]
    scale: float
    log_odds: float
    beside: Evidence
    visible: float = 0.0

    @property
    def place(self) -> Place:
        """The effect and where it sits."""
        return self.candidate.place

    @property
    def amplitudes(self) -> int:
        """How many amplitudes it has."""
        return int(self.candidate.rms.shape[1])


@dataclass(frozen=True)
class Named:
    """An effect that explains rows beside all others.

    Attributes:
        place: the effect, exact at its size, and where it sits.
        shape: its shape.
        scale: of its prior, in units of the noise.
        log_odds: that it is there.
        rivals: other names with their log odds in its place.
    """

    place: Place
    shape: dict[str, float]
    scale: float
    log_odds: float
    rivals: tuple[tuple[Place, float], ...] = ()

    @classmethod
    def of(cls, look: Look) -> Named:
        """Return what was looked at as a name."""
        return cls(look.place, look.shape, look.scale, look.log_odds)

    @property
    def probability(self) -> float:
        """Posterior probability against what has no name and all rivals."""
        odds = np.array([0.0, self.log_odds, *(x for _, x in self.rivals)])
        weights = np.exp(odds - odds.max())
        return float(weights[1] / weights.sum())

    @property
    def equals(self) -> tuple[Place, ...]:
        """Rivals that are not ruled out."""
        limit = self.log_odds - log_odds_of(tuning.AGAINST_OTHERS)
        return tuple(place for place, x in self.rivals if x > limit)


@dataclass(frozen=True)
class State:
    """What is named, and everything beside it.

    Attributes:
        named: the names.
        added: their columns.
        evidence: with them, sized.
        rows: the rows, effects scaled with the parameters that go with the names.
        candidates: all that may be named beside them.
    """

    named: tuple[Named, ...]
    added: tuple[EffectColumns, ...]
    evidence: Evidence
    rows: EvidenceRows
    candidates: tuple[Candidate, ...]

    @property
    def told(self) -> int:
        """How many names are told: all but what always was, where it is asked what has changed."""
        return sum(not one.place.always for one in self.named)

    def columns(self, k: int) -> slice:
        """Return where the columns of one name are among T."""
        counts = [len(next(iter(one.values()))) for one in self.added]
        first = self.evidence.base + sum(counts[:k])
        return slice(first, first + counts[k])

    def without(self, k: int) -> State:
        """Return the state without one name, the rest sized again."""
        part = self.columns(k)
        bare = self.evidence.without(part.start, part.stop)
        return replace(
            self,
            named=self.named[:k] + self.named[k + 1 :],
            added=self.added[:k] + self.added[k + 1 :],
            evidence=bare.sized(range(len(bare.joints))),
            candidates=tuple(one.without(part.start, part.stop) for one in self.candidates),
        )


@dataclass(frozen=True)
class Selection:
    """What was chosen.

    Attributes:
        state: names with everything beside them, the one that is likely included.
        selected: the names of it that are told, with numbers.
        late: how late torques are jointly with the names; None where it is not tried.
        late_first: whether that is the best name, and has to be taken out first.
        visibility: largest visible share of each candidate.
    """

    state: State
    selected: list[SelectedEffect]
    late: SelectedEffect | None
    late_first: bool
    visibility: dict[Key, float]


def log_odds_of(probability: float) -> float:
    """Return log odds."""
    return float(np.log(probability / (1.0 - probability)))


def contains(wide: Place, narrow: Place) -> bool:
    """Return whether one effect holds the other as a special case at the same place."""
    same = wide.joints == narrow.joints and wide.always == narrow.always
    return same and wide.effect.name in SIMPLER.get(narrow.effect.name, ())


def simplest(looks: Sequence[Look], sure: float) -> Look | None:
    """Return what is taken of looks, the best first; None where there are none.

    Of sure ones on its joint that the best does not rule out, that is the one that explains most; then the special case
    of it that is not ruled out. The same effect with fewer amplitudes is such a case: a line is one of a cubic.
    """
    if not looks:
        return None
    limit = looks[0].log_odds - log_odds_of(tuning.AGAINST_OTHERS)
    likely = [one for one in looks if one.log_odds > limit]
    here = [x for x in likely if x.place.joints[:1] == likely[0].place.joints[:1]]
    best = max([likely[0], *(x for x in here if x.log_odds > sure)], key=lambda x: x.visible)
    sure_ones = [one for one in likely if one.log_odds > min(sure, best.log_odds)]
    fewer = [x for x in sure_ones if x.place.at == best.place.at and x.amplitudes < best.amplitudes]
    return next(
        (one for one in sure_ones if contains(best.place, one.place)),
        min(fewer, key=lambda one: one.amplitudes, default=best),
    )


def select(
    problem: GapProblem, options: SelectionOptions, progress: Progress, *, delay: bool
) -> Selection:
    """Return the names that the evidence gives on one problem.

    Args:
        problem: what is searched.
        options: which effects are tried.
        progress: told how far the work is.
        delay: whether a delay is tried.
    """
    return _Search(problem, options, progress, delay=delay).run()


class _Search:
    def __init__(
        self, problem: GapProblem, options: SelectionOptions, progress: Progress, *, delay: bool
    ) -> None:
        self.problem, self.options, self.progress = problem, options, progress
        self.places = places_of(problem, options, delay=delay)
        self.first, self.rows = evidence_of(problem.regression(nuisance=False), problem.repeats)
        self.made: dict[tuple[tuple[Key, bool], float], list[Candidate]] = {}
        self.instead: list[list[Look]] = []
        self.start = State((), (), self.first, self.rows, self._candidates(self.rows, ()))
        there = {c.place.at for c in self.start.candidates}
        self.places_of = Counter(name for (name, _), _ in there)

    def _candidates(
        self, rows: EvidenceRows, added: Sequence[EffectColumns]
    ) -> tuple[Candidate, ...]:
        """Return all candidates beside what is named, each made once, and again at a size that it was found to have."""
        found = []
        for k, place in enumerate(self.places):
            key = place.at, place.effect.at
            if key not in self.made:
                self.made[key] = candidates_of(rows, place)
            found += self.made[key]
            self.progress.advance(k + 1, len(self.places), place.effect.name)
        at = self.first.width
        for columns in added:
            found = [one.beside(rows, columns, at) for one in found]
            at += len(next(iter(columns.values())))
        return tuple(found)

    def run(self) -> Selection:
        """Search until nothing is sure."""
        sure, barred = log_odds_of(self.options.sure), set[tuple[Key, bool]]()
        state, likely = self.start, None
        visibility: dict[Key, float] = {}
        for one in state.candidates:
            seen = visible_share(self.first, one, self.problem.base.reduction.rank)
            visibility[one.place.key] = max(seen, visibility.get(one.place.key, 0.0))
        while state.told < self.options.most and len(state.named) < MOST_NAMES:
            best = simplest(self.looks(state, barred), sure)
            if best is None or best.log_odds < sure:
                likely = best
                break
            if best.place.effect.name == "torque_delay":
                return Selection(state, [], self._late(state, best), True, visibility)
            state = self._built([*state.named, Named.of(best)], best.beside)
            state = self._exchanged(state, sure, barred)
        late = next((c for c in state.candidates if c.place.effect.name == "torque_delay"), None)
        small = (
            None if late is None else self._late(state, Look(late, {}, 1.0, 0.0, state.evidence))
        )
        state = self._with_rivals(state, likely)
        told = [self._told_as(state, k) for k, x in enumerate(state.named) if not x.place.always]
        return Selection(state, told, small, False, visibility)

    # ------------------------------------------------------------ looking
    def looks(
        self, state: State, barred: set[tuple[Key, bool]], own: Key | None = None
    ) -> list[Look]:
        """Return the leading candidates, each with the rest sized beside it, the best first.

        Args:
            state: what they stand beside.
            barred: what is no longer looked at.
            own: what is looked at in any case.
        """
        taken = {one.place.at for one in state.named} | barred
        open_ = [one for one in state.candidates if one.place.at not in taken]
        picked: dict[int, None] = {k: None for k, one in enumerate(open_) if one.place.key == own}
        evidence = state.evidence
        for some in (evidence, evidence.with_half, evidence.without_rest):
            odds = np.array([gains(some, one).log_odds.max() for one in open_])
            for k in np.argsort(-odds, kind="stable")[: tuning.MOST_LOOKS].tolist():
                if odds[k] >= tuning.WORTH_A_LOOK:
                    picked.setdefault(k)
        looks = [one for k in picked if (one := self._look(state, open_[k])).log_odds > 0.0]
        looks = [replace(one, visible=max(self._visible(state, one).values())) for one in looks]
        # Why first: a long log is sure of torques that matter to nobody, and they are no rivals of what does.
        looks = [one for one in looks if one.visible >= tuning.MATERIAL]
        top = max((one.log_odds for one in looks), default=0.0)
        exact = [
            self._integrated(state, one) for one in looks if one.log_odds > max(top - BEHIND, 0.0)
        ]
        return sorted(exact, key=lambda one: -one.log_odds)

    def _prior(self, one: Candidate) -> float:
        name = one.place.effect.name
        # Why by effect: one that may sit in forty places is as likely in all of them as one that sits in one.
        ways = len(self.places_of) * self.places_of[name] * one.groups
        changed = self.problem.since and not one.place.always
        far = name == "torque_crosstalk" and abs(np.diff(one.place.joints)[0]) > 1
        return tuning.CHANGES.get(name, 0.0) * changed - tuning.FAR * far - float(np.log(ways))

    def _look(self, state: State, one: Candidate) -> Look:
        """Return a candidate with the rest sized beside it, from its best shape beside the rest and without it."""
        found = gains(state.evidence, one)
        g = int(np.argmax(found.log_odds))
        # Why refined: beside a shape of the grid the rest holds what that one misses, and does the work of the effect.
        _, shape, scale = integrated(state.evidence.without_rest, state.rows, one, state.added)
        starts = {g: float(found.scale[g])}
        if shape not in one.shapes:
            one = one.and_also(candidate(state.rows, one.place, [shape], state.added))
        starts.setdefault(one.shapes.index(shape), scale)
        looks = [self._look_from(state.evidence, one, *start) for start in starts.items()]
        return max(looks, key=lambda look: look.log_odds)

    def _look_from(self, evidence: Evidence, one: Candidate, g: int, scale: float) -> Look:
        """Return a candidate with the rest sized beside one of its shapes."""
        k, t = one.rms.shape[1], evidence.width
        products, rms = one.at(g)
        strength = {
            j: float(np.trace(own.sum(axis=0)) / max(evidence.joints[j].counts.sum(), 1.0))
            for j, (own, _) in products.items()
        }
        joints = sorted(strength, key=lambda j: -strength[j])[:MOST_JOINTS]
        wide = evidence.with_columns(products, prior_precision(products, rms / scale))
        beside = wide.sized(joints).without(t, t + k)
        again = gains(beside, one)
        best = int(np.argmax(again.log_odds))
        odds = beside.log_evidence - evidence.log_evidence + float(again.log_odds[best])
        return Look(
            one,
            dict(one.shapes[best]),
            float(again.scale[best]),
            odds + self._prior(one),
            beside,
        )

    def _integrated(self, state: State, look: Look) -> Look:
        """Return a look with the shapes of its effect integrated out."""
        gain, shape, scale = integrated(look.beside, state.rows, look.candidate, state.added)
        odds = look.beside.log_evidence - state.evidence.log_evidence + gain
        return replace(look, shape=shape, scale=scale, log_odds=odds + self._prior(look.candidate))

    def _visible(self, state: State, look: Look) -> dict[int, float]:
        """Return the visible size of a candidate by joint in units of the noise, beside what is named."""
        one = candidate(state.rows, look.place, [look.shape], state.added)
        products, rms = one.at(0)
        size = gains(look.beside, one).amplitudes[0]
        wide = look.beside.with_columns(products, prior_precision(products, rms))
        part = slice(look.beside.width, wide.width)
        return self._seen(wide, part, size, look.place, list(one.own))

    def _seen(
        self, evidence: Evidence, part: slice, size: Floats, place: Place, joints: Sequence[int]
    ) -> dict[int, float]:
        rms, bands = evidence.seen(part, size, joints), self.rows.bands
        found = {}
        for j in joints:
            share = bands.counts(j, always=place.always).sum() / max(bands.counts(j).sum(), 1e-9)
            found[j] = float(rms[j] / np.sqrt(max(share, 1e-9)))
        return found

    # ------------------------------------------------------------ names
    def _built(self, named: Sequence[Named], sized: Evidence) -> State:
        """Return the state of some names, all columns made at the parameters and sizes that go with them.

        Args:
            named: the names.
            sized: an evidence with sizes to begin with.
        """
        names, rows = list(named), self.rows
        for _ in range(2):
            evidence, added = self.first, list[EffectColumns]()
            evidence = evidence.replaced(
                {
                    j: replace(m, log_rms=s.log_rms, powers=s.powers)
                    for j, (m, s) in enumerate(zip(evidence.joints, sized.joints, strict=True))
                }
            )
            for one in names:
                made = candidate(rows, one.place, [one.shape], added)
                products, rms = made.at(0)
                evidence = evidence.with_columns(
                    products, prior_precision(products, rms / one.scale)
                )
                added.append({j: C[0] for j, C in made.columns.items()})
            sized = evidence.sized(range(len(evidence.joints)))
            before = names
            names, rows = self._exact(names, sized)
            if not any(one.place.effect.needs_model for one in before):
                break
        state = State(tuple(names), tuple(added), sized, rows, ())
        return replace(state, candidates=self._candidates(rows, added))

    def _exact(
        self, named: Sequence[Named], evidence: Evidence
    ) -> tuple[list[Named], EvidenceRows]:
        """Return names and rows scaled with the parameters and sizes that were found."""
        theta, at, found = evidence.estimate, self.first.width, []
        for one in named:
            names = list(one.place.effect.amplitudes(one.shape))
            sizes = dict(zip(names, theta[at : at + len(names)].tolist(), strict=True))
            at += len(names)
            place = replace(one.place, effect=one.place.effect.at_size(sizes))
            found.append(replace(one, place=place))
        exact = {one.place.at: one.place for one in found}
        self.places = [exact.get(place.at, place) for place in self.places]
        regression = self.problem.regression(
            theta[: self.problem.base.reduction.rank], nuisance=False
        )
        return found, self.rows.with_regression(regression)

    def _in_place_of(self, state: State, k: int, barred: set[tuple[Key, bool]]) -> list[Look]:
        """Return what explains the rows in place of one name, itself included."""
        return self.looks(state.without(k), barred, state.named[k].place.key)

    def _exchanged(self, state: State, sure: float, barred: set[tuple[Key, bool]]) -> State:
        """Return a state with better names instead, without those that the others do without; these are barred."""
        for _ in range(EXCHANGES):
            self.instead = [self._in_place_of(state, k, barred) for k in range(len(state.named))]
            for k, one in enumerate(state.named):
                best = simplest(self.instead[k], sure)
                others = [x for i, x in enumerate(state.named) if i != k]
                if best is None or best.log_odds < sure:
                    barred.add(one.place.at)
                    state = self._built(others, state.evidence)
                    break
                if best.place.at != one.place.at and best.place.effect.name != "torque_delay":
                    state = self._built([*others, Named.of(best)], best.beside)
                    break
            else:
                return state
        self.instead = [self._in_place_of(state, k, barred) for k in range(len(state.named))]
        return state

    def _with_rivals(self, state: State, likely: Look | None) -> State:
        """Return the state with the probability of each name and its rivals, and what is likely as a last name."""
        found = []
        beside = {
            c.place.at: float(gains(state.evidence, c).log_odds.max()) for c in state.candidates
        }
        for k, one in enumerate(state.named):
            looks = self.instead[k]
            odds = [look.log_odds for look in looks if look.place.at == one.place.at]
            rivals = tuple(
                (look.place, look.log_odds)
                for look in looks
                if look.place.at != one.place.at
                and not contains(look.place, one.place)
                and beside.get(look.place.at, 0.0) < tuning.INSTEAD * look.log_odds
            )
            found.append(replace(one, log_odds=max(odds, default=0.0), rivals=rivals))
        state = replace(state, named=tuple(found))
        more = likely is not None and likely.log_odds > log_odds_of(tuning.LIKELY)
        if likely is None or not more or likely.place.effect.name == "torque_delay":
            return state
        return self._built([*found, Named.of(likely)], likely.beside)

    def _late(self, state: State, look: Look) -> SelectedEffect:
        """Return how late torques are beside what is named."""
        # Why without the skew of the recorder: it is a delay too, and what is told is the whole.
        skew = slice(self.first.base - self.first.shared, self.first.base - self.first.shared + 1)
        beside = look.beside.without(skew.start, skew.stop)
        found = gains(beside, look.candidate.without(skew.start, skew.stop))
        visible = self._visible(state, look)
        delay, error = float(found.amplitudes[0, 0]), float(np.sqrt(found.covariance[0, 0, 0]))
        joint = max(visible, key=lambda j: visible[j])
        return SelectedEffect(
            effect=look.place.effect,
            joints=(),
            shape={},
            joint=joint,
            visible=visible[joint],
            log_odds=look.log_odds,
            p_value=float(chdtrc(1, (delay / error) ** 2)),
            values={"delay": delay},
            std_errors={"delay": error},
        )

    def _told_as(self, state: State, k: int) -> SelectedEffect:
        """Return a name with sizes and errors, everything else and its own shape being integrated out."""
        one, part = state.named[k], state.columns(k)
        effect = one.place.effect
        beside = state.evidence.without(part.start, part.stop)
        others = state.added[:k] + state.added[k + 1 :]
        found = sizes_of(beside, state.rows, one.place, one.shape, others)
        size, power = found.amplitudes, np.diag(found.covariance)
        there = power > 0
        covariance = found.covariance[np.ix_(there, there)]
        square = float(size[there] @ np.linalg.solve(covariance, size[there]))
        errors = np.where(there, np.sqrt(power), np.inf)
        names = list(effect.amplitudes(one.shape))
        mode = state.evidence.estimate[part]
        visible = self._seen(state.evidence, part, mode, one.place, list(state.added[k]))
        joint = max(visible, key=lambda j: visible[j])
        return SelectedEffect(
            effect=effect,
            joints=one.place.joints,
            shape=found.shape,
            joint=joint,
            visible=visible[joint],
            log_odds=one.log_odds,
            p_value=float(chdtrc(int(there.sum()), square)),
            rivals=tuple(each.key for each in one.equals if not each.always),
            always=any(each.always for each in one.equals),
            values=dict(zip(names, size.tolist(), strict=True)) | found.shape,
            std_errors=dict.fromkeys(effect.steps, float("inf"))
            | found.shape_errors
            | dict(zip(names, errors.tolist(), strict=True)),
            probability=one.probability,
        )
