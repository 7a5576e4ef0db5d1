"""The messages and services of kinova_msgs that dynid uses, made at run time: no catkin workspace is needed.

Source: Kinovarobotics/kinova-ros, kinova_msgs/msg and kinova_msgs/srv.
"""

from __future__ import annotations

from functools import cache
from types import SimpleNamespace
from typing import Any

from dynid.drivers.ros import import_ros

_SEVEN = "\n".join(f"float32 joint{i}" for i in range(1, 8)) + "\n"
MESSAGES = {"JointAngles": _SEVEN, "JointVelocity": _SEVEN, "JointTorque": _SEVEN}
SERVICES = {
    "Stop": "---\nstring stop_result\n",
    "Start": "---\nstring start_result\n",
    "ZeroTorques": "---\n",
    "SetTorqueControlMode": "uint16 state\n---\n",
}


@cache
def message(name: str) -> Any:  # noqa: ANN401 - a generated class
    """Return the class of a message, such as ``"JointVelocity"``."""
    kind = f"kinova_msgs/{name}"
    return import_ros("genpy.dynamic").generate_dynamic(kind, MESSAGES[name])[kind]


@cache
def service(name: str) -> Any:  # noqa: ANN401
    """Return the class of a service as rospy wants it: request and response classes and a checksum over both."""
    kind, text = f"kinova_msgs/{name}", SERVICES[name]
    generate = import_ros("genpy.dynamic").generate_dynamic
    halves = {}
    for part, lines in zip(("Request", "Response"), text.split("---\n"), strict=True):
        halves[part] = generate(f"{kind}{part}", lines)[f"{kind}{part}"]
    genmsg = import_ros("genmsg")
    import_ros("genmsg.gentools")
    context = genmsg.msg_loader.MsgContext.create_default()
    spec = genmsg.msg_loader.load_srv_from_string(context, text, kind)
    return SimpleNamespace(
        _type=kind,
        _md5sum=genmsg.gentools.compute_md5(context, spec),
        _request_class=halves["Request"],
        _response_class=halves["Response"],
    )
