"""The search over settings: delays are taken out of the logs, and the noise is measured beside what was found."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.estimation.effect_columns import on_time
from dynid.estimation.stack import Source
from dynid.gap.localisation import between_reversals
from dynid.gap.noise import noise_of
from dynid.gap.problem import Known, Setting, make_setting, nuisance_columns, with_noise
from dynid.gap.selected_effects import Pick, effect_torque, with_picks
from dynid.gap.significance import Proof, make_candidate, score
from dynid.gap.stepwise_selection import Finder, Options, wanted_effects
from dynid.gap.whitened_regression import Board
from dynid.model.effects.interface import Floats, Place
from dynid.model.store import BaseModel
from dynid.progress import SILENT, Progress

#: Times a delay is refined: each shift makes the next one exact to second order.
DELAYS = 3
#: When the noise measured beside what was found differs by more than this from what it was before, the search starts
#: anew: its first rows were whitened with part of the effect.
SAME_NOISE = 0.7


@dataclass
class Search:
    """A finished search.

    Attributes:
        setting: what was searched, delays taken out.
        picks: accepted effects.
        delay: how late the torques were found to be [s].
        before: chi of each joint without the effects, (n,).
        after: and with them, (n,).
        calm: the same away from reversals, where that is less: below 1 cm/s the velocity is not known well enough to
            say whether friction turns as the model says, (n,).
        refused: candidates that came close and why they were not accepted.
        visibility: largest visible share of each candidate.
    """

    setting: Setting
    picks: list[Pick]
    delay: float
    delay_proof: Proof | None
    before: Floats
    after: Floats
    calm: Floats
    refused: list[tuple[str, Place, str]] = field(default_factory=list)
    visibility: dict[tuple[str, Place], float] = field(default_factory=dict)


def search(
    sources: Sequence[Source],
    base: BaseModel,
    known: Known | None,
    options: Options,
    progress: Progress = SILENT,
    *,
    first: Setting | None = None,
    earlier: Sequence[Source] = (),
) -> Search:
    """Search logs for what the model lacks.

    Args:
        sources: conditioned logs, all with the same filter.
        base: model and base parameters.
        known: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        progress: told how far the work is.
        first: the setting of these logs, when it is there already.
        earlier: conditioned logs that a kept model was identified from: what a candidate explains there was missing
            already, and is no evidence for a change.
    """
    delay, proof = 0.0, None
    first = setting = first or make_setting(sources, base, known, earlier)
    old: dict[tuple[str, Place], float] = {}
    if earlier and not setting.matched:
        then = make_setting(earlier, base, known)
        old = explained(then, options, sum(int(rows.sum()) for rows in setting.train))
    for _ in range(DELAYS + 2):
        finder = Finder(setting, options, progress, old, delay_allowed=abs(delay) < 0.5)
        late = finder.run()
        if late is not None:
            delay += float(late.beta[0])
            proof = proof or late
            shifted = [replace(s, segments=[on_time(x, delay) for x in s.segments]) for s in sources]
            setting = make_setting(shifted, base, known, earlier)
            continue
        floor, setting = setting.noise.floor, quieter(setting, finder.board, finder.picks)
        change = setting.noise.floor / floor
        if np.all((change > SAME_NOISE) & (change < 1 / SAME_NOISE)):
            break
    bare = setting.board(finder.board.theta[: base.reduction.rank])
    before = first.board().chi() if delay else bare.chi()
    after, calm = remains(with_picks(bare, finder.picks))
    return Search(setting, finder.picks, delay, proof, before, after, calm, finder.refused, finder.visibility)


def remains(board: Board) -> tuple[Floats, Floats]:
    """Return chi of each joint, and the same away from reversals where that is less, (n,) each."""
    chi = board.chi()
    return chi, np.minimum(chi, between_reversals(board))


def explained(earlier: Setting, options: Options, rows: int) -> dict[tuple[str, Place], float]:
    """Return what each candidate explains of the logs that a kept model was identified from, as if of so many rows."""
    board = earlier.board()
    share = rows / max(1, sum(int(one.sum()) for one in earlier.train))
    found: dict[tuple[str, Place], float] = {}
    for effect, place in wanted_effects(earlier, options):
        for candidate in make_candidate(board, effect, place):
            gain = share * score(board, candidate).gain
            found[candidate.key] = max(gain, found.get(candidate.key, 0.0))
    return found


def without(found: Search, pick: Pick) -> Search:
    """Return a search without one of its effects."""
    picks = [p for p in found.picks if p.key != pick.key]
    after, calm = remains(with_picks(found.setting.board(), picks))
    return replace(found, picks=picks, after=after, calm=calm)


def quieter(setting: Setting, board: Board, picks: Sequence[Pick]) -> Setting:
    """Return the setting with the noise measured again, after what was found is taken out of the residual.

    Why: a large effect does not repeat exactly when the motion does not, and would pass for noise. And rows that are
    compared with the same motion before have no other measure of it; the first guess, which lets all parameters go, is
    too small.
    """
    if not setting.matched and not (setting.noise.repeats and picks):
        return setting
    residuals = []
    for s, b in zip(setting.stretches, board.stretches, strict=True):
        columns = nuisance_columns(s)
        p = s.W.shape[2]
        extra = board.theta[p : board.size].reshape(s.motion.n, -1)
        model = s.W @ board.theta[:p] + np.stack([extra[j] @ columns[j] for j in range(s.motion.n)], axis=1)
        residuals.append(s.tau - model - effect_torque(b.motion, s.filtered, picks, board.theta[board.size :]).T)
    return with_noise(setting, noise_of(setting.stretches, residuals, setting.pairs, setting.train), residuals)
