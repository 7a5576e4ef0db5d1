"""Selected effects: what they are, and their columns and torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.gap.segments import SegmentRows
from dynid.gap.significance import Key, SignificanceTest, whitened_columns
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.interface import ArmMotion, Effect, Floats, Joints


@dataclass(frozen=True)
class SelectedEffect:
    """An effect that the search has taken.

    Attributes:
        effect: the effect.
        joints: the joint that it acts on, with the one that it follows for a pair; () for the whole arm.
        shape: its non-linear parameters.
        test: how sure it is.
        score: its gain less its penalty, the other selected effects in place.
        rivals: other effects and joints that explain as much.
        values: amplitudes and shape parameters by name, once it is refitted.
        std_errors: their standard errors; infinite for shape parameters that the rows do not determine.
        z: how many standard errors its amplitudes are from zero, all of them together, when the shape is free too.
        probability: posterior probability of the name against what has no name and against other names.
    """

    effect: Effect
    joints: Joints
    shape: dict[str, float]
    test: SignificanceTest
    score: float
    rivals: tuple[Key, ...] = ()
    values: dict[str, float] = field(default_factory=dict)
    std_errors: dict[str, float] = field(default_factory=dict)
    z: float = float("inf")
    probability: float = 1.0

    @property
    def name(self) -> str:
        """Identifier of the effect."""
        return self.effect.name

    @property
    def key(self) -> Key:
        """Identifier and joints."""
        return self.effect.name, self.joints

    @property
    def freedom(self) -> int:
        """Number of parameters that are fitted."""
        return len(self.test.amplitudes) + len(self.effect.steps)

    @property
    def free_shape(self) -> list[str]:
        """Shape parameters that are fitted: all but those that the rows do not determine."""
        return [name for name in self.effect.steps if np.isfinite(self.std_errors.get(name, 0.0))]

    def shape_z(self, name: str) -> float:
        """Return how many standard errors a shape parameter is from where the effect is part of the model."""
        error, null = self.std_errors.get(name, 0.0), self.effect.nulls.get(name, 0.0)
        if self.effect.steps[name][0] == "plus" or not error:
            return float("inf")
        return abs(self.values[name] - null) / error

    @property
    def amplitudes(self) -> list[str]:
        """Names of its amplitudes."""
        return list(self.effect.amplitudes(self.shape))

    @property
    def units(self) -> dict[str, str]:
        """Units of its parameters by name."""
        return self.effect.amplitudes(self.shape) | dict(self.effect.shape_units)


def stepped(value: float, kind: str, size: float, share: float) -> float:
    """Return a shape parameter after a share of its first step."""
    return value + size * share if kind == "plus" else value * size**share


def with_selected(
    regression: WhitenedRegression, selected: Sequence[SelectedEffect]
) -> WhitenedRegression:
    """Return the regression with selected effects."""
    columns = [
        whitened_columns(regression, one.effect, one.joints, [one.shape]) for one in selected
    ]
    return regression.with_effects([{j: C[0] for j, C in found.items()} for found in columns])


def at_sizes(selected: Sequence[SelectedEffect], amplitudes: Floats) -> list[SelectedEffect]:
    """Return effects with columns that are exact at the amplitudes that were found, one after the other, (k,)."""
    found, at = [], 0
    for one in selected:
        sizes = dict(zip(one.amplitudes, amplitudes[at:].tolist(), strict=False))
        found.append(replace(one, effect=one.effect.at_size(sizes)))
        at += len(one.amplitudes)
    return found


def torque_in_rows(
    segment: SegmentRows, selected: Sequence[SelectedEffect], amplitudes: Floats
) -> Floats:
    """Return the torque of effects in the rows of a segment, (n, M) [N m or N]; nothing where they do not act yet."""
    if not segment.is_new:
        return np.zeros((segment.motion.n, len(segment)))
    return segment.filtered(effect_torque(segment.motion, selected, amplitudes))


def effect_torque(
    motion: ArmMotion, selected: Sequence[SelectedEffect], amplitudes: Floats
) -> Floats:
    """Return the torque of effects along a motion, (n, N) [N m or N].

    Args:
        motion: the motion.
        selected: the effects.
        amplitudes: of all their columns, one after the other.
    """
    torque = np.zeros((motion.n, len(motion)))
    at = 0
    for one in selected:
        columns = one.effect.columns(motion, one.joints, one.shape)
        rows = list(one.effect.rows(one.joints, motion.n))
        torque[rows] += np.tensordot(amplitudes[at : at + len(columns)], columns, axes=1)
        at += len(columns)
    return torque
