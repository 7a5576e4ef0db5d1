"""The table of commands: ``dynid --help`` needs no module of theirs."""

from __future__ import annotations

import importlib
from collections.abc import Sequence
from typing import Any, NamedTuple

#: What every help is like.
CONTEXT = {"help_option_names": ["-h", "--help"], "max_content_width": 100}


class Entry(NamedTuple):
    """One line of the table of commands.

    Attributes:
        loop: heading of the map that it stands under; "" for the line of small commands.
        help: what it does.
        writes: what it writes.
        module: its module, where that has another name.
    """

    loop: str
    help: str
    writes: str = ""
    module: str = ""


COMMANDS: dict[str, Entry] = {
    "model": Entry("Loop 1", "DH robot file", "regressor.npz, fullregressor.npz"),
    "trajectory": Entry("Loop 2", "plan and preview", "trajectory.npz"),
    "record": Entry("Loop 2", "move the arm and log", "log.bag, log.npz            (needs ROS 1)"),
    "parameters": Entry(
        "Loop 3",
        "regressor on the log",
        "fullnumericregressor.npz, estimatedmotion.npz",
        module="identify",
    ),
    "identify": Entry("Loop 3", "least squares", "parameters.npz, report.html"),
    "validate": Entry(
        "Then", "predict a held-out log", "torque error of each joint", module="results"
    ),
    "gap": Entry("Then", "find, size and add a missing effect"),
    "check": Entry("", "look for mistakes in a robot file, a log or a result", module="files"),
    "convert": Entry("", "write a recording as .npz or .csv", module="files"),
    "import": Entry("", "make a robot file from a URDF", module="files"),
    "compare": Entry("", "one table over many results", module="results"),
    "run": Entry("", "many robots and logs from one list"),
    "report": Entry("", "rebuild report.html", module="results"),
    "export": Entry("", "write the identified model as URDF, YAML or code", module="results"),
    "demo": Entry("", "the whole workflow on a simulated arm with a hidden effect"),
    "simulate": Entry(
        "",
        "a log of an arm that follows a motion, with friction, noise and effects; no ROS",
        module="simulated",
    ),
    "sim-driver": Entry(
        "",
        "a simulated arm behind its driver's ROS topics, to rehearse a recording",
        module="simulated",
    ),
    "doctor": Entry("", "what works on this machine and what does not", module="about"),
    "explain": Entry("", "what an error or warning code means", module="about"),
    "completion": Entry("", "shell completion for bash, zsh or fish", module="about"),
}
#: Commands that were imported, by name.
IMPORTED: dict[str, Any] = {}


def command_of(name: str) -> Any:  # noqa: ANN401
    """Import a command."""
    importlib.import_module(f"dynid.cli.{COMMANDS[name].module or name}")
    return IMPORTED[name]


def shown(text: str, examples: Sequence[str]) -> str:
    """Return the help of a command: what it does, and examples, which click does not fold."""
    return "\n".join([text, "", "\b", "Examples:", *(f"  {line}" for line in examples)])
