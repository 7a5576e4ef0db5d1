"""Identified parameters in the formats that simulators and controllers read: one file a format.

``parameters.npz -> arm.urdf, arm.xml, arm.sdf, arm.yaml, arm.c, arm.py, arm.m``
"""

from dynid.exporters.formats import FORMATS
from dynid.exporters.full_model import WholeArm, whole_arm
from dynid.exporters.interface import Agreement, Exporter, LoadingFailed, Source

__all__ = ["FORMATS", "Agreement", "Exporter", "LoadingFailed", "Source", "WholeArm", "whole_arm"]
