"""From picks to numbers: shapes and amplitudes fitted together, errors from left-out blocks, proof on held-out rows.

The columns that the search did not judge are gone here: with them the height of a Stribeck hump comes out wrong by
tens of percent while its name is right.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.gap.noise import ORDER
from dynid.gap.problem import Setting
from dynid.gap.search import Search
from dynid.gap.segments import blocks_of, cut
from dynid.gap.selected_effects import Pick, effect_torque, moved, with_picks
from dynid.gap.significance import columns_of, prove
from dynid.gap.whitened_regression import Board
from dynid.model.effects.interface import Floats
from dynid.robot import EffectSpec

#: Rounds of refining all shapes together, each with a smaller step.
STEPS = (0.5, 0.25, 0.12, 0.06)
#: Relative step of a shape parameter for its error.
STEP = 1e-3
#: Draws of the block bootstrap.
DRAWS = 400


@dataclass(frozen=True)
class Fitted:
    """One effect with its numbers.

    Attributes:
        pick: the accepted effect, its shape refined.
        values: amplitudes and shape parameters by name.
        errors: standard errors by name.
        units: units by name.
    """

    pick: Pick
    values: dict[str, float]
    errors: dict[str, float]
    units: dict[str, str]

    def spec(self, joints: Sequence[str]) -> EffectSpec:
        """Return the entry of the robot file."""
        place = self.pick.place or tuple(range(len(joints)))
        return EffectSpec(self.pick.effect.name, tuple(joints[j] for j in place), dict(self.values), dict(self.errors))


@dataclass(frozen=True)
class Shrink:
    """The gap before and after, on held-out rows; (n,) each.

    Attributes:
        before: rms without the effects [N m].
        after: rms with them [N m].
        ratio: lower and upper end of the 95 % interval of after / before, (n, 2).
        floor: the noise [N m].
    """

    before: Floats
    after: Floats
    ratio: Floats
    floor: Floats

    @property
    def closed(self) -> Floats:
        """Share of what noise does not explain that is gone, (n,)."""
        open_ = np.maximum(self.before**2 - self.floor**2, 1e-30)
        return (self.before**2 - self.after**2) / open_


def fit_picks(found: Search) -> tuple[list[Fitted], Board]:
    """Fit accepted effects and the model together, without unjudged columns."""
    board = found.setting.board(nuisance=False)
    theta = board.theta
    picks = list(found.picks)
    for _ in range(2):
        board = with_picks(found.setting.board(theta[: found.setting.base.reduction.rank], nuisance=False), picks)
        theta = board.theta
    for share in STEPS if any(p.effect.steps for p in picks) else ():
        picks = _refined(board, picks, share)
    board = with_picks(board, picks)
    fitted = [_numbers(board, picks, k) for k in range(len(picks))]
    if found.delay_proof is not None:
        fitted.append(_delay(found))
    return fitted, board


def _refined(board: Board, picks: list[Pick], share: float) -> list[Pick]:
    best = misfit(with_picks(board, picks))
    for k, pick in enumerate(picks):
        for name, (kind, size) in pick.effect.steps.items():
            for sign in (-1.0, 1.0):
                shape = picks[k].shape
                tried = [
                    *picks[:k],
                    replace(picks[k], shape=shape | {name: moved(shape[name], kind, size, sign * share)}),
                    *picks[k + 1 :],
                ]
                now = misfit(with_picks(board, tried))
                if now < best:
                    best, picks = now, tried
    return picks


def misfit(board: Board) -> float:
    """Return the whitened sum of squares that is left, the prior's included."""
    total = sum(float(e @ e) for e in board.e)
    if board.prior is not None:
        rest = board.prior[:, -1] - board.prior[:, :-1] @ board.theta[: board.size]
        total += float(rest @ rest)
    return total


def _numbers(board: Board, picks: Sequence[Pick], k: int) -> Fitted:
    """Return amplitudes and shape of one effect; its slopes join its columns, so that errors know of each other."""
    pick = picks[k]
    others = with_picks(board, [p for p in picks if p is not pick])
    base = {j: C[0] for j, C in columns_of(board, pick.effect, pick.place, [pick.shape]).items()}
    units = pick.effect.amplitudes(pick.shape)
    start = board.size + sum(len(p.effect.amplitudes(p.shape)) for p in picks[:k])
    beta = board.theta[start : start + len(units)]
    values = dict(zip(units, beta.tolist(), strict=True)) | dict(pick.shape)
    slopes = list(pick.effect.steps)
    columns = dict(base)
    for name in slopes:
        step = STEP * max(abs(pick.shape[name]), 1e-3)
        near = columns_of(board, pick.effect, pick.place, [pick.shape | {name: pick.shape[name] + step}])
        for j in base:
            columns[j] = np.vstack([columns[j], (beta @ (near[j][0] - base[j]) / step)[None]])
    covariance = prove(others, columns).covariance
    sizes = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    errors = dict(zip([*units, *slopes], sizes.tolist(), strict=True))
    return Fitted(
        replace(pick, proof=replace(prove(others, base), beta=beta)),
        values,
        errors,
        units | dict(pick.effect.shape_units),
    )


def _delay(found: Search) -> Fitted:
    from dynid.model.effects.catalogue import CATALOGUE

    assert found.delay_proof is not None
    proof = found.delay_proof
    pick = Pick(CATALOGUE["torque_delay"], (), {}, proof, float(proof.visible_rms))
    return Fitted(pick, {"delay": found.delay}, {"delay": float(np.sqrt(proof.covariance[0, 0]))}, {"delay": "s"})


def shrink(first: Setting, found: Search, fitted: Sequence[Fitted]) -> Shrink:
    """Return the gap on held-out rows before and after; both models are fitted to the training rows alone.

    Args:
        first: the setting before any delay was taken out.
        found: the search.
        fitted: what it found.
    """
    before = _held_residual(first, [])
    after = _held_residual(found.setting, [f.pick for f in fitted if f.pick.effect.name != "torque_delay"])
    n = len(before)
    rms = np.array([[_rms(x[j][0]) for j in range(n)] for x in (before, after)])
    ratio = np.array([_ratio(before[j], after[j], j) for j in range(n)])
    return Shrink(rms[0], rms[1], ratio, found.setting.noise.floor)


def _held_residual(setting: Setting, picks: Sequence[Pick]) -> list[tuple[Floats, NDArray[np.intp]]]:
    """Return held-out torque residuals and blocks of time of each joint, {(M_j,), (M_j,)}."""
    board = with_picks(setting.board(nuisance=False), picks)
    if picks:
        board = with_picks(setting.board(board.theta[: setting.base.reduction.rank], nuisance=False), picks)
    p = setting.base.reduction.rank
    theta, amplitudes = board.theta[:p], board.theta[board.size :]
    found = []
    held = cut(setting.stretches, setting.held)
    torques = [effect_torque(s.motion, s.filtered, picks, amplitudes) for s in board.stretches]
    times = blocks_of(held)
    for j in range(setting.stretches[0].motion.n):
        parts, blocks = [], []
        for s, extra, time in zip(held, torques, times, strict=True):
            use = s.use[:, j].copy()
            use[:ORDER] = False
            parts.append((s.tau[:, j] - s.W[:, j] @ theta - extra[j])[use])
            blocks.append(time[use])
        found.append((np.concatenate(parts), np.concatenate(blocks)))
    return found


def _rms(x: Floats) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else 0.0


def _ratio(before: tuple[Floats, NDArray[np.intp]], after: tuple[Floats, NDArray[np.intp]], seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values over blocks of time drawn with replacement, (2,)."""
    names, place = np.unique(before[1], return_inverse=True)
    if len(names) < 3 or len(before[0]) != len(after[0]):
        return np.array([0.0, np.inf])
    sums = np.array([np.bincount(place, x[0] ** 2, len(names)) for x in (before, after)])
    counts = np.random.default_rng(seed).multinomial(len(names), np.full(len(names), 1 / len(names)), DRAWS)
    b, a = counts @ sums[0], counts @ sums[1]
    interval: Floats = np.quantile(np.sqrt(a / np.maximum(b, 1e-30)), [0.025, 0.975])
    return interval
