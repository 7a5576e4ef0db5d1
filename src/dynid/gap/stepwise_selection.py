"""The finder: add the candidate with the most evidence, see whether another explains it better, and so on."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap.problem import Setting
from dynid.gap.selected_effects import Pick, moved
from dynid.gap.significance import Candidate, Proof, Score, columns_of, make_candidate, prove, score
from dynid.gap.whitened_regression import Board
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Effect, Floats, Place
from dynid.progress import Progress

#: Smallest visible size in units of the noise: below, wrong names are as likely as right ones.
SMALLEST = 0.3
#: The chance of a false name is divided over so many more looks for a wave: its frequency is free.
RIPPLE_LOOKS = 60.0
#: Names whose evidence differs by less are equally good: in net gain, 12 is a chance of one in four hundred; and in
#: units of the difference's own spread over blocks of time (Vuong 1989), which is what 12 comes to when all that is
#: left is noise, and more when what is left is what the model lacks.
EQUAL, SURE = 12.0, 1.73
#: Effects that are a simpler special case of others, which then have to be better by more than ``EQUAL``.
SIMPLER = {"torque_offset": ("spring", "end_stop", "torque_drift"), "coulomb": ("presliding_hysteresis", "stribeck")}
#: Rivals that are refined before they are compared.
RIVALS = 6
#: A rival has at least this share of an effect's evidence, and loses all but this share of its gain beside it: what
#: explains something else is no rival.
NEAR, INSTEAD = 0.7, 0.5
#: Steps of the refinement of a shape, in shares of its first step; it ends early where there is little to gain: what a
#: large effect leaves when its shape is a little off would be taken for a second effect.
REFINED = (1.0, 0.5, 0.25, 0.25, 0.12, 0.06, 0.03, 0.015)
SETTLED = 100.0


@dataclass(frozen=True)
class Options:
    """What is searched.

    Attributes:
        effects: identifiers; all when empty.
        joints: 0-based joints; all when empty.
        false_alarm: chance of naming something on logs that hold nothing.
        most: largest number of effects that are added.
    """

    effects: tuple[str, ...] = ()
    joints: tuple[int, ...] = ()
    false_alarm: float = 0.01
    most: int = 3


class Finder:
    """Greedy addition with swaps and backward elimination on one setting."""

    def __init__(
        self,
        setting: Setting,
        options: Options,
        progress: Progress,
        old: dict[tuple[str, Place], float],
        *,
        delay_allowed: bool,
    ) -> None:
        self.setting, self.options, self.progress, self.old = setting, options, progress, old
        self.delay_allowed = delay_allowed
        self.picks: list[Pick] = []
        self.barred: set[tuple[str, Place]] = set()
        self.refused: list[tuple[str, Place, str]] = []
        self._columns: dict[tuple[str, Place, tuple[tuple[str, float], ...]], dict[int, Floats]] = {}
        self.visibility: dict[tuple[str, Place], float] = {}
        self.board = setting.board()
        self.candidates = self._candidates()

    def _candidates(self, old: Sequence[Candidate] = ()) -> list[Candidate]:
        """Make all candidates; those that do not depend on the model are taken from the old ones."""
        kept = [c for c in old if not c.effect.needs_model]
        made = list(kept)
        done = {c.key for c in kept}
        wanted = wanted_effects(self.setting, self.options)
        for k, (effect, place) in enumerate(wanted):
            if (effect.name, place) not in done and (effect.name != "torque_delay" or self.delay_allowed):
                made += make_candidate(self.board, effect, place)
            self.progress.advance(k + 1, len(wanted), f"{effect.name}")
        return made

    def run(self) -> Proof | None:
        """Search until nothing passes; returns the proof of a delay, which has to be taken out first."""
        while len(self.picks) < self.options.most:
            pick = self._best()
            if pick is None:
                break
            if pick.effect.name == "torque_delay":
                return pick.proof
            self._accept(pick)
            self._swap()
            self._eliminate()
            self._relinearise()
        self._equals()
        return None

    def _scores(self, board: Board, skip: Sequence[tuple[str, Place]] = ()) -> list[tuple[Score, Candidate]]:
        wanted = [c for c in self.candidates if c.key not in self.barred and c.key not in skip]
        scores = [score(board, c) for c in wanted]
        found = [(replace(s, price=s.price + self.old.get(c.key, 0.0)), c) for s, c in zip(scores, wanted, strict=True)]
        return sorted(found, key=lambda pair: -pair[0].net)

    def _best(self) -> Pick | None:
        """Return the strongest candidate that passes the tests.

        Where the strongest on a joint is large but not sure, weaker ones there would only stand in for it.
        """
        ranked = self._scores(self.board, [p.key for p in self.picks])
        if not self.visibility:
            for found, c in ranked:
                self.visibility[c.key] = max(found.visibility, self.visibility.get(c.key, 0.0))
        unclear: set[int] = set()
        while True:
            open_ = [(f, c) for f, c in ranked if f.net > 0 and not unclear & set(c.place[:1])]
            refined = [self._refined(self.board, f, c) for f, c in open_[:RIVALS]]
            leading = sorted((p for p in refined if p.proof.joint not in unclear), key=lambda p: -p.net)
            if not leading:
                return None
            for pick in leading:
                why = self._fails(pick)
                if not why:
                    return self._simplest(pick, leading)
                self.refused.append((pick.effect.name, pick.place, why))
                if pick.proof.visible_rms >= SMALLEST:
                    unclear.add(pick.proof.joint)
                    break
            else:
                return None

    def _simplest(self, pick: Pick, others: Sequence[Pick]) -> Pick:
        """Return what has the least freedom among those that the best is not clearly better than."""
        here = [p for p in others if p.proof.joint == pick.proof.joint]
        good = [p for p in here if p is pick or (not clearly_better(pick, p) and not self._fails(p))]
        return min(good, key=lambda p: (p.freedom, -p.net))

    def _fails(self, pick: Pick) -> str:
        """Return why a pick is not accepted, or nothing."""
        looks = max(150, len({c.key for c in self.candidates})) * (
            RIPPLE_LOOKS if pick.effect.name == "torque_ripple" else 1.0
        )
        if pick.net <= 0:
            return "explains less than its freedom costs"
        if pick.proof.visible_rms < SMALLEST:
            return f"too small: {pick.proof.visible_rms:.2f} of the noise"
        chance = looks * max(pick.proof.p_value, pick.proof.chance)
        if chance >= self.options.false_alarm:
            return f"not sure: chance {min(1.0, chance):.2g}"
        return ""

    def _refined(self, board: Board, found: Score, candidate: Candidate) -> Pick:
        """Return the candidate at its best shape, refined off the grid."""
        shape = dict(candidate.shapes[found.index])
        columns = {j: C[found.index] for j, C in candidate.columns.items()}
        gain = found.gain
        for factor in REFINED if candidate.effect.steps else ():
            steps = candidate.effect.steps.items()
            tried = [
                shape | {name: moved(shape[name], kind, size, sign * factor)}
                for name, (kind, size) in steps
                for sign in (-1, 1)
            ]
            stack = columns_of(board, candidate.effect, candidate.place, tried)
            gram = np.asarray(sum(np.einsum("gkm,glm->gkl", C, C) for C in stack.values()))
            better = score(board, Candidate(candidate.effect, candidate.place, tried, stack, gram))
            if better.gain > gain:
                gain, shape = better.gain, tried[better.index]
                columns = {j: C[better.index] for j, C in stack.items()}
            elif gain < SETTLED / factor:
                break
        proof = prove(board, columns)
        pick = Pick(candidate.effect, candidate.place, shape, proof, gain - found.price)
        self._columns[_identity(pick)] = columns
        return pick

    def _columns_of(self, pick: Pick) -> dict[int, Floats]:
        key = _identity(pick)
        if key not in self._columns:
            stack = columns_of(self.board, pick.effect, pick.place, [pick.shape])
            self._columns[key] = {j: C[0] for j, C in stack.items()}
        return self._columns[key]

    def _with(self, picks: Sequence[Pick]) -> Board:
        board = replace(self.board, added=[self._columns_of(p) for p in picks])
        board.solve()
        return board

    def _accept(self, pick: Pick) -> None:
        self.picks.append(pick)
        self.board = self._with(self.picks)

    def _swap(self) -> None:
        """Replace an accepted effect when another one explains more in its place."""
        for k, pick in enumerate(list(self.picks)):
            if len(self.picks) == 1:
                return
            rest = [p for p in self.picks if p is not pick]
            board = self._with(rest)
            ranked = [r for r in self._scores(board, [p.key for p in rest]) if r[1].effect.name != "torque_delay"]
            leading = [self._refined(board, found, c) for found, c in ranked[:RIVALS]]
            best = max(leading, key=lambda p: p.net)
            own = next((p for p in leading if p.key == pick.key), None)
            if own is None or clearly_better(best, own):
                self.barred.add(pick.key)
                pick = best
            else:
                pick = own
            self.picks = [*rest[:k], pick, *rest[k:]]
            self.board = self._with(self.picks)

    def _eliminate(self) -> None:
        """Drop what is no longer needed; a dropped name is barred, otherwise the search need not end."""
        while len(self.picks) > 1:
            checked = []
            for pick in self.picks:
                rest = [p for p in self.picks if p is not pick]
                proof = prove(self._with(rest), self._columns_of(pick))
                checked.append(replace(pick, proof=proof))
            failing = [p for p in checked if self._fails(p)]
            self.picks = checked
            if not failing:
                return
            worst = min(failing, key=lambda p: p.proof.visible_rms)
            self.barred.add(worst.key)
            self.refused.append((worst.effect.name, worst.place, "not needed beside the others"))
            self.picks = [p for p in self.picks if p is not worst]
            self.board = self._with(self.picks)

    def _relinearise(self) -> None:
        """Scale model-based candidates with the new parameters."""
        theta = self.board.theta[: self.setting.base.reduction.rank]
        self.board = self.setting.board(theta)
        self._columns = {}
        self.candidates = self._candidates(self.candidates)
        self.board = self._with(self.picks)

    def _equals(self) -> None:
        """Note for each accepted effect what would explain as much in its place."""
        for k, pick in enumerate(self.picks):
            rest = [p for p in self.picks if p is not pick]
            board = self._with(rest)
            ranked = self._scores(board, [p.key for p in rest])
            own = next((self._refined(board, f, c) for f, c in ranked if c.key == pick.key), pick)
            near = [(f, c) for f, c in ranked if c.key != pick.key and f.net > NEAR * own.net]
            near = [(f, c) for f, c in near if score(self.board, c).gain < INSTEAD * f.gain][:RIVALS]
            rivals = [self._refined(board, found, c) for found, c in near]
            equal = tuple(r.key for r in rivals if not clearly_better(own, r) and not contains(r, own))
            # Why not own: another form of it may have as much evidence, but the board holds the columns of this one.
            self.picks[k] = replace(pick, net=own.net, equals=equal)


def _identity(pick: Pick) -> tuple[str, Place, tuple[tuple[str, float], ...]]:
    return pick.effect.name, pick.place, tuple(sorted(pick.shape.items()))


def clearly_better(one: Pick, other: Pick) -> bool:
    """Return whether one effect explains the rows better than another beyond doubt."""
    lead = one.net - other.net
    if len(one.proof.gains) != len(other.proof.gains):
        return lead > EQUAL
    spread = np.std(one.proof.gains - other.proof.gains) * np.sqrt(len(one.proof.gains))
    return bool(lead > max(EQUAL, SURE * spread))


def contains(wide: Pick, narrow: Pick) -> bool:
    """Return whether one effect holds the other as a special case at the same place, and so always fits as well."""
    return wide.place == narrow.place and wide.effect.name in SIMPLER.get(narrow.effect.name, ())


def wanted_effects(setting: Setting, options: Options) -> list[tuple[Effect, Place]]:
    """Return every effect and place that is worth a look."""
    use = "refit" if setting.known is None else "frozen"
    joints = setting.base.robot.joints
    found = []
    moves = np.sum([s.use.sum(axis=0) for s in setting.stretches], axis=0) > 0
    for effect in CATALOGUE.values():
        if use not in effect.uses or (options.effects and effect.name not in options.effects):
            continue
        for place in effect.places(len(joints)):
            if options.joints and place and place[0] not in options.joints:
                continue
            if place and not moves[place[0]]:
                continue
            if not _in_model(effect, place, setting):
                found.append((effect, place))
    return found


def _in_model(effect: Effect, place: Place, setting: Setting) -> bool:
    """Return whether the baseline has it already, or has not what should have changed."""
    if not place:
        return False
    joint = setting.base.robot.joints[place[0]]
    refit = setting.known is None
    has = {
        "torque_offset": refit and "offset" in joint.friction,
        "viscous": "viscous" in joint.friction,
        "coulomb": "coulomb" in joint.friction,
        "motor_inertia": refit and joint.motor_inertia,
        "coulomb_change": "coulomb" not in joint.friction,
        "viscous_change": "viscous" not in joint.friction,
    }
    return has.get(effect.name, False)
