"""Torque effects beyond the rigid body, in files by family, each effect a set of regressor columns."""
