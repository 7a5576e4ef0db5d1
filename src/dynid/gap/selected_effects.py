"""Accepted effects: what they are, and their columns and torques beside the model."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.gap.significance import Proof, columns_of
from dynid.gap.whitened_regression import Board
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Place


@dataclass(frozen=True)
class Pick:
    """An accepted effect.

    Attributes:
        effect: the effect.
        place: where.
        shape: its non-linear parameters.
        proof: how sure it is.
        net: its evidence after the price, the other accepted effects in place.
        equals: other effects and places that explain as much.
    """

    effect: Effect
    place: Place
    shape: dict[str, float]
    proof: Proof
    net: float
    equals: tuple[tuple[str, Place], ...] = ()

    @property
    def key(self) -> tuple[str, Place]:
        """Identifier and place."""
        return self.effect.name, self.place

    @property
    def freedom(self) -> int:
        """Number of parameters that are fitted."""
        return len(self.proof.beta) + len(self.effect.steps)


def moved(value: float, kind: str, size: float, share: float) -> float:
    """Return a shape parameter moved by a share of its first step."""
    return value + size * share if kind == "plus" else value * size**share


def with_picks(board: Board, picks: Sequence[Pick]) -> Board:
    """Return the board with effects accepted."""
    added = []
    for pick in picks:
        columns = columns_of(board, pick.effect, pick.place, [pick.shape])
        added.append({j: C[0] for j, C in columns.items()})
    board = replace(board, added=added)
    board.solve()
    return board


def effect_torque(
    motion: ArmMotion, filtered: Callable[[Floats], Floats], picks: Sequence[Pick], amplitudes: Floats
) -> Floats:
    """Return the filtered torque of effects with given amplitudes, (n, M)."""
    total = np.zeros((motion.n, len(motion)))
    at = 0
    for pick in picks:
        columns = pick.effect.columns(motion, pick.place, pick.shape)
        total[list(pick.effect.rows(pick.place, motion.n))] += np.tensordot(
            amplitudes[at : at + len(columns)], columns, axes=1
        )
        at += len(columns)
    return np.asarray(filtered(total))
