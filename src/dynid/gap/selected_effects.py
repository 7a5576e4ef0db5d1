"""Effects that were found, with their numbers, and their columns and torques."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dynid.arrays import Floats
from dynid.gap.gap_rows import GapRows
from dynid.gap.regression import Regression
from dynid.model.effects.catalogue import DELAY
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import Joints

#: Identifier and joints of an effect.
Key = tuple[str, Joints]


@dataclass(frozen=True)
class SelectedEffect:
    """An effect that was found.

    Attributes:
        effect: the effect.
        joints: the joint that it acts on, with the one that it follows for a pair; () for the whole arm.
        shape: its non-linear parameters.
        joint: the joint that shows it most.
        visible: root mean square of what it explains there, in units of the noise.
        log_odds: that it is there, against what has no name.
        p_value: chance of such amplitudes when there is no effect.
        rivals: other effects and joints that explain as much.
        always: whether something that was always there explains as much, where it is asked what has changed.
        values: amplitudes and shape parameters by name.
        std_errors: their standard errors; infinite for shape parameters that the rows do not determine.
        probability: posterior probability of the name against what has no name and against other names.
    """

    effect: Effect
    joints: Joints
    shape: dict[str, float]
    joint: int
    visible: float
    log_odds: float
    p_value: float
    rivals: tuple[Key, ...] = ()
    always: bool = False
    values: dict[str, float] = field(default_factory=dict)
    std_errors: dict[str, float] = field(default_factory=dict)
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
    def amplitudes(self) -> list[str]:
        """Names of its amplitudes."""
        return list(self.effect.amplitudes(self.shape))

    @property
    def units(self) -> dict[str, str]:
        """Units of its parameters by name."""
        return self.effect.amplitudes(self.shape) | dict(self.effect.shape_units)


def with_columns(effects: Sequence[SelectedEffect]) -> list[SelectedEffect]:
    """Return the effects that have columns: all but a delay, which is taken out of the logs."""
    return [one for one in effects if one.name != DELAY]


def with_selected(regression: Regression, selected: Sequence[SelectedEffect]) -> Regression:
    """Return the regression with the columns of selected effects."""
    return regression.with_effects(
        [regression.columns_of(x.effect, x.joints, x.shape) for x in with_columns(selected)]
    )


def torque_in_rows(
    rows: GapRows, selected: Sequence[SelectedEffect], amplitudes: Floats
) -> list[Floats]:
    """Return the torque of each effect with columns in rows, (M, n) [N m or N]; nothing where it does not act yet.

    Args:
        rows: the rows.
        selected: the effects.
        amplitudes: of all their columns, one after the other.
    """
    torques, at = [], 0
    for one in with_columns(selected):
        own = amplitudes[at : at + len(one.amplitudes)]
        at += len(own)
        torques.append(np.zeros(rows.tau.shape))
        for j, columns in rows.columns(one.effect, one.joints, [one.shape]).items():
            torques[-1][:, j] = own @ columns[0]
    return torques
