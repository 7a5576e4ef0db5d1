"""The truth of a simulated arm: bodies, rotors, friction and sensors, as stored beside the logs made from it.

Reads ``trajectories/*_truth.yaml``; gives a ``Plant`` and its parameters by the names that identification uses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dynid.files.yamlfile import Value, read_yaml
from dynid.robot import LINK_PARAMETERS, Body, Robot
from dynid.sim.arm import Friction, SimulatedArm
from dynid.sim.sensors import Sensors

_TENSOR = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")
_PLANT = ("robot", "links", "rotor_inertia", "friction", "sensors")
_NOTES = ("about", "source", "motion", "logs")


@dataclass(frozen=True)
class Plant:
    """A true arm.

    Attributes:
        robot: name of its robot file.
        bodies: one a link, in the DH frames.
        rotor_inertia: on the joint side, (n,) [kg m^2 or kg].
        friction: of the joints.
        sensors: what measuring adds.
    """

    robot: str
    bodies: tuple[Body, ...]
    rotor_inertia: tuple[float, ...]
    friction: Friction
    sensors: Sensors

    def arm(self, robot: Robot) -> SimulatedArm:
        """Return the arm in PyBullet."""
        return SimulatedArm(robot, self.bodies, self.friction, self.rotor_inertia)

    def parameters(self) -> dict[str, float]:
        """Return the true parameters by name: m1, mcx1, ... Izz1, Im1 of each link and fv1, fc1, fo1 of each joint."""
        found: dict[str, float] = {}
        for i, (body, rotor) in enumerate(zip(self.bodies, self.rotor_inertia, strict=True), start=1):
            values = [*body.parameters().tolist(), rotor]
            found |= {f"{name}{i}": value for name, value in zip(LINK_PARAMETERS, values, strict=True)}
        parts = {"fv": self.friction.viscous, "fc": self.friction.coulomb, "fo": self.friction.offset}
        for prefix, each in parts.items():
            found |= {f"{prefix}{i}": value for i, value in enumerate(each, start=1)}
        return found


def read_plant(path: Path) -> Plant:
    """Read the truth of a simulated arm, a file such as ``trajectories/lwr4plus_truth.yaml``."""
    top = read_yaml(path).mapping(_PLANT + _NOTES, required=_PLANT)
    bodies = tuple(_body(value) for value in top["links"].items())
    n = len(bodies)
    parts = ("viscous", "coulomb", "offset", "velocity")
    friction = top["friction"].mapping(parts, required=parts)
    sensing = ("torque_noise", "position_step", "velocity_noise", "stamp_jitter")
    sensors = top["sensors"].mapping(sensing, required=sensing)
    return Plant(
        robot=top["robot"].text(),
        bodies=bodies,
        rotor_inertia=_numbers(top["rotor_inertia"], n),
        friction=Friction(**{part: _numbers(friction[part], n) for part in parts}),
        sensors=Sensors(
            torque_noise=_numbers(sensors["torque_noise"], n),
            position_step=sensors["position_step"].number(),
            velocity_noise=None if sensors["velocity_noise"].is_null else sensors["velocity_noise"].number(),
            stamp_jitter=sensors["stamp_jitter"].number(),
        ),
    )


def _numbers(value: Value, n: int) -> tuple[float, ...]:
    return tuple(item.number() for item in value.items(n))


def _body(value: Value) -> Body:
    keys = value.mapping(("name", "mass", "com", "inertia_com"), required=("mass", "com", "inertia_com"))
    x, y, z = _numbers(keys["com"], 3)
    tensor = keys["inertia_com"].mapping(_TENSOR, required=_TENSOR)
    xx, xy, xz, yy, yz, zz = (tensor[name].number() for name in _TENSOR)
    return Body(keys["mass"].number(), (x, y, z), (xx, xy, xz, yy, yz, zz))
