"""manifest.yaml: what was recorded, with what, by whom, and how it ended. Written before the first motion and after."""

from __future__ import annotations

import json
import platform
import socket
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from dynid.disk import sha256, write_text
from dynid.drivers.ros import Node
from dynid.files.trajectoryfile import person
from dynid.robot import Robot
from dynid.text import yaml_text
from dynid.version import __version__

SCHEMA = "dynid/manifest/1"


def write_manifest(path: Path, facts: Mapping[str, Any]) -> None:
    """Write facts as YAML, complete or not at all."""
    as_json = json.dumps(facts, default=lambda x: x.tolist() if hasattr(x, "tolist") else str(x))
    write_text(path, yaml_text(json.loads(as_json), width=110, default_flow_style=False))


def beginning(robot: Robot, node: Node, command: str) -> dict[str, Any]:
    """Return what is known before the first motion: who, when, where, with which versions."""
    return {
        "schema": SCHEMA,
        "verdict": "running",
        "command": command,
        "operator": person(),
        "host": socket.gethostname(),
        "began": now(),
        "robot": {
            "name": robot.name,
            "file": str(robot.path),
            "sha256": sha256(robot.path) if robot.path else None,
        },
        "versions": {
            "dynid": __version__,
            "python": platform.python_version(),
            "ros": _parameter(node, "/rosdistro"),
            "ros_comm": _parameter(node, "/rosversion"),
        },
        "master": node.uri,
    }


def now() -> str:
    """Return date and time, ISO 8601."""
    return datetime.now().astimezone().isoformat(timespec="seconds")


def _parameter(node: Node, name: str) -> str | None:
    value = node.parameter(name)
    return None if value is None else str(value).strip()
