"""Loop 1: robot.yaml -> regressor.npz -> fullregressor.npz.

The recursive Newton-Euler equations become a straight-line program for the regressor P with tau = P gamma
(Paper Eq. 8), and dependent columns are grouped into base parameters (Paper Eq. 13).
"""

from dynid.model.regressor import Model, build_model

__all__ = ["Model", "build_model"]
