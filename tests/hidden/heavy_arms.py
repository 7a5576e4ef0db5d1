"""Heavy arms with and without a counterbalance on axis 2.

Shares no code with dynid: geometry like a UR10's or like a forging robot's, links of random lumps, a mass of
60 to 250 kg, Pinocchio for the rigid body, and a cylinder between base and upper arm that pushes as a gas spring,
a hydraulic accumulator or a coil spring does. The robot file holds the right geometry.
"""

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

import hidden_effects as hidden

KINDS = ("industrial", "slender")
#: How the mass of an arm is spread over its links, about.
SPREAD = np.array([0.28, 0.28, 0.21, 0.12, 0.07, 0.04])


@dataclass
class Heavy:
    """A drawn arm.

    Attributes:
        arm: it in Pinocchio, with friction.
        rows: its DH table.
        bodies: mass, centre of mass and inertia about that of each link, in its DH frame.
        weight: torque of gravity at axis 2 with the arm stretched out [N m].
        carries: what the counterbalance carries of it at most; 0 for none.
        shape: how the counterbalance pushes.
        crank: squares' ratio 2 b c / (b^2 + c^2) of its crank.
        level: largest torque of gravity of each joint [N m].
        counterweight: whether the upper arm goes on behind its axis.
    """

    arm: hidden.Arm
    rows: list
    bodies: list
    weight: float
    carries: float
    shape: str
    crank: float
    level: np.ndarray
    counterweight: bool

    def assists(self, q):
        """Torque of the counterbalance at axis 2, (N,) [N m]; none where the upper arm is upright."""
        lean = np.pi / 2 - q[:, 1]
        length = np.sqrt(1 - self.crank * np.cos(lean)) / np.sqrt(1 - self.crank * np.cos(1.0))
        push = {
            "sine": length,
            "cylinder": 1.0,
            "spring": 0.5 + 1.5 * (length - length.min() + 0.2),
            "gas": length**0.7,
        }
        return self.carries * self.weight * np.sin(lean) * push[self.shape] / length


def table_of(kind, size):
    """DH rows (a, twist, d) of an arm, standard convention [m, rad], and centres of its joints' travel [rad]."""
    if kind == "industrial":
        rows = [
            (0.16, 90, 0.4),
            (0.6, 0, 0),
            (0.08, 90, 0),
            (0, -90, 0.62),
            (0, 90, 0),
            (0, 0, 0.12),
        ]
        centre = [0, 90, 0, 0, 30, 0]
    else:
        rows = [
            (0, 90, 0.13),
            (0.61, 0, 0),
            (0.57, 0, 0),
            (0, 90, 0.16),
            (0, -90, 0.12),
            (0, 0, 0.09),
        ]
        centre = [0, 90, -90, 0, 60, 0]
    return [(size * a, twist, size * d) for a, twist, d in rows], np.radians(centre)


def lumps(rng, start, end, mass, size):
    """Return mass, centre and inertia about it of a link of random ellipsoids between two points."""
    parts, shares = [], rng.dirichlet(np.full(4, 2.0))
    for share, at in zip(shares, rng.uniform(-0.15, 1.0, 4), strict=True):
        radii = size * rng.uniform(0.05, 0.16, 3)
        place = start + at * (end - start) + size * rng.normal(size=3) * 0.03
        parts.append(
            pin.Inertia(
                share * mass, place, pin.Inertia.FromEllipsoid(1.0, *radii).inertia * share * mass
            )
        )
    total = parts[0]
    for part in parts[1:]:
        total = total + part
    return total


def draw(seed, with_counterbalance):
    """Draw an arm."""
    rng, extra = np.random.default_rng([seed, 8211]), np.random.default_rng([seed, 391])
    kind, mass = str(rng.choice(KINDS)), float(np.exp(rng.uniform(np.log(60), np.log(250))))
    size = (mass / 60) ** (1 / 3) * rng.uniform(0.9, 1.3) * (1.3 if kind == "slender" else 1.2)
    rows, centre = table_of(kind, size)
    masses = SPREAD * np.exp(0.25 * rng.normal(size=6))
    masses *= mass / masses.sum()
    model, parent, previous = pin.Model(), 0, pin.SE3.Identity()
    model.gravity.linear = np.array([0, 0, -9.81])
    bodies, counterweight = [], False
    for k, ((a, twist, d), m) in enumerate(zip(rows, masses, strict=True)):
        after = pin.SE3(pin.utils.rotate("x", np.radians(twist)), np.array([a, 0.0, d]))
        parent = model.addJoint(parent, pin.JointModelRZ(), previous, f"joint_{k + 1}")
        start = after.inverse().translation
        body = lumps(rng, start, np.zeros(3), float(m), size)
        if k == 1 and extra.random() < 0.33:
            weight, behind = extra.uniform(0.2, 0.8) * m, -extra.uniform(0.2, 0.5) * start + start
            body = body + pin.Inertia(weight, behind, 0.005 * size**2 * weight * np.eye(3))
            counterweight = True
        bodies.append((body.mass, body.lever.copy(), body.inertia.copy()))
        model.appendBodyToJoint(parent, body, after)
        previous = after
    model.addFrame(pin.Frame("tip", parent, 0, previous, pin.FrameType.OP_FRAME))
    reach = np.radians([150, 65, 60, 150, 100, 170])
    arm = hidden.Arm(
        model,
        np.zeros(6),
        np.zeros(6),
        centre - reach,
        centre + reach,
        np.radians([100, 90, 100, 150, 150, 200]),
    )
    poses = centre + rng.uniform(-1, 1, (200, 6)) * reach * 0.8
    still = arm.torque(poses, 0 * poses, 0 * poses)
    level = np.maximum(np.abs(still).max(axis=0), 0.02 * np.abs(still).max())
    arm.coulomb, arm.viscous = (
        0.04 * level * rng.uniform(0.5, 1.5, 6),
        0.04 * level * rng.uniform(0.5, 1.5, 6),
    )
    turn = np.column_stack([np.sin(poses[:, 1]), np.cos(poses[:, 1]), np.ones(200)])
    weight = float(np.hypot(*np.linalg.lstsq(turn, still[:, 1], rcond=None)[0][:2]))
    carries = float(rng.uniform(0.5, 1.6)) if with_counterbalance else 0.0
    shape = str(rng.choice(["sine", "cylinder", "spring", "gas"]))
    return Heavy(
        arm,
        rows,
        bodies,
        weight,
        carries,
        shape,
        float(rng.uniform(0.05, 0.4)),
        level,
        counterweight,
    )


def robot_table(heavy):
    """Return the robot file's content: the geometry alone."""
    joints = [
        {"name": f"joint_{k}", "a": float(a), "twist": float(t), "d": float(d)}
        for k, (a, t, d) in enumerate(heavy.rows, 1)
    ]
    return {
        "name": "heavy",
        "convention": "standard",
        "angle_unit": "deg",
        "gravity": [0, 0, -9.81],
        "joints": joints,
        "torque": {"source": "motor_torque"},
        "coulomb": {"shape": "smooth", "velocity": 0.3},
        "driver": {"kind": "generic", "topic": "/joint_states"},
    }


def simulate(heavy, seed, trajectories=2):
    """Return logs (t, q, tau) of 12 s."""
    arm, logs = heavy.arm, []
    rng, plans_rng = np.random.default_rng([seed, 1]), np.random.default_rng([seed, 2])
    for k in range(trajectories):
        t = np.arange(0, 12, 1 / hidden.RATE)
        q, qd, qdd = hidden.motion(arm, hidden.sines(arm, 12.0, plans_rng), t, rng)
        tau = arm.torque(q, qd, qdd) + arm.viscous * qd + arm.coulomb * hidden.sharp(qd)
        tau[:, 1] -= heavy.assists(q)
        tau = tau + hidden.noisy(0.012 * heavy.level, qd.shape, rng)
        logs.append((17.0 * k + t, np.round(q / 2e-5) * 2e-5, tau))
    return logs
