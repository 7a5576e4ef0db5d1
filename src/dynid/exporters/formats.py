"""The formats by name."""

from __future__ import annotations

from dynid.exporters.c import CExporter
from dynid.exporters.interface import Exporter
from dynid.exporters.matlab import MatlabExporter
from dynid.exporters.mjcf import MjcfExporter
from dynid.exporters.python import PythonExporter
from dynid.exporters.sdf import SdfExporter
from dynid.exporters.urdf import UrdfExporter
from dynid.exporters.yaml import YamlExporter

FORMATS: dict[str, Exporter] = {
    "urdf": UrdfExporter(),
    "mjcf": MjcfExporter(),
    "sdf": SdfExporter(),
    "yaml": YamlExporter(),
    "c": CExporter(),
    "python": PythonExporter(),
    "matlab": MatlabExporter(),
}
