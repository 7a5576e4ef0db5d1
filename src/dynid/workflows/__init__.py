"""One function per command, for programs and notebooks: options and objects in, frozen results out.

Nothing here prints, asks or parses a command line. Progress goes through ``dynid.progress``, questions are callbacks.
Modules are imported when they are first used, so that help of a command does not wait for them.
"""

from __future__ import annotations

import importlib
from types import ModuleType
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.workflows import (
        check,
        compare,
        convert,
        demo,
        doctor,
        drive_gains,
        export,
        gap,
        identify,
        import_urdf,
        model,
        parameters,
        record,
        report,
        sim_driver,
        simulate,
        simulator_gap,
        trajectory,
        validate,
    )

__all__ = [
    "check",
    "compare",
    "convert",
    "demo",
    "doctor",
    "drive_gains",
    "export",
    "gap",
    "identify",
    "import_urdf",
    "model",
    "parameters",
    "record",
    "report",
    "sim_driver",
    "simulate",
    "simulator_gap",
    "trajectory",
    "validate",
]


def __getattr__(name: str) -> ModuleType:
    """Import a module when it is first used."""
    if name not in __all__:
        raise AttributeError(f"module 'dynid.workflows' has no attribute '{name}'")
    return importlib.import_module(f"dynid.workflows.{name}")
