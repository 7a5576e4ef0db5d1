"""Which names the evidence gives: the best first, all others again beside it, and none that the rest does without."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby

import numpy as np
from scipy.special import chdtrc, logit, softmax

from dynid.arrays import Floats
from dynid.gap import tuning
from dynid.gap.candidates import (
    Candidate,
    Place,
    SelectionOptions,
    candidate,
    candidates_of,
    gains,
    places_of,
    visible_share,
)
from dynid.gap.evidence import Evidence, EvidenceRows, evidence_of
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import Key, SelectedEffect
from dynid.gap.shapes import integrated, over_shapes
from dynid.model.effects.catalogue import DELAY
from dynid.progress import advance

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


@dataclass(frozen=True)
class Look:
    """A candidate with the rest sized beside it, or a name.

    Attributes:
        place: the effect, of a name exact at its size, and where it sits.
        candidate: what is looked at.
        alone: the same at the shape that it was looked at with.
        shape: its best shape.
        scale: of its prior, in units of the noise.
        log_odds: that it is there, against nothing with a name.
        evidence: without it, the rest sized as with it.
        visible: its largest visible size, in units of the noise.
        rivals: of a name, others with their log odds in its place.
    """

    place: Place
    candidate: Candidate
    alone: Candidate
    shape: dict[str, float]
    scale: float
    log_odds: float
    evidence: Evidence
    visible: float = 0.0
    rivals: tuple[tuple[Place, float], ...] = ()

    @property
    def material(self) -> bool:
        """Whether it is of any account."""
        return self.visible >= tuning.MATERIAL

    @property
    def late(self) -> bool:
        """Whether it is a delay of all torques."""
        return self.place.effect.name == DELAY


@dataclass(frozen=True)
class State:
    """What is named, and everything beside it.

    Attributes:
        named: the names.
        evidence: with them, sized.
        rows: the rows with the columns of the names, effects scaled with the parameters that go with these.
        candidates: all that may be named beside them.
    """

    named: Sequence[Look]
    evidence: Evidence
    rows: EvidenceRows
    candidates: Sequence[Candidate] = ()

    def columns(self, k: int) -> slice:
        """Return where the columns of one name are among T."""
        counts = [one.alone.rms.shape[1] for one in self.named]
        ends = self.evidence.base + np.cumsum([0, *counts])
        return slice(*ends[k : k + 2].tolist())

    def without(self, k: int) -> State:
        """Return the state without one name, the rest sized again."""
        evidence = self.evidence.without(self.columns(k))
        named = [*self.named[:k], *self.named[k + 1 :]]
        return replace(self, named=named, evidence=evidence.sized())


def not_ruled_out(log_odds: float) -> float:
    """Return the log odds of a rival that are just not ruled out by those of a name."""
    return log_odds - float(logit(tuning.AGAINST_OTHERS))


def contains(wide: Place, narrow: Place) -> bool:
    """Return whether one effect holds the other as a special case at the same place."""
    same = wide.joints == narrow.joints and wide.always == narrow.always
    return same and wide.effect.name in SIMPLER.get(narrow.effect.name, ())


def simplest(looks: Sequence[Look], sure: float) -> Look | None:
    """Return what is taken of looks, the best first; None where none is of any account.

    That is the best, or the special case of it that it does not rule out. The same effect with fewer amplitudes is such
    a case: a line is one of a cubic.
    """
    looks = [one for one in looks if one.material]
    if not looks:
        return None
    likely = [one for one in looks if one.log_odds > not_ruled_out(looks[0].log_odds)]
    best = likely[0]
    sure_ones = [one for one in likely if one.log_odds > min(sure, best.log_odds)]

    def amplitudes(one: Look) -> int:
        return int(one.candidate.rms.shape[1])

    fewer = [
        x for x in sure_ones if x.place.at == best.place.at and amplitudes(x) < amplitudes(best)
    ]
    return next(
        (one for one in sure_ones if contains(best.place, one.place)),
        min(fewer, key=amplitudes, default=best),
    )


class Search:
    """A search for names on one problem. It can be run again with other options; each candidate is made once.

    Args:
        problem: what is searched.
    """

    def __init__(self, problem: GapProblem) -> None:
        self.problem = problem
        self.first, self.rows = evidence_of(problem)
        self.made: dict[tuple[Place, ...], list[Candidate]] = {}
        self.visibility: dict[Key, float] = {}

    def _begin(self, options: SelectionOptions, *, delay: bool) -> State:
        """Return the state without any name, with all candidates that are wanted."""
        self.options, self.sure = options, float(logit(options.sure))
        self.places = places_of(self.problem, options, delay=delay)
        self.barred = {
            x.at for x in self.places if not x.always and options.barred & {x.joints[:1], x.key}
        }
        self.instead: list[Sequence[Look]] = []
        candidates = self._candidates(self.rows)
        for one in candidates:
            share = visible_share(self.first, one, self.problem.base.rank)
            key = one.place.effect.name, one.place.joints[:1]
            self.visibility[key] = max(share, self.visibility.get(key, 0.0))
        self.places_of = Counter(name for (name, _), _ in {c.place.at for c in candidates})
        return State([], self.first, self.rows, candidates)

    def _candidates(self, rows: EvidenceRows) -> list[Candidate]:
        """Return all candidates beside what is named, each made once, and again at a size that it was found to have."""
        candidates: list[Candidate] = []
        done = 0
        for key, group in groupby(self.places, lambda place: (place.key, place.effect.at)):
            places = tuple(group)
            if places not in self.made:
                self.made[places] = candidates_of(replace(rows, own=self.rows.own), places)
            candidates += self.made[places]
            done += len(places)
            advance(done, len(self.places), key[0][0])
        return [one.beside(rows) for one in candidates]

    def run(
        self, options: SelectionOptions, *, delay: bool
    ) -> tuple[State, SelectedEffect | None, bool]:
        """Search until nothing is sure.

        Args:
            options: which effects are tried.
            delay: whether a delay is tried.

        Returns:
            Names with everything beside them, what is only likely included; how late torques are jointly with them,
            None where it is not tried; and whether that is the best name, and has to be taken out first.
        """
        state, likely = self._begin(options, delay=delay), None
        # What always was is not told.
        while sum(not one.place.always for one in state.named) < self.options.most:
            looks = self.looks(state)
            best = simplest(looks, self.sure)
            if best is None or best.log_odds < self.sure:
                likely = best
                break
            if best.late:
                return state, self._late(state, best), True
            state = self._built([*state.named, best], best.evidence)
            state = self._exchanged(state, [] if best.place.always else looks)
        late = next((c for c in state.candidates if c.place.effect.name == DELAY), None)
        small = None
        if late is not None:
            small = self._late(state, Look(late.place, late, late, {}, 1.0, 0.0, state.evidence))
        return self._with_rivals(state, likely), small, False

    def with_numbers(self, state: State) -> list[SelectedEffect]:
        """Return the names with numbers, without what was always there."""
        return [
            self._with_numbers(state, k) for k, x in enumerate(state.named) if not x.place.always
        ]

    # ------------------------------------------------------------ looking
    def looks(self, state: State, own: Look | None = None) -> list[Look]:
        """Return the leading candidates, each with the rest sized beside it, the best first.

        Args:
            state: what they stand beside.
            own: a name that is looked at in any case, with what acts on its joints and the same effect elsewhere
                alone: a gain of one joint is much like another gain of the next.
        """
        taken, evidence = {one.place.at for one in state.named} | self.barred, state.evidence
        open_ = [
            one
            for one in state.candidates
            if one.place.at not in taken
            and (
                not own
                or one.place.effect.name == own.place.effect.name
                or one.own.keys() & own.candidate.own.keys()
            )
        ]
        picked = [k for k, one in enumerate(open_) if own and one.place.key == own.place.key]
        bare = evidence.smaller(1.0)
        for some in (evidence, evidence.smaller(0.5)):
            odds = np.array([gains(some, one).log_odds.max() for one in open_])
            best = np.argsort(-odds, kind="stable")[: tuning.MOST_LOOKS]
            picked += best[odds[best] >= tuning.WORTH_A_LOOK].tolist()
        looks = [self._look(state, bare, open_[k]) for k in dict.fromkeys(picked)]
        looks = [
            replace(one, visible=max(self._visible(one).values()))
            for one in looks
            if one.log_odds > 0.0
        ]
        # Why of these: a long log is sure of torques that matter to nobody.
        top = max((one.log_odds for one in looks if one.material), default=np.inf)
        exact = []
        for one in looks:
            if one.log_odds > top - BEHIND:
                gain, shape, scale = integrated(one.evidence, state.rows, one.candidate)
                sure = self._odds(state, one.candidate, one.evidence, gain)
                exact.append(replace(one, shape=shape, scale=scale, log_odds=sure))
        return sorted(exact, key=lambda one: -one.log_odds)

    def _odds(self, state: State, one: Candidate, sized: Evidence, gain: float) -> float:
        """Return the log odds of a candidate with its log Bayes factor beside a rest of its own."""
        name = one.place.effect.name
        # Why by effect: one that may sit in forty places is as likely in all of them as one that sits in one.
        ways = len(self.places_of) * self.places_of[name] * one.groups
        changed = self.problem.since and not one.place.always
        prior = tuning.CHANGES.get(name, 0.0) * changed - float(np.log(ways))
        return sized.log_evidence - state.evidence.log_evidence + gain + prior

    def _look(self, state: State, bare: Evidence, one: Candidate) -> Look:
        """Return a candidate with the rest sized beside it, from its best shape beside the rest and without it."""
        gained = gains(state.evidence, one)
        g = int(np.argmax(gained.log_odds))
        # Why refined: beside a shape of the grid the rest holds what that one misses, and does the work of the effect.
        _, shape, scale = integrated(bare, state.rows, one)
        looks = [self._look_from(state, one, one.at(g), float(gained.scale[g]))]
        if shape != one.shapes[g]:
            refined = candidate(state.rows, one.place, [shape])
            looks.append(self._look_from(state, one, refined, scale))
        return max(looks, key=lambda look: look.log_odds)

    def _look_from(self, state: State, one: Candidate, alone: Candidate, scale: float) -> Look:
        """Return a candidate with the rest sized beside one of its shapes."""
        evidence = state.evidence
        sized = evidence.sized_as(alone.among(evidence, scale).sized())
        looks = []
        for some in (one, alone):
            gained = gains(sized, some)
            g = int(np.argmax(gained.log_odds))
            odds = self._odds(state, one, sized, float(gained.log_odds[g]))
            best, size = some.at(g), float(gained.scale[g])
            looks.append(Look(one.place, one, best, best.shapes[0], size, odds, sized))
        return max(looks, key=lambda look: look.log_odds)

    def _visible(self, look: Look) -> dict[int, float]:
        """Return the visible size of a candidate by joint in units of the noise, beside what is named."""
        one = look.alone
        wide = one.among(look.evidence, 1.0)
        part = slice(look.evidence.width, wide.width)
        size = gains(look.evidence, one).amplitudes[0]
        return self._seen(wide, part, size, look.place, list(one.own))

    def _seen(
        self, evidence: Evidence, part: slice, size: Floats, place: Place, joints: Sequence[int]
    ) -> dict[int, float]:
        rms, bands = evidence.seen(size, joints, part), self.rows.bands
        sizes = {}
        for j in joints:
            share = bands.counts(j, always=place.always).sum() / max(bands.counts(j).sum(), 1e-9)
            sizes[j] = float(rms[j] / np.sqrt(max(share, 1e-9)))
        return sizes

    # ------------------------------------------------------------ names
    def _built(self, named: list[Look], sized: Evidence) -> State:
        """Return the state of some names, all columns made at the parameters and sizes that go with them.

        Args:
            named: the names.
            sized: an evidence with sizes to begin with.
        """
        rows, base = self.rows, self.problem.base
        for _ in range(2):
            evidence, rows = self.first.sized_as(sized), replace(rows, own=self.rows.own)
            for k, one in enumerate(named):
                alone = candidate(rows, one.place, [one.shape])
                named[k] = replace(one, alone=alone)
                evidence = alone.among(evidence, one.scale)
                rows = rows.with_name({j: C[0] for j, C in alone.columns.items()})
            sized = evidence.sized()
            # Now scaled with the parameters and sizes that were found.
            theta, exact = sized.estimate, dict[tuple[Key, bool], Place]()
            for k, one in enumerate(named):
                amplitudes = one.place.effect.amplitudes(one.shape)
                size = theta[State(named, sized, rows).columns(k)].tolist()
                effect = one.place.effect.at_size(dict(zip(amplitudes, size, strict=True)))
                exact[one.place.at] = replace(one.place, effect=effect)
                named[k] = replace(one, place=exact[one.place.at])
            again = any(one.place.effect.needs_model for one in named)
            self.places = [exact.get(place.at, place) for place in self.places]
            anew = self.rows.rows.with_reference(base, theta[: base.rank])
            rows = replace(rows, bands=replace(rows.bands, rows=anew))
            if not again:
                break
        return State(named, sized, rows, self._candidates(rows))

    def _look_instead(self, state: State, last: Sequence[Look] = ()) -> None:
        """Look at what explains the rows in place of each name that is told, itself included; ``last`` for the last."""
        self.instead = [
            [] if one.place.always else self.looks(state.without(k), one)
            for k, one in enumerate(state.named[: -1 if last else None])
        ]
        self.instead += [last] if last else []

    def _exchanged(self, state: State, looks: Sequence[Look]) -> State:
        """Return a state with better names instead, without those that the others do without; these are barred.

        Args:
            state: the names.
            looks: those that the last name is the best of; none for one that always was.
        """
        for _ in range(EXCHANGES):
            self._look_instead(state, looks)
            looks = ()
            for k, one in enumerate(state.named):
                if one.place.always:
                    continue
                best = simplest(self.instead[k], self.sure)
                others = [x for i, x in enumerate(state.named) if i != k]
                if best is None or best.log_odds < self.sure:
                    self.barred.add(one.place.at)
                    state = self._built(others, state.evidence)
                    break
                if best.place.at != one.place.at and not best.late:
                    state = self._built([*others, best], best.evidence)
                    break
            else:
                return state
        self._look_instead(state)
        return state

    def _with_rivals(self, state: State, likely: Look | None) -> State:
        """Return the state with the odds of each name and its rivals, and what is likely as a last name."""
        kept = {
            c.place.at: float(gains(state.evidence, c).log_odds.max()) for c in state.candidates
        }
        with_odds = []
        for one, looks in zip(state.named, self.instead, strict=False):
            own = max((x.log_odds for x in looks if x.place.at == one.place.at), default=0.0)
            rivals = tuple(
                (look.place, look.log_odds)
                for look in looks
                if look.place.at != one.place.at
                and not contains(look.place, one.place)
                and kept.get(look.place.at, 0.0) < tuning.INSTEAD * look.log_odds
            )
            with_odds.append(replace(one, log_odds=own, rivals=rivals))
        if likely is None or likely.late or likely.log_odds <= logit(tuning.LIKELY):
            return replace(state, named=with_odds)
        return self._built([*with_odds, likely], likely.evidence)

    def _late(self, state: State, look: Look) -> SelectedEffect:
        """Return how late torques are beside what is named."""
        # Why without the skew of the recorder: it is a delay too, and what is told is the whole.
        skew = self.problem.base.rank
        evidence = look.evidence.without(slice(skew, skew + 1))
        return self._told(state, look, evidence, self._visible(look))

    def _with_numbers(self, state: State, k: int) -> SelectedEffect:
        """Return a name with sizes and errors, everything else and its own shape being integrated out."""
        one, part = state.named[k], state.columns(k)
        mode = state.evidence.estimate[part]
        visible = self._seen(state.evidence, part, mode, one.place, list(one.alone.own))
        equals = [place for place, x in one.rivals if x > not_ruled_out(one.log_odds)]
        odds = np.array([0.0, one.log_odds, *(x for _, x in one.rivals)])
        return replace(
            self._told(state, one, state.evidence.without(part), visible),
            rivals=tuple(each.key for each in equals if not each.always),
            always=any(each.always for each in equals),
            probability=float(softmax(odds)[1]),
        )

    def _told(
        self, state: State, one: Look, beside: Evidence, visible: dict[int, float]
    ) -> SelectedEffect:
        """Return what is looked at with its numbers, by its evidence without it and its visible size by joint."""
        effect = one.place.effect
        sizes = over_shapes(beside, state.rows, one.place, one.shape)
        size, power = sizes.amplitudes, np.diag(sizes.covariance)
        there = power > 0
        covariance = sizes.covariance[np.ix_(there, there)]
        square = float(size[there] @ np.linalg.solve(covariance, size[there]))
        errors = np.where(there, np.sqrt(power), np.inf)
        names, joint = [*effect.amplitudes(one.shape)], max(visible, key=lambda j: visible[j])
        return SelectedEffect(
            effect=effect,
            joints=one.place.joints,
            shape=sizes.shape,
            joint=joint,
            visible=visible[joint],
            log_odds=one.log_odds,
            p_value=float(chdtrc(int(there.sum()), square)),
            values=dict(zip(names, size.tolist(), strict=True)) | sizes.shape,
            std_errors=sizes.shape_errors | dict(zip(names, errors.tolist(), strict=True)),
        )
