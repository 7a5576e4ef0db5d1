"""dynid identifies the dynamic parameters of robot arms and finds what the model still misses.

Three loops and a fourth: ``base_model`` (DH file to base regressor), ``plan_trajectory`` (excitation), ``identify`` and
``validate`` (least squares on a log), and ``find_gap`` (name the effect that is missing). Each of them takes objects
and returns objects; the command line calls the same functions.

    import dynid
    arm = dynid.load_robot("kuka_lwr4plus")
    result = dynid.identify(arm, [dynid.load_log("run1.bag", arm)])
    result.table()

Names are imported when they are first used, so ``import dynid`` costs nothing.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from dynid.version import __version__

if TYPE_CHECKING:
    from dynid import loading as loading
    from dynid.estimation.result import Identification
    from dynid.loading import load_log, load_robot
    from dynid.log import Log
    from dynid.model.base_model import BaseModel
    from dynid.motion import Motion
    from dynid.options import LogOptions
    from dynid.robot import Robot
    from dynid.trajectory.options import PlanOptions
    from dynid.workflows.compare import compare
    from dynid.workflows.drive_gains import find_drive_gains
    from dynid.workflows.export import ExportedModel, export
    from dynid.workflows.gap import Gap, earlier_logs, find_gap, load
    from dynid.workflows.identify import find_payload, identify
    from dynid.workflows.model import base_model
    from dynid.workflows.options import (
        ExportOptions,
        GapOptions,
        IdentifyOptions,
        ModelOptions,
        SimulateOptions,
        ValidateOptions,
    )
    from dynid.workflows.parameters import Observations, observe
    from dynid.workflows.report import Report, report
    from dynid.workflows.simulate import Simulation, simulate
    from dynid.workflows.simulator_gap import compare_in_simulator
    from dynid.workflows.trajectory import Plan, plan_trajectory
    from dynid.workflows.validate import Validation, validate


#: Where each public name lives.
_HOMES = {
    "BaseModel": "dynid.model.base_model",
    "ExportOptions": "dynid.workflows.options",
    "ExportedModel": "dynid.workflows.export",
    "Gap": "dynid.workflows.gap",
    "GapOptions": "dynid.workflows.options",
    "Identification": "dynid.estimation.result",
    "IdentifyOptions": "dynid.workflows.options",
    "Log": "dynid.log",
    "LogOptions": "dynid.options",
    "ModelOptions": "dynid.workflows.options",
    "Motion": "dynid.motion",
    "Observations": "dynid.workflows.parameters",
    "Plan": "dynid.workflows.trajectory",
    "PlanOptions": "dynid.trajectory.options",
    "Report": "dynid.workflows.report",
    "Robot": "dynid.robot",
    "SimulateOptions": "dynid.workflows.options",
    "Simulation": "dynid.workflows.simulate",
    "ValidateOptions": "dynid.workflows.options",
    "Validation": "dynid.workflows.validate",
    "base_model": "dynid.workflows.model",
    "compare": "dynid.workflows.compare",
    "compare_in_simulator": "dynid.workflows.simulator_gap",
    "earlier_logs": "dynid.workflows.gap",
    "export": "dynid.workflows.export",
    "find_drive_gains": "dynid.workflows.drive_gains",
    "find_gap": "dynid.workflows.gap",
    "find_payload": "dynid.workflows.identify",
    "identify": "dynid.workflows.identify",
    "load": "dynid.workflows.gap",
    "load_log": "dynid.loading",
    "load_robot": "dynid.loading",
    "observe": "dynid.workflows.parameters",
    "plan_trajectory": "dynid.workflows.trajectory",
    "report": "dynid.workflows.report",
    "simulate": "dynid.workflows.simulate",
    "validate": "dynid.workflows.validate",
}

__all__ = [
    "BaseModel",
    "ExportOptions",
    "ExportedModel",
    "Gap",
    "GapOptions",
    "Identification",
    "IdentifyOptions",
    "Log",
    "LogOptions",
    "ModelOptions",
    "Motion",
    "Observations",
    "Plan",
    "PlanOptions",
    "Report",
    "Robot",
    "SimulateOptions",
    "Simulation",
    "ValidateOptions",
    "Validation",
    "__version__",
    "base_model",
    "compare",
    "compare_in_simulator",
    "earlier_logs",
    "export",
    "find_drive_gains",
    "find_gap",
    "find_payload",
    "identify",
    "load",
    "load_log",
    "load_robot",
    "observe",
    "plan_trajectory",
    "report",
    "simulate",
    "validate",
]


def __getattr__(name: str) -> Any:  # noqa: ANN401
    """Import a public name when it is first used."""
    if name in ("errors", "loading"):
        return importlib.import_module(f"dynid.{name}")
    if name not in _HOMES:
        raise AttributeError(f"module 'dynid' has no attribute '{name}'")
    found = getattr(importlib.import_module(_HOMES[name]), name)
    globals()[name] = found
    return found


def __dir__() -> list[str]:
    return sorted([*__all__, "errors"])
