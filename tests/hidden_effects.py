"""Logs of an arm with one thing hidden in it, for tests of ``dynid gap``.

Shares no code with dynid: the rigid body is Pinocchio's, the motion is a sum of sines under a second-order tracking
loop, and every effect is written anew here; two are outside the catalogue.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

ARMS = {
    "lwr4plus": ("kuka_lwr4plus", "lwr4plus_truth.yaml"),
    "kinova_gen2": ("kinova_gen2", "kinova_gen2_truth.yaml"),
}
ROOT = Path(__file__).parents[1]
RATE = 200.0
#: Largest share of the arm's own torques that is hidden: what no lab would overlook is no test.
OVERLOOKED = 0.3


@dataclass
class Arm:
    """A true arm."""

    model: pin.Model
    viscous: np.ndarray
    coulomb: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    loaded: bool = False

    def __post_init__(self):
        self.data = self.model.createData()

    @property
    def n(self):
        return self.model.nv

    def torque(self, q, qd, qdd, gravity=None):
        """Rigid-body torques of a motion, (N, n)."""
        old = self.model.gravity.linear.copy()
        if gravity is not None:
            self.model.gravity.linear = gravity
        states = zip(q, qd, qdd, strict=True)
        tau = np.array([pin.rnea(self.model, self.data, *state) for state in states])
        self.model.gravity.linear = old
        return tau

    def load(self, mass):
        """Fix a small ball to the last link, 4 cm beyond its frame and off the axis."""
        frame = self.model.frames[self.model.getFrameId("tip")]
        ball = pin.Inertia(mass, np.array([0.01, 0.02, 0.04]), 1e-4 * mass * np.eye(3))
        self.model.appendBodyToJoint(frame.parentJoint, ball, frame.placement)
        self.data, self.loaded = self.model.createData(), True

    def tip_force(self, q, force):
        """-J^T f of a constant force in the world at the last frame, (N, n)."""
        frame, kind = self.model.getFrameId("tip"), pin.LOCAL_WORLD_ALIGNED
        slopes = (pin.computeFrameJacobian(self.model, self.data, one, frame, kind) for one in q)
        return np.array([-slope[:3].T @ force for slope in slopes])


def load_arm(name):
    """Build the arm in Pinocchio from its DH table (standard convention) and the true bodies of its simulation."""
    robot, truth = ARMS[name]
    table = yaml.safe_load((ROOT / "robots" / f"{robot}.yaml").read_text())
    truth = yaml.safe_load((ROOT / "trajectories" / truth).read_text())
    scale = np.pi / 180 if table.get("angle_unit") == "deg" else 1.0
    model, parent, previous = pin.Model(), 0, pin.SE3.Identity()
    model.gravity.linear = np.array(table.get("gravity", [0, 0, -9.81]), float)
    limits = []
    for row, body in zip(table["joints"], truth["links"], strict=True):
        turn = pin.SE3(pin.utils.rotate("z", scale * row.get("theta_offset", 0.0)), np.zeros(3))
        twist = pin.utils.rotate("x", scale * row["twist"])
        after = pin.SE3(twist, np.array([row["a"], 0.0, row["d"]]))
        parent = model.addJoint(parent, pin.JointModelRZ(), previous * turn, row["name"])
        i = {frozenset(key[1:]): value for key, value in body["inertia_com"].items()}
        tensor = np.array([[i[frozenset((a, b))] for a in "xyz"] for b in "xyz"])
        link = pin.Inertia(body["mass"], np.array(body["com"], float), tensor)
        model.appendBodyToJoint(parent, link, after)
        previous = after
        given = row.get("limits", {})
        limits.append((*(given.get("position") or (-150, 150)), given.get("velocity") or 60))
    model.addFrame(pin.Frame("tip", parent, 0, previous, pin.FrameType.OP_FRAME))
    friction = (np.array(truth["friction"][kind], float) for kind in ("viscous", "coulomb"))
    return Arm(model, *friction, *(scale * np.array(limits, float).T))


def sines(arm, seconds, rng):
    """Return frequencies, sizes and phases of a motion of all joints inside their limits, each (n, 6)."""
    f = np.sort(rng.uniform(0.05, 0.75, (arm.n, 6)), axis=1)
    phase = rng.uniform(0, 2 * np.pi, (arm.n, 6))
    size = rng.uniform(0.4, 1.0, (arm.n, 6)) / f**0.8
    t = np.linspace(0, seconds, 2000)
    for j in range(arm.n):
        wave = size[j] @ np.sin(2 * np.pi * f[j, :, None] * t + phase[j, :, None])
        reach, speed = min(0.45 * (arm.upper[j] - arm.lower[j]), 1.6), min(arm.speed[j], 2.0)
        fastest = np.abs(np.gradient(wave, t)).max()
        size[j] *= min(reach / np.abs(wave).max(), 0.6 * speed / fastest)
    return f, size, phase


def motion(arm, plan, t, rng, wobble=1e-3):
    """Return q, qd, qdd of a tracked motion: 5 Hz loop, and wobbles that differ from repeat to repeat."""
    f, size, phase = plan
    q, qd, qdd = (np.zeros((len(t), arm.n)) for _ in range(3))
    for j in range(arm.n):
        loop = 1 / (1 - (f[j] / 5.0) ** 2 + 1.6j * f[j] / 5.0)
        w = np.append(2 * np.pi * f[j], 2 * np.pi * rng.uniform(0.1, 2.5, 8))
        tremble = wobble / 2 * np.exp(1j * rng.uniform(0, 7, 8))
        wave = np.append(size[j] * loop * np.exp(1j * phase[j]), tremble) * np.exp(
            1j * np.outer(t, w)
        )
        q[:, j], qd[:, j] = wave.imag.sum(1), (1j * w * wave).imag.sum(1)
        qdd[:, j] = (-(w**2) * wave).imag.sum(1)
    return q + (arm.lower + arm.upper) / 2, qd, qdd


@dataclass
class Case:
    """One case: what is hidden and how large; ``drop_outs`` loses rows as a recorder does."""

    arm: str
    effect: str
    joint: int
    size: float
    seed: int
    drop_outs: bool = False
    facts: dict = field(default_factory=dict)


def sharp(qd):
    """The true sign of friction."""
    return np.tanh(qd / 0.003)


def partner(case, n):
    """The other joint of a pair."""
    other = case.joint + (1 if case.seed % 2 else -1)
    return other if 0 <= other < n else case.joint - (other - case.joint)


def added_torque(arm, case, s, t, q, qd, rigid):
    """Torque of the hidden effect at unit size, (N, n)."""
    out, j = np.zeros_like(q), case.joint
    v, x, sign = qd[:, j], q[:, j], sharp(qd[:, j])
    k = partner(case, arm.n)
    laws = {
        "torque_offset": lambda: np.ones(len(q)),
        "asymmetric_viscous": lambda: np.abs(v),
        "load_friction": lambda: np.abs(rigid[:, j]) * sign,
        "position_friction": lambda: np.cos(s["h"] * x + s["phase"]) * sign,
        "spring": lambda: x + s["cubic"] * x**3,
        "joint_coupling": lambda: qd[:, k] + 0.5 * sharp(qd[:, k]),
        "coulomb_change": lambda: sign,
        "ringing": lambda: ringing(t, v),
    }
    if case.effect in laws:
        out[:, j] = laws[case.effect]()
    return out


def ringing(t, v):
    """Oscillation of 5.5 Hz that dies away after each reversal, (N,)."""
    out = np.zeros_like(v)
    for k in np.flatnonzero(np.diff(np.sign(v)) != 0):
        tail = np.arange(min(len(t) - k, 120)) / RATE
        way = np.sign(v[min(k + 2, len(v) - 1)])
        out[k : k + len(tail)] += way * np.exp(-tail / 0.15) * np.sin(2 * np.pi * 5.5 * tail)
    return out


def contacts(t, rng):
    """Three pushes that never repeat, (N,)."""
    out = np.zeros_like(t)
    for at in rng.uniform(0, t[-1], 3):
        out += rng.normal() * 3 * np.exp(-(((t - at) / 0.4) ** 2))
    return out


def scale_of(case):
    """Size of one unit of ``case.size`` (visible rms near the noise's) for effects that are not plain torques."""
    soft = 1.4e-4 if case.joint <= 1 else 5e-4 if case.joint == 2 else 1.4e-3
    return {
        "encoder_offset": 0.03,
        "joint_elasticity": soft,
        "torque_delay": 0.004,
        "payload": 0.02,
    }.get(case.effect, 1.0)


def with_drop_outs(t, q, tau, rng):
    """Return a log of which single rows and two stretches are lost."""
    kept = rng.random(len(t)) > 0.01
    for at in rng.uniform(t[0] + 2, t[-1] - 2, 2):
        kept &= np.abs(t - at) > rng.uniform(0.05, 0.4)
    return t[kept], q[kept], tau[kept]


def noisy(white, shape, rng):
    """Draw torque noise: white and coloured, (N, n)."""
    coloured, drive = np.zeros(shape), rng.normal(size=shape)
    for k in range(1, len(drive)):
        coloured[k] = 0.96 * coloured[k - 1] + 0.28 * drive[k]
    return white * rng.normal(size=shape) + 0.15 * white * coloured


def simulate(case, trajectories=3, repeats=2, seconds=20.0, hide=True, plan_seed=None):
    """Return a list of logs (t, q, tau); without ``hide`` the same motion and noise without the effect.

    The visible size is relative to the noise: the effect's torque is scaled so that its rms after a crude baseline
    (offset, position, velocity, sign of the joint) is taken off equals ``case.size`` times the noise.
    """
    arm, rng = load_arm(case.arm), np.random.default_rng(case.seed)
    s = case.facts
    s |= {"phase": rng.uniform(0, 6.3), "h": rng.integers(1, 3), "cubic": rng.uniform(0, 0.3)}
    plans_rng = np.random.default_rng(case.seed + 1000 if plan_seed is None else plan_seed)
    white = np.array([0.14, 0.14, 0.14, 0.14, 0.085, 0.08, 0.075])[: arm.n]
    size = case.size * scale_of(case) if hide else 0.0
    logs, clock, scale = [], 0.0, None
    plans = [sines(arm, seconds, plans_rng) for _ in range(trajectories)]
    if case.effect == "payload" and size:
        arm.load(10 * size)
    for plan in (plan for plan in plans for _ in range(repeats)):
        t = np.arange(round(seconds * RATE)) / RATE
        q, qd, qdd = motion(arm, plan, t, rng)
        rigid = arm.torque(q, qd, qdd)
        shown, turning = q.copy(), qd.copy()
        if case.effect == "joint_elasticity":
            bend = size * rigid[:, case.joint]
            shown[:, case.joint] += bend
            turning[:, case.joint] += np.gradient(bend, t)
        if case.effect == "encoder_offset":
            shown[:, case.joint] += size
        tau = rigid + arm.viscous * turning + arm.coulomb * sharp(turning)
        extra = added_torque(arm, case, s, t, q, qd, rigid)
        if scale is None:
            scale = min(unit(extra, q, qd, white, case), overlooked(extra, tau, case))
            s |= {"amount": case.size * scale, "shown": case.size * scale_of(case)}
        tau = tau + (case.size if hide else 0.0) * scale * extra
        if case.effect == "contacts" and hide:
            tau[:, case.joint] += case.size * 0.3 * white[case.joint] * contacts(t, rng)
        if case.effect == "torque_delay" and size:
            tau = np.stack([np.interp(t - size, t, column) for column in tau.T], axis=1)
        tau = tau + noisy(white, qd.shape, rng)
        step = 1.7e-5 if case.arm == "lwr4plus" else 1e-4
        log = clock + t, np.round(shown / step) * step, tau
        logs.append(with_drop_outs(*log, rng) if case.drop_outs else log)
        clock += seconds + 5.0
    return logs


def overlooked(extra, tau, case):
    """Return the factor that makes an effect as large, on some joint, as what a lab would just overlook."""
    share = [np.sqrt(np.mean(a**2) / np.mean(b**2)) for a, b in zip(extra.T, tau.T, strict=True)]
    return OVERLOOKED / max(max(share) * case.size, 1e-9)


def unit(extra, q, qd, white, case):
    """Return the factor that makes the visible rms of an effect equal to the noise's after the filter."""
    j = case.joint
    if not np.any(extra[:, j]):
        return 0.0
    v, x = qd[:, j], q[:, j]
    basis = [np.ones(len(q)), v, np.tanh(v / 0.01), np.sin(x), np.cos(x)]
    kept = {"torque_offset": basis[1:], "spring": basis[:3], "coulomb_change": basis[:1]}
    A = np.column_stack(kept.get(case.effect, basis))
    left = extra[:, j] - A @ np.linalg.lstsq(A, extra[:, j], rcond=None)[0]
    return 0.33 * white[j] / np.sqrt(np.mean(left**2))
