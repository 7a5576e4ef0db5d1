"""Torque effects beyond the rigid body: one file an effect, each a set of regressor columns."""

from dynid.model.effects.coulomb import coulomb_sign
from dynid.model.effects.interface import Column, State
from dynid.model.effects.joint import coupled_motor_columns, joint_columns

__all__ = ["Column", "State", "coulomb_sign", "coupled_motor_columns", "joint_columns"]
