"""The truth of a simulated arm: bodies, rotors, friction and sensors, as stored with the logs made from it.

Reads ``trajectories/*_truth.yaml``; gives a ``Plant`` and its parameters by the names that identification uses.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dynid.arrays import Floats
from dynid.files import packaged
from dynid.files.robotkeys import BODY, NUMBER, TEXT, mapping, or_null, several
from dynid.files.yamlfile import read_yaml
from dynid.log import Log
from dynid.model.parameters import prior_bodies
from dynid.robot import LINK_PARAMETERS, Body, Robot
from dynid.sim import tuning
from dynid.sim.arm import Friction, SimulatedArm, SimulatedRun

_PLANT = ("robot", "links", "rotor_inertia", "friction", "sensors")
_NOTES = ("about", "source", "motion", "logs")
_BODY = mapping({"name": TEXT, **BODY}, lambda name="", **body: Body(**body), [*BODY])


@dataclass(frozen=True)
class Sensors:
    """Sensors of all joints; every noise is white and normal.

    Attributes:
        torque_noise: standard deviation, (n,) [N m or N].
        position_step: resolution of the encoders [rad or m]; 0 for none.
        velocity_noise: standard deviation [rad/s or m/s]; None when the driver gives no velocity.
        stamp_jitter: standard deviation of stamp minus sampling time [s].
    """

    torque_noise: tuple[float, ...]
    position_step: float
    velocity_noise: float | None
    stamp_jitter: float

    @classmethod
    def perfect(cls, n: int) -> Sensors:
        """Return sensors that tell the truth."""
        return cls((0.0,) * n, 0.0, 0.0, 0.0)

    def measure(self, truth: SimulatedRun, names: tuple[str, ...], rng: np.random.Generator) -> Log:
        """Return the log of a recording.

        Args:
            truth: what the arm did.
            names: names of the columns.
            rng: source of the noise.
        """
        period = float(truth.t[1] - truth.t[0])
        late = rng.normal(0.0, self.stamp_jitter, len(truth.t))
        jitter = np.clip(late, -0.45 * period, 0.45 * period)
        q, qd = stepped(truth.q, self.position_step), None
        tau = truth.tau + rng.normal(0.0, self.torque_noise, truth.tau.shape)
        if self.velocity_noise is not None:
            qd = truth.qd + rng.normal(0.0, self.velocity_noise, truth.qd.shape)
        return Log(truth.t + jitter, q, tau, names, qd, tau_unit="Nm", extra={"q_ref": truth.q_ref})


def stepped(values: Floats, step: float) -> Floats:
    """Return values at a resolution, as they are for a step of zero."""
    return np.round(values / step) * step if step else values


@dataclass(frozen=True)
class Plant:
    """A true arm.

    Attributes:
        robot: name of its robot file.
        bodies: one per link, in the DH frames.
        rotor_inertia: on the joint side, (n,) [kg m^2 or kg].
        friction: of the joints.
        sensors: what measuring adds.
    """

    robot: str
    bodies: tuple[Body, ...]
    rotor_inertia: tuple[float, ...]
    friction: Friction
    sensors: Sensors

    def arm(self, robot: Robot, dt: float = tuning.PHYSICS_STEP_S) -> SimulatedArm:
        """Return the simulated arm, with this step of the physics [s]."""
        return SimulatedArm(robot, self.bodies, self.friction, self.rotor_inertia, dt=dt)

    def parameters(self) -> dict[str, float]:
        """Return the true parameters by name: m1, mcx1, ... Izz1, Im1 of each link and fv1, fc1, fo1 of each joint."""
        kinds, of = (*LINK_PARAMETERS, "fv", "fc", "fo"), self.friction
        bodies = [body.parameters() for body in self.bodies]
        drives = np.transpose([self.rotor_inertia, of.viscous, of.coulomb, of.offset])
        rows = enumerate(np.hstack([bodies, drives]).tolist(), start=1)
        return {f"{kind}{i}": x for i, row in rows for kind, x in zip(kinds, row, strict=True)}


def plant_of(robot: Robot) -> Plant:
    """Return the truth that ships for an arm; without one, what the robot file says, frictionless and noiseless."""
    for path in sorted(packaged("trajectories").glob("*_truth.yaml")):
        plant = read_plant(path)
        if plant.robot == robot.slug:
            return plant
    n = robot.n
    return Plant(robot.slug, prior_bodies(robot), (0.0,) * n, Friction.none(n), Sensors.perfect(n))


def read_plant(path: Path) -> Plant:
    """Read the truth of a simulated arm, a file such as ``trajectories/lwr4plus_truth.yaml``."""
    top = read_yaml(path).mapping(_PLANT + _NOTES, required=_PLANT)
    bodies = tuple(map(_BODY, top["links"].items()))
    each = several(NUMBER, len(bodies))
    friction = dict.fromkeys(("viscous", "coulomb", "offset", "velocity"), each)
    sensors = {
        "torque_noise": each,
        "position_step": NUMBER,
        "velocity_noise": or_null(NUMBER),
        "stamp_jitter": NUMBER,
    }
    return Plant(
        robot=top["robot"].text(),
        bodies=bodies,
        rotor_inertia=each(top["rotor_inertia"]),
        friction=mapping(friction, Friction, [*friction])(top["friction"]),
        sensors=mapping(sensors, Sensors, [*sensors])(top["sensors"]),
    )
