"""Logs of an arm with one thing hidden in it, for the blind benchmark of ``dynid gap`` and for tests.

Shares no code with dynid: the rigid body is Pinocchio's, the motion is a sum of sines under a second-order tracking
loop, and every effect is written anew here, several with another law than the catalogue's (LuGre for Dahl, other
exponents, exact delays and elastic kinematics). Effects outside the catalogue are here too.
"""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pinocchio as pin
import yaml

TRUTH = {"lwr4plus": "lwr4plus_truth.yaml", "kinova_gen2": "kinova_gen2_truth.yaml"}
ROBOT = {"lwr4plus": "kuka_lwr4plus", "kinova_gen2": "kinova_gen2"}
ROOT = Path(__file__).parents[1]
RATE = 200.0

CATALOGUE = (
    "torque_offset",
    "asymmetric_viscous",
    "stribeck",
    "nonlinear_viscous",
    "load_friction",
    "torque_gain",
    "warmup_friction",
    "torque_drift",
    "position_friction",
    "torque_ripple",
    "spring",
    "end_stop",
    "motor_inertia",
    "joint_coupling",
    "torque_crosstalk",
    "joint_elasticity",
    "encoder_offset",
    "presliding_hysteresis",
    "base_tilt",
    "torque_delay",
    "tool_force",
)
OUTSIDE = (
    "ringing",
    "contacts",
    "wandering",
    "odd_cross",
    "load_viscous",
    "sum_angle",
    "dead_band",
)
CHANGES = (
    "payload",
    "coulomb_change",
    "viscous_change",
    "torque_offset",
    "tool_force",
    "base_tilt",
)
#: What a model that is fitted again absorbs, and what recordings have without anything being missing.
DECOYS = (
    "plain",
    "spikes",
    "loud_when_fast",
    "joint_at_rest",
    "heavier_tool",
    "more_friction",
    "drifting_tracking",
)
#: What recorders do to stamps and rows.
MESSES = ("uneven", "late_stamps", "drop_outs", "one_repeat", "uneven and drop_outs", "slow")
#: Largest share of the arm's own torques that is hidden: what no lab would overlook is no test.
LARGEST = {"torque_crosstalk": 0.2, "torque_gain": 0.2, "load_friction": 0.2, "load_viscous": 0.3}
#: The same for effects that are torques of their own: the arm's weight would take up an offset of 50 N m.
OVERLOOKED = 0.3
WHOLE_ARM = ("base_tilt", "torque_delay", "tool_force", "payload")


@dataclass
class Arm:
    """A true arm."""

    model: pin.Model
    viscous: np.ndarray
    coulomb: np.ndarray
    lower: np.ndarray
    upper: np.ndarray
    speed: np.ndarray
    data: object = field(default=None)
    loaded: bool = False

    @property
    def n(self):
        return self.model.nv

    def torque(self, q, qd, qdd, gravity=None):
        """Rigid-body torques of a motion, (N, n)."""
        old = self.model.gravity.linear.copy()
        if gravity is not None:
            self.model.gravity.linear = gravity
        rnea, model, data = pin.rnea, self.model, self.data
        tau = np.array([rnea(model, data, *state) for state in zip(q, qd, qdd, strict=True)])
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
        found = np.empty_like(q)
        frame = self.model.getFrameId("tip")
        for k, one in enumerate(q):
            jacobian = pin.computeFrameJacobian(
                self.model, self.data, one, frame, pin.LOCAL_WORLD_ALIGNED
            )
            found[k] = -jacobian[:3].T @ force
        return found


def load_arm(name):
    """Build the arm in Pinocchio from its DH table (standard convention) and the true bodies of its simulation."""
    table = yaml.safe_load((ROOT / "robots" / f"{ROBOT[name]}.yaml").read_text())
    truth = yaml.safe_load((ROOT / "trajectories" / TRUTH[name]).read_text())
    scale = np.pi / 180 if table.get("angle_unit") == "deg" else 1.0
    model = pin.Model()
    model.gravity.linear = np.array(table.get("gravity", [0, 0, -9.81]), float)
    parent, previous = 0, pin.SE3.Identity()
    lower, upper, speed = [], [], []
    for row, body in zip(table["joints"], truth["links"], strict=True):
        turn = pin.SE3(pin.utils.rotate("z", scale * row.get("theta_offset", 0.0)), np.zeros(3))
        twist = scale * row["twist"]
        after = pin.SE3(pin.utils.rotate("x", twist), np.array([row["a"], 0.0, row["d"]]))
        parent = model.addJoint(parent, pin.JointModelRZ(), previous * turn, row["name"])
        i = body["inertia_com"]
        tensor = np.array(
            [
                [i["ixx"], i["ixy"], i["ixz"]],
                [i["ixy"], i["iyy"], i["iyz"]],
                [i["ixz"], i["iyz"], i["izz"]],
            ]
        )
        model.appendBodyToJoint(
            parent, pin.Inertia(body["mass"], np.array(body["com"], float), tensor), after
        )
        previous = after
        limits = row.get("limits", {})
        low, high = limits.get("position") or (-150, 150)
        lower.append(scale * low), upper.append(scale * high)
        speed.append(scale * (limits.get("velocity") or 60))
    model.addFrame(pin.Frame("tip", parent, 0, previous, pin.FrameType.OP_FRAME))
    friction = truth["friction"]
    arm = Arm(
        model,
        np.array(friction["viscous"], float),
        np.array(friction["coulomb"], float),
        np.array(lower),
        np.array(upper),
        np.array(speed),
    )
    arm.data = model.createData()
    return arm


def sines(arm, seconds, rng):
    """Return frequencies, sine and cosine weights of a motion of all joints inside their limits, each (n, S)."""
    count = 6
    f = np.sort(rng.uniform(0.05, 0.75, (arm.n, count)), axis=1)
    phase = rng.uniform(0, 2 * np.pi, (arm.n, count))
    size = rng.uniform(0.4, 1.0, (arm.n, count)) / f**0.8
    t = np.linspace(0, seconds, 2000)
    for j in range(arm.n):
        wave = (size[j, :, None] * np.sin(2 * np.pi * f[j, :, None] * t + phase[j, :, None])).sum(
            axis=0
        )
        slope = np.gradient(wave, t)
        reach = 0.45 * (arm.upper[j] - arm.lower[j])
        size[j] *= min(
            min(reach, 1.6) / np.abs(wave).max(), 0.6 * min(arm.speed[j], 2.0) / np.abs(slope).max()
        )
    return f, size, phase


def motion(arm, plan, t, rng, wobble=1e-3):
    """Return q, qd, qdd of a tracked motion: 5 Hz loop, and wobbles that differ from repeat to repeat.

    A plan is frequencies, sine and cosine weights, or a function of time that returns q, qd, qdd as they are planned.
    """
    if callable(plan):
        rest = np.zeros((arm.n, 1)), np.zeros((arm.n, 1)), np.zeros((arm.n, 1))
        tremble = motion(arm, rest, t, rng, wobble)
        return tuple(a + b for a, b in zip(plan(t - t[0]), tremble, strict=True))
    f, size, phase = plan
    q, qd, qdd = (np.zeros((len(t), arm.n)) for _ in range(3))
    centre = (arm.lower + arm.upper) / 2
    for j in range(arm.n):
        w = 2 * np.pi * f[j]
        loop = 1 / (1 - (f[j] / 5.0) ** 2 + 1.6j * f[j] / 5.0)
        small = 2 * np.pi * rng.uniform(0.1, 2.5, 8)
        w = np.append(w, small)
        tremble = (
            wobble / 2 if size[j].any() or size.shape[1] == 1 else 0.0
        )  # a joint that rests is held by its friction
        weight = np.append(
            size[j] * loop * np.exp(1j * phase[j]), tremble * np.exp(1j * rng.uniform(0, 7, 8))
        )
        wave = weight * np.exp(1j * np.outer(t, w))
        q[:, j], qd[:, j], qdd[:, j] = (
            wave.imag.sum(1),
            (1j * w * wave).imag.sum(1),
            (-(w**2) * wave).imag.sum(1),
        )
    return q + centre * (size.shape[1] > 1), qd, qdd


@dataclass
class Case:
    """One case: what is hidden and how large."""

    arm: str
    effect: str
    joint: int
    size: float
    seed: int
    extra: str = "plain"
    facts: dict = field(default_factory=dict)
    #: A torque of the joint that has no name, of t, q, qd, qdd and the rigid-body torques.
    law: object = None


def lugre(q, qd, dt, stiffness_length):
    """Bristle deflection over its steady state, LuGre law without damping, integrated in time."""
    z = np.zeros_like(q)
    for k in range(1, len(q)):
        v = qd[k]
        rate = abs(v) / stiffness_length * dt
        z[k] = (z[k - 1] + v * dt / stiffness_length) / (1 + rate)
    return z


def sharp(qd):
    """The true sign of friction."""
    return np.tanh(qd / 0.003)


def shape_of(case, rng, arm):
    """Draw the hidden effect's non-linear parameters."""
    return {
        "vs": float(np.exp(rng.uniform(np.log(0.03), np.log(0.12)))),
        "d": rng.uniform(0.8, 2.0),
        "p": rng.uniform(1.6, 2.4),
        "tw": rng.uniform(20, 60),
        "k": float(np.exp(rng.uniform(np.log(12), np.log(120)))),
        "phase": rng.uniform(0, 6.3),
        "side": rng.choice([-1.0, 1.0]),
        "at": rng.uniform(0.3, 0.7),
        "cubic": rng.uniform(0, 0.3),
        "h": rng.integers(1, 3),
        "delta": float(np.exp(rng.uniform(np.log(0.005), np.log(0.08)))),
        "neighbour": None,
        "direction": rng.normal(size=3),
        "law": rng.integers(2),
        "tau": rng.uniform(30, 100),
    }


def sizes_of(case):
    """Return the true sizes of what a simulated case hid, by the catalogue's parameters; {} where it has another law."""
    s, amount = case.facts, case.facts.get("amount", 0.0)
    h, turn = np.cos(s["phase"]), np.sin(s["phase"])
    found = {
        "torque_offset": {"c": amount},
        "asymmetric_viscous": {"a": amount},
        "load_friction": {"a": amount},
        "torque_gain": {"g": amount},
        "motor_inertia": {"Im": amount},
        "end_stop": {"a": amount},
        "torque_crosstalk": {"a": amount},
        "joint_coupling": {"a": amount, "b": 0.5 * amount},
        "nonlinear_viscous": {"p": s["p"]},
        "position_friction": {"a": amount * h, "b": -amount * turn},
        "stribeck": {"a": amount, "vs": s["vs"]},
        "coulomb_change": {"c": amount},
        "viscous_change": {"v": amount},
    }
    whole = {"encoder_offset": "offset", "joint_elasticity": "compliance", "torque_delay": "delay"}
    if case.effect in whole:
        return {whole[case.effect]: float(case.size * s["scale_of"])}
    return {name: float(value) for name, value in found.get(case.effect, {}).items()}


def truth_of(name):
    """Return mass, centre of mass and inertia about it of each true link of an arm, in its DH frame."""
    links = yaml.safe_load((ROOT / "trajectories" / TRUTH[name]).read_text())["links"]
    places = [[["ixx", "ixy", "ixz"], ["ixy", "iyy", "iyz"], ["ixz", "iyz", "izz"]]] * len(links)
    tensors = [
        [[b["inertia_com"][x] for x in row] for row in place]
        for b, place in zip(links, places, strict=True)
    ]
    return [
        (b["mass"], np.array(b["com"]), np.array(i)) for b, i in zip(links, tensors, strict=True)
    ]


def partner(case, n):
    """The other joint of a pair."""
    other = case.joint + (1 if case.seed % 2 else -1)
    return other if 0 <= other < n else case.joint - (other - case.joint)


def added_torque(arm, case, s, t, q, qd, qdd, rigid, span):
    """Torque of the hidden effect at unit size, (N, n); ``t`` runs over the whole session."""
    out = np.zeros_like(q)
    j = case.joint
    v, x, sign = qd[:, j], q[:, j], sharp(qd[:, j])
    low, high = span
    e = case.effect
    if case.law is not None:
        out[:, j] = case.law(t, q, qd, qdd, rigid)
    elif e == "torque_offset":
        out[:, j] = 1
    elif e == "asymmetric_viscous":
        out[:, j] = np.abs(v)
    elif e == "stribeck":
        out[:, j] = np.exp(-((np.abs(v) / s["vs"]) ** s["d"])) * sign
    elif e == "nonlinear_viscous":
        out[:, j] = np.sign(v) * np.abs(v) ** s["p"]
    elif e == "load_friction":
        out[:, j] = np.abs(rigid[:, j]) * sign
    elif e == "torque_gain":
        out[:, j] = rigid[:, j] + arm.viscous[j] * v + arm.coulomb[j] * sign
    elif e == "warmup_friction":
        out[:, j] = np.exp(-t / s["tw"]) * (arm.coulomb[j] * sign + arm.viscous[j] * v)
    elif e == "torque_drift":
        out[:, j] = t / 100 if s["law"] else 1 - np.exp(-t / s["tau"])
    elif e == "position_friction":
        out[:, j] = np.cos(s["h"] * x + s["phase"]) * sign
    elif e == "torque_ripple":
        out[:, j] = np.cos(s["k"] * x + s["phase"])
    elif e == "spring":
        out[:, j] = x + s["cubic"] * x**3
    elif e == "end_stop":
        out[:, j] = np.maximum(0, s["side"] * (x - (low[j] + s["at"] * (high[j] - low[j]))))
    elif e == "motor_inertia":
        out[:, j] = qdd[:, j]
    elif e == "joint_coupling":
        k = partner(case, arm.n)
        out[:, j] = qd[:, k] + 0.5 * sharp(qd[:, k])
    elif e == "torque_crosstalk":
        out[:, j] = rigid[:, partner(case, arm.n)]
    elif e == "presliding_hysteresis":
        out[:, j] = arm.coulomb[j] * (lugre(x, v, 1 / RATE, s["delta"]) - sign)
    elif e == "tool_force":
        out[:] = arm.tip_force(q, s["direction"] / np.linalg.norm(s["direction"]))
    elif e == "coulomb_change":
        out[:, j] = sign
    elif e == "viscous_change":
        out[:, j] = v
    elif e == "ringing":
        turns = np.flatnonzero(np.diff(np.sign(v)) != 0)
        for k in turns:
            tail = np.arange(min(len(t) - k, 120)) / RATE
            out[k : k + len(tail), j] += (
                np.sign(v[min(k + 2, len(v) - 1)])
                * np.exp(-tail / 0.15)
                * np.sin(2 * np.pi * 5.5 * tail)
            )
    elif e == "odd_cross":
        out[:, j] = np.sin(2 * x) * np.sign(qd[:, partner(case, arm.n)]) * np.abs(v)
    elif e == "load_viscous":
        out[:, j] = rigid[:, j] * v
    elif e == "sum_angle":
        out[:, j] = np.cos(6 * (x + q[:, partner(case, arm.n)]))
    elif e == "dead_band":
        band = 0.4 * np.std(rigid[:, j])
        out[:, j] = -np.clip(rigid[:, j] - np.mean(rigid[:, j]), -band, band)
    return out


def disturbance(case, t, rng):
    """What never repeats: contacts, a wandering sensor, (N,)."""
    if case.effect == "contacts":
        out = np.zeros_like(t)
        for at in rng.uniform(0, t[-1], 3):
            out += rng.normal() * 3 * np.exp(-(((t - at) / 0.4) ** 2))
        return out
    if case.effect == "wandering":
        steps = rng.normal(size=len(t)) / np.sqrt(RATE)
        return np.cumsum(steps) / 1.5
    return None


def scale_of(case, arm):
    """Size of one unit of ``case.size`` (visible rms near the noise's) for effects that are not plain torques."""
    soft = 1.4e-4 if case.joint <= 1 else 5e-4 if case.joint == 2 else 1.4e-3
    return {
        "encoder_offset": 0.03,
        "joint_elasticity": soft,
        "torque_delay": 0.004,
        "base_tilt": 0.003,
        "payload": 0.02,
    }.get(case.effect, 1.0)


def prepared(case, arm, plans):
    """Change the true arm or its motions as a decoy asks for."""
    if case.extra == "heavier_tool":
        arm.load(0.8)
    if case.extra == "more_friction":
        arm.coulomb, arm.viscous = 1.3 * arm.coulomb, 0.8 * arm.viscous
    if case.extra == "joint_at_rest":
        for _, size, _ in plans:
            size[case.joint % (arm.n - 1) + 1] = 0.0
    if case.extra == "slow":
        for f, _, _ in plans:
            f *= 0.6


def sampling(case, seconds, rng):
    """Return the times of the samples, (N,) [s]."""
    t = np.arange(round(seconds * RATE)) / RATE
    return t + rng.uniform(-0.3, 0.3, len(t)) / RATE if "uneven" in case.extra else t


def recorded(case, t, q, tau, rng):
    """Return a log as a recorder leaves it: stamps that come late, rows that are lost."""
    kept = np.ones(len(t), dtype=bool)
    if "drop_outs" in case.extra:
        kept = rng.random(len(t)) > 0.01
        for at in rng.uniform(t[0] + 2, t[-1] - 2, 2):
            kept &= np.abs(t - at) > rng.uniform(0.05, 0.4)
    if "late_stamps" in case.extra:
        t = np.maximum.accumulate(t + rng.exponential(0.1 / RATE, len(t))) + 1e-7 * np.arange(
            len(t)
        )
    return t[kept], q[kept], tau[kept]


def noisy(case, white, qd, rng):
    """Draw torque noise: white and coloured, and what a decoy adds, (N, n)."""
    coloured = np.zeros_like(qd)
    drive = rng.normal(size=qd.shape)
    for k in range(1, len(qd)):
        coloured[k] = 0.96 * coloured[k - 1] + 0.28 * drive[k]
    noise = white * rng.normal(size=qd.shape) + 0.15 * white * coloured
    if case.extra == "spikes":
        hit = rng.random(qd.shape) < 5e-4
        noise += hit * white * rng.choice([-12.0, 12.0], qd.shape)
    if case.extra == "loud_when_fast":
        noise *= 0.7 + np.abs(qd) / np.abs(qd).max(axis=0).clip(1e-9)
    return noise


def simulate(
    case,
    trajectories=3,
    repeats=2,
    seconds=20.0,
    hide=True,
    plan_seed=None,
    start_at=0.0,
    further=None,
    shrink=1.0,
    in_step=None,
):
    """Return a list of logs (t, q, tau); without ``hide`` the same motion and noise without the effect.

    ``further`` is one more motion, driven once, (seconds, function of time); ``shrink`` makes all others smaller, and the
    two neighbours of joint ``in_step`` move as one in them.

    The visible size is relative to the noise: the effect's torque is scaled so that its rms after a crude baseline
    (offset, position, velocity, sign, acceleration of the joint) is taken off equals ``case.size`` times the noise.
    """
    arm = load_arm(case.arm)
    rng = np.random.default_rng(case.seed)
    s = shape_of(case, rng, arm)
    case.facts = s
    plans_rng = np.random.default_rng(case.seed + 1000 if plan_seed is None else plan_seed)
    wobble = (
        shrink
        * (4e-3 if case.extra == "drifting_tracking" else 1e-3)
        * (0.1 if in_step is not None else 1.0)
    )
    white = np.array([0.14, 0.14, 0.14, 0.14, 0.085, 0.08, 0.075])[: arm.n]
    logs = []
    clock = start_at
    scale = None
    tilt = None
    plans = [sines(arm, seconds, plans_rng) for _ in range(trajectories)]
    prepared(case, arm, plans)
    for f, size, phase in plans:
        size *= shrink
        if in_step is not None:
            one, other = in_step - 1, in_step + 1
            least = min(np.abs(size[one]).sum(), np.abs(size[other]).sum())
            f[other], phase[other] = f[one], phase[one]
            size[other] = size[one] = least * size[one] / np.abs(size[one]).sum()
    if further is not None:
        plans.append(further[1])
    for number, plan in enumerate(plans):
        last = further is not None and number == trajectories
        seconds = further[0] if last else seconds
        for _ in range(1 if last or (case.extra == "one_repeat" and number) else repeats):
            t = sampling(case, seconds, rng)
            q, qd, qdd = motion(arm, plan, t, rng, wobble)
            gravity = arm.model.gravity.linear.copy()
            size = case.size * scale_of(case, arm) if hide else 0.0
            if case.effect == "base_tilt":
                tilt = s["phase"] if tilt is None else tilt
                gravity = gravity + 9.81 * size * np.array([np.cos(tilt), np.sin(tilt), 0])
            if case.effect == "payload" and size and not arm.loaded:
                arm.load(10 * size)
            rigid = arm.torque(q, qd, qdd, gravity)
            shown = q.copy()
            moving_qd = qd
            if case.effect == "joint_elasticity" and size:
                bend = size * rigid[:, case.joint]
                shown[:, case.joint] += bend
                moving_qd = qd.copy()
                moving_qd[:, case.joint] += np.gradient(bend, t)
            if case.effect == "encoder_offset":
                shown[:, case.joint] += size
            tau = rigid + arm.viscous * moving_qd + arm.coulomb * sharp(moving_qd)
            extra = added_torque(
                arm,
                case,
                s,
                clock + t,
                q,
                qd,
                qdd,
                rigid,
                (q.min(0), q.max(0)) if scale is None else s["span"],
            )
            if scale is None:
                s["span"] = (q.min(0), q.max(0))
                scale = unit(extra, q, qd, qdd, white, case)
                scale = min(
                    scale,
                    LARGEST.get(case.effect, np.inf) / max(case.size, 1e-9),
                    overlooked(extra, tau, case),
                )
            tau = tau + (case.size if hide else 0.0) * scale * extra
            s |= {"amount": case.size * scale, "scale_of": scale_of(case, arm)}
            wander = disturbance(case, t, rng)
            if wander is not None and hide:
                tau[:, case.joint] += case.size * 0.3 * white[case.joint] * wander
            if case.effect == "torque_delay" and size:
                tau = np.stack([np.interp(t - size, t, column) for column in tau.T], axis=1)
            tau = tau + noisy(case, white, qd, rng)
            step = 1.7e-5 if case.arm == "lwr4plus" else 1e-4
            logs.append(recorded(case, clock + t, np.round(shown / step) * step, tau, rng))
            clock += seconds + 5.0
    return logs


def overlooked(extra, tau, case):
    """Return the factor that makes an effect as large, on some joint, as what a lab would just overlook."""
    share = [np.sqrt(np.mean(a**2) / np.mean(b**2)) for a, b in zip(extra.T, tau.T, strict=True)]
    return OVERLOOKED / max(max(share) * case.size, 1e-9)


def unit(extra, q, qd, qdd, white, case):
    """Return the factor that makes the visible rms of an effect equal to the noise's after the filter."""
    rms = []
    for j in range(q.shape[1]):
        if not np.any(extra[:, j]):
            continue
        basis = [
            np.ones(len(q)),
            qd[:, j],
            np.tanh(qd[:, j] / 0.01),
            np.sin(q[:, j]),
            np.cos(q[:, j]),
        ]
        if case.effect in ("torque_offset", "torque_drift"):
            basis = basis[1:]
        if case.effect in ("spring", "end_stop"):
            basis = basis[:3]
        if case.effect in ("coulomb_change", "viscous_change"):
            basis = basis[:1]
        A = np.column_stack(basis)
        left = extra[:, j] - A @ np.linalg.lstsq(A, extra[:, j], rcond=None)[0]
        rms.append(np.sqrt(np.mean(left**2)) / (0.33 * white[j]))
    # A drift goes on while the other motions are recorded.
    return 1 / max(rms) / (4.0 if case.effect == "torque_drift" else 1.0) if rms else 0.0
