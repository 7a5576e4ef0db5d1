"""The table of commands: ``dynid --help`` needs no module of theirs."""

from __future__ import annotations

import importlib
from inspect import cleandoc
from typing import Any, NamedTuple

#: What every help is like.
CONTEXT = {
    "help_option_names": ["-h", "--help"],
    "max_content_width": 100,
    "show_default": True,
}


class Entry(NamedTuple):
    """One line of the table of commands.

    Attributes:
        module: its module.
        help: what it does.
        loop: heading of the map that it stands under; "" for the line of small commands.
        writes: what it writes.
    """

    module: str
    help: str
    loop: str = ""
    writes: str = ""


COMMANDS: dict[str, Entry] = {
    "model": Entry("loops", "DH robot file", "Loop 1", "regressor.npz, fullregressor.npz"),
    "trajectory": Entry("trajectory", "plan and preview", "Loop 2", "trajectory.npz"),
    "record": Entry(
        "record", "move the arm and log", "Loop 2", "log.bag, log.npz            (needs ROS 1)"
    ),
    "parameters": Entry(
        "loops", "regressor on the log", "Loop 3", "fullnumericregressor.npz, estimatedmotion.npz"
    ),
    "identify": Entry("loops", "least squares", "Loop 3", "parameters.npz, report.html"),
    "validate": Entry("results", "predict a held-out log", "Then", "torque error of each joint"),
    "gap": Entry("gap", "find, size and add a missing effect", "Then"),
    "check": Entry("results", "look for mistakes in a robot file, a log or a result"),
    "convert": Entry("results", "write a recording as .npz or .csv"),
    "import": Entry("results", "make a robot file from a URDF"),
    "compare": Entry("results", "one table over many results"),
    "run": Entry("results", "many robots and logs from one list"),
    "report": Entry("results", "rebuild report.html"),
    "export": Entry("results", "write the identified model as URDF, YAML or code"),
    "demo": Entry("demo", "the whole workflow on a simulated arm with a hidden effect"),
    "simulate": Entry(
        "simulated",
        "a log of an arm that follows a motion, with friction, noise and effects; no ROS",
    ),
    "sim-driver": Entry(
        "simulated", "a simulated arm behind its driver's ROS topics, to rehearse a recording"
    ),
    "doctor": Entry("about", "what works on this machine and what does not"),
    "explain": Entry("about", "what an error or warning code means"),
    "completion": Entry("about", "shell completion for bash, zsh or fish"),
}
#: Commands that were imported, by name.
IMPORTED: dict[str, Any] = {}


def command_of(name: str) -> Any:  # noqa: ANN401
    """Import a command."""
    importlib.import_module(f"dynid.cli.{COMMANDS[name].module}")
    return IMPORTED[name]


def shown(docstring: str | None) -> str:
    """Return the help of a command: what it does, and examples, which click does not fold."""
    return cleandoc(str(docstring)).replace("Examples:", "\b\nExamples:")
