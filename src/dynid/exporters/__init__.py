"""Identified parameters in the formats that simulators and controllers read.

``parameters.npz -> arm.urdf, arm.xml, arm.yaml, arm.c, arm.py, arm.m``
"""

from dynid.exporters.code import MATLAB, PYTHON, C
from dynid.exporters.mjcf import MJCF
from dynid.exporters.urdf import URDF
from dynid.exporters.yaml import YAML

#: The formats by name.
FORMATS = {each.name: each for each in (URDF, MJCF, YAML, C, PYTHON, MATLAB)}
