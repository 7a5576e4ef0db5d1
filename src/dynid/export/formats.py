"""The formats by name."""

from __future__ import annotations

from dynid.export.c import CExporter
from dynid.export.interface import Exporter
from dynid.export.matlab import MatlabExporter
from dynid.export.mjcf import MjcfExporter
from dynid.export.python import PythonExporter
from dynid.export.sdf import SdfExporter
from dynid.export.urdf import UrdfExporter
from dynid.export.yaml import YamlExporter

FORMATS: dict[str, Exporter] = {
    "urdf": UrdfExporter(),
    "mjcf": MjcfExporter(),
    "sdf": SdfExporter(),
    "yaml": YamlExporter(),
    "c": CExporter(),
    "python": PythonExporter(),
    "matlab": MatlabExporter(),
}
