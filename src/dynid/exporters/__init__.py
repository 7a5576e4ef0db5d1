"""Identified parameters in the formats that simulators and controllers read.

``parameters.npz -> arm.urdf, arm.xml, arm.yaml, arm.c, arm.py, arm.m``
"""

from dynid.exporters.code import MATLAB, PYTHON, C
from dynid.exporters.effects_file import EFFECTS
from dynid.exporters.full_model import FullModel, full_model
from dynid.exporters.interface import (
    Agreement,
    Format,
    IdentifiedArm,
    LoadingFailed,
    NotTried,
    Provenance,
)
from dynid.exporters.mjcf import MJCF
from dynid.exporters.urdf import URDF
from dynid.exporters.yaml import YAML

#: The formats by name.
FORMATS = {each.name: each for each in (URDF, MJCF, YAML, C, PYTHON, MATLAB)}

__all__ = [
    "EFFECTS",
    "FORMATS",
    "Agreement",
    "Format",
    "FullModel",
    "IdentifiedArm",
    "LoadingFailed",
    "NotTried",
    "Provenance",
    "full_model",
]
