"""Cases for ``dynid gap`` from physics alone: arms, motions, recorders and hidden things that share nothing with it.

    python benchmarks/gap_stranger.py --seeds 101-103 --cases 0-59 [--only single] [--out answers.json]

Pinocchio computes all torques. An arm of 3 to 7 random bodies follows a motion under a controller; its torque is rigid
bodies, rotors, viscous and Coulomb friction, and what is hidden. A recorder adds coloured and quantised noise. Each
case is a folder as a user would have it (robot file, logs) with ``truth.json``. *Visible size*: what least squares with
the true rigid body, rotor and friction columns leave of the hidden thing in data without noise, over the noise below
10 Hz, on the joint that shows it most. Sets: clean, single, double, outside (nothing of the catalogue), changed (the
model comes from logs before the change). Seeds 1 to 19 are for development, 100 and above for proof. Cases are made once
and kept in ``--folder``; answers are kept in ``--out``, which is another file for
other code.
"""

import itertools
import json
import os
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
from scipy import signal, stats
from scipy.interpolate import CubicSpline, make_interp_spline

import study

#: One cycle of 15 cases; four cycles are a seed.
CYCLE = [
    "single",
    "clean",
    "stribeck",
    "changed",
    "double",
    "single",
    "outside",
    "clean",
    "single",
    "changed",
    "stribeck",
    "single",
    "clean",
    "double",
    "outside",
]
#: s of the fine grid; Hz below which sizes count; fine samples per row of least squares.
STEP, BAND, THIN = 0.001, 10.0, 40
CHANGES = [
    "payload",
    "coulomb_change",
    "viscous_change",
    "torque_offset",
    "torque_gain",
    "base_tilt",
    "tool_force",
    "encoder_offset",
    "stribeck",
    "spring",
    "load_friction",
    "torque_ripple",
    "torque_crosstalk",
    "nothing",
    "nothing",
]
#: Laws that belong to no joint, that are added last, that heat up over a session, and that a robot file can leave out.
WHOLE = ("base_tilt", "torque_delay", "tool_force", "payload", "gravity_part", "push")
LAST = ("torque_gain", "torque_delay", "dead_band", "saturation")
ONE_CLOCK = {"warmup_friction", "torque_drift"}
LEFT_OUT = {"motor_inertia": "rotors", "viscous": "viscous", "coulomb": "coulomb"}
LEFT_OUT["torque_offset"] = "offset"


def spread(rng, low_, high, *size):
    """Draw evenly in the logarithm."""
    return np.exp(rng.uniform(np.log(low_), np.log(high), *size))


def side(rng):
    """Draw a sign."""
    return rng.choice([-1, 1])


def direction(rng):
    """Draw a unit vector."""
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def slopes(x, step=STEP):
    """Return the first and the second differences of signals over time."""
    first = np.gradient(x, step, axis=0)
    return first, np.gradient(first, step, axis=0)


def low(x, band=BAND, order=2, rate=1 / STEP):
    """Return signals below a frequency, the fine grid's unless told otherwise."""
    return signal.sosfiltfilt(signal.butter(order, band, fs=rate, output="sos"), x, axis=0)


def rms(x):
    """Return the root mean square of each column."""
    return np.sqrt(np.mean(x**2, axis=0))


# --- the arm --------------------------------------------------------------------------------------


def inverse(model, *motion):
    """Return the torques of the bodies alone, (N, n) [N m]."""
    data = model.createData()
    return np.array([pin.rnea(model, data, *row) for row in zip(*motion, strict=True)])


def inertias(model, q):
    """Return the diagonal of the mass matrix at poses, (N, n)."""
    data = model.createData()
    return np.array([np.diag(pin.crba(model, data, row)) for row in q])


class Arm:
    """A serial arm of random bodies, plausible for its size, in Pinocchio; friction and rotors stand beside."""

    def __init__(self, rng):
        n, reach = int(rng.integers(3, 8)), rng.uniform(0.6, 1.6)
        self.n, standard = n, rng.random() < 0.5
        self.convention = "standard" if standard else "modified"
        twists = []
        for _ in range(n):  # two parallel axes in a row at most
            flat = twists[-1:] != [0.0] and rng.random() < 0.3
            twists.append(0.0 if flat else side(rng) * np.pi / 2)
        if rng.random() < 0.2:
            oblique = side(rng) * np.deg2rad(rng.choice([30, 40, 55, 60]))
            twists[int(rng.integers(n))] = oblique
        share = rng.uniform(0.5, 1.5, n) * np.linspace(1.3, 0.5, n)
        length = reach * share / share.sum()
        along_x = rng.random(n) < 0.5
        a = np.where(along_x, length, rng.choice([0, 0.03, 0.06], n) * (rng.random(n) < 0.4))
        d = np.where(along_x, rng.choice([0, 0.1, -0.08], n) * (rng.random(n) < 0.5), length)
        self.turn = np.round(rng.choice([0, 0, 0, np.pi / 2, -np.pi / 2], n), 12)
        self.rows = np.column_stack([np.round(a, 3), np.round(twists, 12), np.round(d, 3)])
        self.mount = str(rng.choice(["floor", "floor", "floor", "floor", "wall", "ceiling"]))
        down = {"floor": [0, 0, -9.81], "ceiling": [0, 0, 9.81], "wall": [9.81, 0, 0]}
        self.gravity = np.array(down[self.mount], float)
        mass = rng.uniform(6, 45) * reach**1.5
        weights = share * np.linspace(1.6, 0.4, n) * rng.uniform(0.7, 1.3, n)
        self.model, parent, put = pin.Model(), 0, pin.SE3.Identity()
        self.model.gravity.linear = self.gravity
        for i, (ai, twist, di) in enumerate(self.rows):
            bend = pin.utils.rotate("x", twist)
            if not standard:  # a and twist belong to the axis before
                put = pin.SE3(bend, np.array([ai, 0, 0])) * pin.SE3(np.eye(3), np.array([0, 0, di]))
            parent = self.model.addJoint(parent, pin.JointModelRZ(), put, f"j{i + 1}")
            put, to = pin.SE3.Identity(), np.array([ai, 0, di])
            if standard:
                put = pin.SE3(bend, to)
            else:
                after = self.rows[i + 1] if i + 1 < n else [0, 0, length[i] / 2]
                to = np.array([after[0], 0, after[2]])
            centre = rng.uniform(0.2, 0.7) * to + rng.normal(0, 0.02 * reach, 3)
            m = mass * weights[i] / weights.sum()
            sides = np.array([max(np.linalg.norm(to), 0.08), *rng.uniform(0.05, 0.12, 2) * reach])
            box = np.diag(m / 12 * (np.sum(sides**2) - sides**2))
            axes = pin.rpy.rpyToMatrix(*rng.uniform(-np.pi, np.pi, 3))
            body = pin.Inertia(m, centre, axes @ box @ axes.T)
            self.model.appendBodyToJoint(parent, body, pin.SE3.Identity())
        tip = pin.Frame("tip", parent, 0, put, pin.FrameType.OP_FRAME)
        self.tip, self.data = self.model.addFrame(tip), self.model.createData()
        self.speed, self.travel = rng.uniform(0.8, 2.8, n), rng.uniform(0.7, 2.2, n)
        poses = rng.uniform(-1, 1, (200, n)) * self.travel
        moved = self.speed * rng.uniform(-1, 1, (200, n))
        rigid = inverse(self.model, poses, moved, 3 * moved)
        self.rotors = inertias(self.model, poses).mean(axis=0) * rng.uniform(0.05, 0.5, n)
        load = rms(rigid) + 0.02 * np.sqrt(np.mean(rigid**2))
        self.coulomb = load * rng.uniform(0.01, 0.06, n)
        self.viscous = load * rng.uniform(0.02, 0.1, n) / self.speed
        self.offset = rng.normal(0, 0.01, n) * load
        self.width = spread(rng, 0.0015, 0.008, n)  # rad/s of a reversal
        self.torque = 3 * load + np.max(np.abs(rigid), axis=0)
        self.stiff = rng.uniform(2.5, 6.0)  # Hz of its controller

    def rigid(self, q, v, a, model=None):
        """Return the torques of the bodies alone, (N, n) [N m]."""
        return inverse(model or self.model, q + self.turn, v, a)

    def plain(self, q, v, a, rigid):
        """Return what drives it when nothing is hidden: bodies, rotors, viscous and Coulomb friction with their offset."""
        rub = self.viscous * v + self.coulomb * np.tanh(v / self.width) + self.offset
        return rigid + self.rotors * a + rub


# --- the motion -----------------------------------------------------------------------------------


@dataclass
class States:
    """Motion of the links on the fine grid; ``t`` is the clock of the session."""

    t: np.ndarray
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray


def moves(rng, t, seconds):
    """Return a motion from pose to pose with pauses."""
    knots, at = [0.0], [rng.uniform(-1, 1)]
    while knots[-1] < seconds:
        at += [rng.uniform(-1, 1)] * 2
        knots += [knots[-1] + rng.uniform(0.7, 2.5)]
        knots += [knots[-1] + rng.uniform(0.05, 0.5)]
    k = np.clip(np.searchsorted(knots, t, "right") - 1, 0, len(knots) - 2)
    s = (t - np.array(knots)[k]) / np.diff(knots)[k]
    return np.array(at)[k] + np.diff(at)[k] * s**3 * (10 - 15 * s + 6 * s**2)


def chirp(rng, t, seconds):
    """Return a sweep through frequencies beside a slow wave."""
    first, last = rng.uniform(0.03, 0.1), rng.uniform(0.4, 1.0)
    phase = 2 * np.pi * (first * t + (last - first) * t**2 / 2 / seconds)
    sweep = np.sin(phase + rng.uniform(0, 6)) / (1 + 2 * t / seconds)
    return sweep + 0.5 * np.sin(2 * np.pi * rng.uniform(0.05, 0.2) * t)


def harmonics(rng, t, _seconds):
    """Return a sum of 3 to 6 harmonics."""
    base, most = rng.uniform(0.05, 0.15), int(rng.integers(3, 7))
    return sum(
        rng.normal() / h**0.7 * np.sin(2 * np.pi * base * h * t + rng.uniform(0, 2 * np.pi))
        for h in range(1, most + 1)
    )


def sweeps(rng, t, _seconds):
    """Return a triangle wave with a faster sine."""
    period = rng.uniform(5, 14)
    wave = signal.sawtooth(2 * np.pi * (t / period + rng.random()), 0.5)
    return wave + 0.3 * np.sin(2 * np.pi * rng.uniform(0.2, 0.6) * t)


def draw_reference(rng, arm, kind, seconds):
    """Return the commanded motion on the fine grid, (N, n) [rad], inside travel and speed of the arm."""
    t, n = np.arange(0, seconds, STEP), arm.n
    q = np.column_stack([kind(rng, t, seconds) for _ in range(n)])
    q = low(q - q.mean(0), 3.0)
    q *= rng.uniform(0.5, 1.0, n) * arm.travel / np.abs(q).max(0)
    speed, accel = (np.abs(each).max(0) for each in slopes(q))
    q /= np.maximum(1, np.maximum(speed / (arm.speed * rng.uniform(0.4, 1.0, n)), accel / 12.0))
    return q + rng.uniform(-0.3, 0.3, n) * arm.travel


def smooth_states(q, step, t0=0.0):
    """Return positions of a coarse grid as States on the fine one: a quintic spline, so that all derivatives agree."""
    t = np.arange(len(q)) * step
    spline = make_interp_spline(t, q, k=5)
    fine = np.arange(round((t[-1] + 1e-9) / STEP) + 1) * STEP
    fine = fine[fine <= t[-1]]
    return States(t0 + fine, *(spline(fine, order) for order in range(3)))


def drive(arm, reference, rng, pull):
    """Let the arm follow a motion under its controller: integrate it forward, linearly implicit, and return positions.

    Args:
        pull: torques of hidden things along the reference, (N, n) [N m].
    """
    step, ref, pull = 2 * STEP, reference[::2], pull[::2]
    speed, accel = slopes(ref, step)
    ahead = rng.uniform(0.8, 1.0) * arm.rigid(ref, speed, accel)
    mass = inertias(arm.model, ref[::500] + arm.turn).mean(axis=0) + arm.rotors
    omega = 2 * np.pi * arm.stiff
    kp, kd = mass * omega**2, 2 * 0.8 * mass * omega
    noise = signal.lfilter([1], [1, -0.98], rng.normal(0, 1, ref.shape), axis=0)
    shake = noise * 0.0006 * arm.torque
    q, v, out = ref[0].copy(), speed[0].copy(), np.empty_like(ref)
    for i in range(len(ref)):
        out[i] = q
        weight = pin.nonLinearEffects(arm.model, arm.data, q + arm.turn, v)
        upper = np.triu(pin.crba(arm.model, arm.data, q + arm.turn))
        inertia = upper + np.triu(upper, 1).T + np.diag(arm.rotors)
        sign = np.tanh(v / arm.width)
        rub = arm.viscous * v + arm.coulomb * sign + arm.offset
        steep = arm.viscous + arm.coulomb / arm.width * (1 - sign**2)
        torque = ahead[i] + kp * (ref[i] - q) + kd * (speed[i] - v) + shake[i]
        torque = torque - weight - rub - pull[min(i, len(pull) - 1)]
        left = inertia + np.diag(step * (steep + kd) + step**2 * kp)
        v = v + np.linalg.solve(left, step * (torque - step * kp * v))
        q = q + step * v
    if not np.all(np.isfinite(out)) or np.abs(out - ref).max() > 1.0:
        raise RuntimeError("the controller lost the arm")
    return low(out, 30.0, 3, 1 / step)


# --- hidden things --------------------------------------------------------------------------------


@dataclass
class Hidden:
    """One hidden thing: law, joint, amplitude, shape."""

    name: str
    joint: int
    size: float
    shape: dict
    visible: float = 0.0


class Seen:
    """What the torque of a law depends on: amplitude, shape, and motion and torques of its joint and of another one."""

    def __init__(self, arm, s, tau, rigid, hidden):
        j, other = hidden.joint, hidden.shape.get("other", hidden.joint)
        self.arm, self.s, self.rigid, self.j = arm, s, rigid, j
        self.a, self.p, self.t = hidden.size, hidden.shape, s.t
        self.q, self.v, self.acc, self.load, self.own = (
            x[:, j] for x in (s.q, s.v, s.a, rigid, tau)
        )
        self.there, self.over, self.load_there = (x[:, other] for x in (s.q, s.v, rigid))
        self.sign = np.tanh(self.v / arm.width[j])
        self.sign_over = np.tanh(self.over / arm.width[other])

    def against(self, model):
        """Return what another model of the bodies adds."""
        return self.arm.rigid(self.s.q, self.s.v, self.s.a, model) - self.rigid


@dataclass
class Law:
    """A law: its torque on its joint or on all, where it has its own name the letter of its amplitude, and how it is drawn.

    ``shape`` and then ``begin`` (shape and amplitude to begin with) are drawn from what ``draw_hidden`` says of a joint;
    ``most`` is the largest plausible amplitude where that has a scale of its own.
    """

    torque: Callable | None
    letter: str = ""
    begin: Callable | float = lambda d: d.typical * d.sign
    shape: Callable = lambda d: {}
    most: float = np.inf


def typical(d):
    return d.typical


def fiftieth(d):
    return 0.02 * side(d.rng)


def wave(least, most):
    return lambda d: {"k": spread(d.rng, least, most), "phase": d.rng.uniform(0, 2 * np.pi)}


def swing(low_, high, least, most):
    return lambda d: {"hertz": d.rng.uniform(low_, high), "damping": d.rng.uniform(least, most)}


def stop(d):
    right = side(d.rng)
    share = d.rng.uniform(0.65, 0.85) if right > 0 else d.rng.uniform(0.15, 0.35)
    return {"side": right, "q1": np.quantile(d.q, share)}


def coupling(d):
    up = d.joint == 0 or (d.joint + 1 < d.arm.n and d.rng.random() < 0.5)
    other = d.joint + 1 if up else d.joint - 1
    return {"other": other, "ratio": d.rng.uniform(0, 1.5) * d.arm.speed[other]}


def changed(speed):
    """Return how a change of friction is drawn: more in two of three, a little less in one."""
    return lambda d: d.typical * d.rng.choice([1, 1, -0.2]) / (d.speed if speed else 1)


def tip_force(arm, q, force):
    """Return the torques that hold a force at the tip, fixed in the world, (N, n) [N m]."""
    out = []
    for pose in q[::10] + arm.turn:
        pin.computeJointJacobians(arm.model, arm.data, pose)
        pin.updateFramePlacements(arm.model, arm.data)
        world = pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        out.append(-pin.getFrameJacobian(arm.model, arm.data, arm.tip, world)[:3].T @ force)
    return CubicSpline(np.arange(0, len(q), 10), out, axis=0)(np.arange(len(q)))


def bristles(x):
    """Return friction before sliding over its Coulomb level: one Dahl bristle, or four that slip one after the other."""
    moves_, total = (x.v * STEP).tolist(), np.zeros(len(x.v))
    if x.p["elements"] == 1:
        z = 0.0
        for i, (move, s) in enumerate(zip(moves_, x.sign.tolist(), strict=True)):
            rate = abs(move) / x.p["delta"]
            total[i] = z = z + (s - z) * rate / (1 + rate) if rate else z
        return total
    for reach in x.p["delta"] * np.array([0.4, 1.0, 2.0, 3.5]):
        z, out = 0.0, []
        for move in moves_:
            z = min(1.0, max(-1.0, z + move / reach))
            out.append(z)
        total += np.array(out) / 4
    return total


def play(x):
    """Return what backlash adds: the link lies behind its motor in a gap with elastic flanks, integrated finely."""
    half, omega = abs(x.a), 2 * np.pi * x.p["hertz"]
    thin = inertias(x.arm.model, x.s.q[::50] + x.arm.turn)[:, x.j]
    inertia = np.interp(np.arange(len(x.t)), np.arange(0, len(x.t), 50), thin)
    # Why pressed in: a link that begins free lands with a shock that no size of the gap changes.
    at, w, h = half * np.sign(x.load[0]) + x.load[0] / inertia[0] / omega**2, 0.0, STEP / 4
    lag = np.zeros((len(x.t), 3))
    for i, (pull, mass) in enumerate(zip(x.load.tolist(), inertia.tolist(), strict=True)):
        stiff, damp = mass * omega**2, 2 * x.p["damping"] * mass * omega
        for _ in range(4):
            over = at - half if at > half else at + half if at < -half else 0.0
            contact = stiff * over + damp * w if over else 0.0
            w += h * (pull - contact) / mass
            at += h * w
        lag[i] = at, w, (pull - contact) / mass
    links = [each.copy() for each in (x.s.q, x.s.v, x.s.a)]
    for link, behind in zip(links, lag.T, strict=True):
        link[:, x.j] -= behind
    return x.arm.rigid(*links) - x.rigid


def ring(x):
    """Return the inertia torque of a mass on a spring that the joint carries, (N,)."""
    omega = 2 * np.pi * x.p["hertz"]
    num, den = signal.bilinear([-1, 0, 0], [1, 2 * x.p["damping"] * omega, omega**2], 1 / STEP)
    return abs(x.a) * slopes(signal.lfilter(num, den, x.acc))[1] / omega**2


def wander(x):
    """Return slow noise of rms 1 that each recording draws anew, (N,)."""
    rng = np.random.default_rng([x.p["seed"], int(1000 * x.t[0])])
    keep = np.exp(-STEP / x.p["seconds"])
    slow = signal.lfilter([1], [1, -keep], rng.normal(size=len(x.t)))
    return x.a * (slow / slow.std()) * (0.3 + np.abs(x.sign))


def saturated(x):
    """Return what a limit takes off the torque, (N,)."""
    most = np.abs(x.own).max() * (1 - min(abs(x.a), 0.9))
    return np.clip(x.own, -most, most) - x.own


def tilted(x):
    """Return what a base that leans adds."""
    model, gravity = x.arm.model.copy(), x.arm.gravity
    axis = np.cross(gravity / 9.81, [np.cos(x.p["angle"]), np.sin(x.p["angle"]), 0.3])
    model.gravity.linear = pin.exp3(x.a * axis / np.linalg.norm(axis)) @ gravity
    return x.against(model)


def loaded(x):
    """Return what a ball at the tip adds."""
    mass, model = abs(x.a), x.arm.model.copy()
    ball = pin.Inertia(mass, np.array(x.p["centre"]), 0.4 * mass * 0.04**2 * np.eye(3))
    model.appendBodyToJoint(x.arm.n, ball, model.frames[x.arm.tip].placement)
    return x.against(model)


def pushed(x):
    """Return the torques of one push against the tip, (N, n), or nothing in a recording that has none."""
    if not x.p.get("now", True):
        return 0.0
    span = np.ptp(x.t)
    u = ((x.t - x.t[0]) / span - 0.1 - 0.8 * x.p["place"]) * span / x.p["seconds"]
    pulse = np.where((u > 0) & (u < 1), np.sin(np.pi * u) ** 2, 0.0)
    return pulse[:, None] * tip_force(x.arm, x.s.q, x.a * np.array(x.p["direction"]))


def cosine(x):
    return x.a * np.cos(x.p["k"] * x.q - x.p["phase"])


def odd_product(x):
    laws = [x.v * np.cos(2 * x.there), x.over * x.v, np.abs(x.v) * np.sin(3 * x.q)]
    return x.a * laws[x.p["kind"]]


def presliding(x):
    return x.a * bristles(x) - min(x.a, x.arm.coulomb[x.j]) * x.sign


def leaning(d):
    """Draw a tilt: its size first, as in the cases before."""
    d.size = fiftieth(d)
    return {"angle": d.rng.uniform(0, 2 * np.pi)}


CATALOGUED = {
    "torque_offset": Law(lambda x: x.a, "c"),
    "viscous": Law(lambda x: x.a * x.v, "fv", lambda d: d.arm.viscous[d.joint]),
    "coulomb": Law(lambda x: x.a * x.sign, "fc", typical),
    "motor_inertia": Law(lambda x: x.a * x.acc, "Im", lambda d: d.arm.rotors[d.joint]),
    "asymmetric_viscous": Law(lambda x: x.a * np.abs(x.v), "a"),
    "nonlinear_viscous": Law(
        lambda x: x.a * x.sign * np.abs(x.v) ** x.p["p"],
        "a",
        shape=lambda d: {"p": d.rng.choice([d.rng.uniform(0.3, 0.6), d.rng.uniform(1.6, 3.0)])},
    ),
    "load_friction": Law(lambda x: x.a * np.abs(x.load) * x.sign, "a", 0.03, most=0.4),
    "torque_gain": Law(lambda x: x.a * x.own, begin=fiftieth, most=0.4),
    "torque_constant": Law(lambda x: x.a * np.abs(x.v) * x.own, "c", fiftieth, most=0.4),
    "warmup_friction": Law(
        lambda x: x.a * np.exp(-x.t / x.p["tw"]) * (x.sign + x.p["ratio"] * x.v),
        begin=typical,
        shape=lambda d: {"tw": d.rng.uniform(20, 150), "ratio": d.rng.uniform(0, 1) / d.speed},
    ),
    "torque_drift": Law(
        lambda x: x.a * x.p["tc"] * -np.expm1(-x.t / x.p["tc"]),
        "a",
        lambda d: d.typical * d.sign / 100,
        lambda d: {"tc": d.rng.choice([1e6, d.rng.uniform(40, 200)])},
    ),
    "position_friction": Law(lambda x: cosine(x) * x.sign, "a&b", shape=wave(0.7, 2.5)),
    "gear_friction": Law(lambda x: cosine(x) * x.sign, "a&b", shape=wave(8, 50)),
    "torque_ripple": Law(cosine, "a&b", shape=wave(8, 50)),
    "spring": Law(
        lambda x: x.a * (x.q - x.p["rest"]) ** (3 if x.p["cubic"] else 1),
        "k1",
        shape=lambda d: {
            "cubic": d.rng.random() < 0.35,
            "rest": d.rng.uniform(-0.5, 0.5) * np.ptp(d.q),
        },
    ),
    "end_stop": Law(
        lambda x: x.a * np.maximum(0, x.p["side"] * (x.q - x.p["q1"])), "a", shape=stop
    ),
    "joint_coupling": Law(
        lambda x: x.a * (x.over + x.p["ratio"] * x.sign_over), "a", shape=coupling
    ),
    "torque_crosstalk": Law(
        lambda x: x.a * x.load_there,
        "a",
        fiftieth,
        lambda d: {"other": d.rng.choice(np.delete(np.arange(d.arm.n), d.joint))},
        0.4,
    ),
    "joint_elasticity": Law(None, "compliance", lambda d: 0.003 / d.arm.torque[d.joint], most=0.05),
    "backlash": Law(play, "", 0.002, swing(25, 40, 0.2, 0.5), 0.02),
    "encoder_offset": Law(None, "offset", fiftieth, most=0.2),
    "presliding_hysteresis": Law(
        presliding,
        "a",
        typical,
        lambda d: {"delta": spread(d.rng, 0.004, 0.06), "elements": d.rng.choice([1, 1, 4])},
    ),
    "base_tilt": Law(tilted, "x&y", lambda d: d.size, leaning, 0.15),
    "torque_delay": Law(None, "delay", 0.002, most=0.03),
    "tool_force": Law(
        lambda x: tip_force(x.arm, x.s.q, abs(x.a) * np.array(x.p["direction"])),
        "x&y&z",
        2.0,
        lambda d: {"direction": direction(d.rng)},
    ),
}
OTHERS = {
    "stribeck": Law(
        lambda x: x.a * np.exp(-((np.abs(x.v) / x.p["vs"]) ** x.p["d"])) * x.sign,
        "a",
        typical,
        lambda d: {"vs": spread(d.rng, 0.02, 0.12), "d": d.rng.uniform(0.6, 2.5)},
    ),
    "payload": Law(loaded, "m", 0.5, lambda d: {"centre": d.rng.uniform(-0.08, 0.08, 3)}),
    "coulomb_change": Law(CATALOGUED["coulomb"].torque, "c", changed(False)),
    "viscous_change": Law(CATALOGUED["viscous"].torque, "v", changed(True)),
}
#: What the catalogue lacks.
OUTSIDE = {
    "ringing": Law(ring, "", lambda d: d.arm.rotors[d.joint], swing(4, 9, 0.01, 0.05)),
    "dead_band": Law(
        lambda x: -np.clip(x.own, -abs(x.a), abs(x.a)),
        begin=lambda d: 0.02 * d.arm.torque[d.joint],
    ),
    "snag": Law(
        lambda x: x.a * np.exp(-(((x.q - x.p["q0"]) / x.p["w"]) ** 2)) * (x.p["side"] * x.v > 0),
        shape=lambda d: {
            "q0": np.quantile(d.q, d.rng.uniform(0.2, 0.8)),
            "w": d.rng.uniform(0.02, 0.08) * np.ptp(d.q),
            "side": side(d.rng),
        },
    ),
    "push": Law(
        pushed,
        begin=5.0,
        shape=lambda d: {
            "direction": direction(d.rng),
            "seconds": d.rng.uniform(0.2, 1.0),
            "place": d.rng.random(),
        },
    ),
    "coarse": Law(None, begin=0.5),
    "saturation": Law(saturated, begin=0.1, most=0.6),
    "gravity_part": Law(
        lambda x: -x.a * x.arm.rigid(x.s.q, 0 * x.s.v, 0 * x.s.a), begin=0.03, most=0.5
    ),
    "wander": Law(
        wander,
        shape=lambda d: {"seed": d.rng.integers(1 << 30), "seconds": d.rng.uniform(1, 6)},
    ),
    "odd_product": Law(
        odd_product,
        begin=lambda d: d.typical / d.speed * side(d.rng),
        shape=lambda d: {"kind": d.rng.integers(3), "other": (d.joint + 1) % d.arm.n},
    ),
}
LAWS = CATALOGUED | OTHERS | OUTSIDE


def draw_hidden(name, joint, rng, arm, ref):
    """Return a law with its shape drawn, and an amplitude to begin with."""
    law, coulomb = LAWS[name], arm.coulomb[joint]
    d = SimpleNamespace(rng=rng, arm=arm, joint=joint, q=ref.q[:, joint], typical=coulomb)
    d.speed, d.sign = arm.speed[joint], side(rng)
    shape = {key: np.asarray(value).tolist() for key, value in law.shape(d).items()}
    return Hidden(name, joint, float(law.begin(d) if callable(law.begin) else law.begin), shape)


def torques(arm, s, hidden):
    """Return the torques and the positions that perfect sensors would see, and the torques without hidden things, (N, n)."""
    rigid, clock = arm.rigid(s.q, s.v, s.a), np.arange(len(s.t)) * STEP
    plain = arm.plain(s.q, s.v, s.a, rigid)
    tau, seen = plain.copy(), s.q.copy()
    for one in sorted(hidden, key=lambda one: one.name in LAST):
        x, j, law = Seen(arm, s, tau, rigid, one), one.joint, LAWS[one.name]
        if law.torque:
            added = law.torque(x)
            tau[:, slice(None) if np.ndim(added) > 1 else j] += added
        elif one.name == "torque_delay":
            tau = CubicSpline(clock, tau, axis=0)(np.maximum(clock - abs(x.a), 0))
        elif one.name == "encoder_offset":
            seen[:, j] += x.a
        elif one.name == "joint_elasticity":
            bend = abs(x.a) * x.load  # the encoder sits on the motor, which leads the link
            seen[:, j] += bend
            lead = np.gradient(bend, STEP)
            slip = np.tanh((x.v + lead) / arm.width[j]) - x.sign
            rub = arm.viscous[j] * lead + arm.coulomb[j] * slip
            tau[:, j] += arm.rotors[j] * np.gradient(lead, STEP) + rub
    return tau, seen, plain


# --- how visible it is ----------------------------------------------------------------------------


class Yardstick:
    """Least squares with all true columns on motions, to say what a model absorbs of a hidden thing."""

    def __init__(self, arm, motions, noise, left_out):
        n, rows = arm.n, []
        for s in motions:
            sharp = low(np.tanh(s.v / 0.01))
            thin = (x[::THIN] for x in (s.q + arm.turn, s.v, s.a, sharp))
            for q, v, a, rub in zip(*thin, strict=True):
                bodies = pin.computeJointTorqueRegressor(arm.model, arm.data, q, v, a)
                row = np.hstack([bodies, np.diag(a), np.diag(v), np.diag(rub), np.eye(n)])
                rows.append(row / noise[:, None])
        columns = np.vstack(rows)
        columns[:, [(10 + list(LEFT_OUT).index(kind)) * n + j for kind, j in left_out]] = 0
        u, size, _ = np.linalg.svd(columns, full_matrices=False)
        self.known, self.arm, self.noise = u[:, size > 1e-7 * size[0]], arm, noise

    def visible(self, motions, hidden, absorb):
        """Return the size of what is left of a hidden thing on the motions, over the noise, where it is largest."""
        parts = [unexplained(self.arm, s, hidden)[::THIN] for s in motions]
        y = (np.vstack(parts) / self.noise).ravel()
        if absorb:
            y = y - self.known @ (self.known.T @ y)
        return float(rms(y.reshape(-1, self.arm.n)).max())


def unexplained(arm, s, hidden):
    """Return what a hidden thing adds to what a perfect model of the plain arm says of the positions that are seen, (N, n)."""
    tau, seen, plain = torques(arm, s, [hidden])
    if np.any(seen != s.q):
        q = s.q + low(seen - s.q)
        v, a = (old + new for old, new in zip((s.v, s.a), slopes(q - s.q), strict=True))
        plain = arm.plain(q, v, a, arm.rigid(q, v, a))
    return low(tau - plain)


def scaled(motions, yard, hidden, wanted, absorb):
    """Return a hidden thing as large as wanted where that is plausible, with its visible size."""
    one, most = hidden, LAWS[hidden.name].most
    if one.name == "joint_elasticity":
        most /= yard.arm.torque[one.joint]
    for _ in range(4):
        one = replace(one, visible=yard.visible(motions, one, absorb))
        visible = one.visible
        if not np.isfinite(visible) or visible < 1e-6 or abs(visible / wanted - 1) < 0.05:
            break
        size = min(abs(one.size) * np.clip(wanted / visible, 0.02, 50), most)
        one = replace(one, size=float(np.sign(one.size) * size))
    return one


# --- the recorder ---------------------------------------------------------------------------------


def draw_recorder(rng, n):
    """Return what a recorder does to signals."""
    rate = float(rng.choice([100, 125, 200, 250, 500, 1000]))
    return {
        "rate": rate,
        "torque_noise": rng.uniform(0.006, 0.025, n),
        "memory": np.exp(-1 / rate / spread(rng, 0.0005, 0.02, n)),
        "torque_step": rng.uniform(0.2, 1.0, n),
        "bits": int(rng.integers(16, 21)),
        "position_noise": rng.uniform(0, 0.6),
        "skew": str(rng.choice(["none", "bus", "late"])),
        "skew_samples": rng.uniform(0, 0.3),
        "velocity": str(rng.choice(["none", "filtered", "filtered"])),
        "velocity_band": rng.uniform(8, 40),
        "jitter": float(rng.choice([0, 0, 0, 0.02])),
        "same_start": bool(rng.random() < 0.5),
        "clock": str(rng.choice(["each", "session"])),
        "format": "csv" if rate <= 250 and rng.random() < 0.6 else "npz",
    }


def record(rng, recorder, scale, s, tau, seen, begin):
    """Return time, positions, velocities (None without) and torques as the recorder writes them."""
    rate, fine = recorder["rate"], s.t - s.t[0]
    t = np.arange(0, fine[-1] - begin - 0.01, 1 / rate)
    at = begin + t + recorder["jitter"] / rate * rng.normal(size=len(t)).clip(-3, 3)
    skew, n = recorder["skew_samples"] / rate, tau.shape[1]
    bus = skew * np.arange(n) / max(1, n - 1) if recorder["skew"] == "bus" else np.zeros(n)
    older = skew if recorder["skew"] == "late" else 0.0

    def sampled(x, times):
        columns = zip(x.T, times, strict=True)
        return np.column_stack([CubicSpline(fine, c)(np.clip(u, 0, fine[-1])) for c, u in columns])

    q = sampled(seen, [at + late for late in bus])
    torque = sampled(tau, [at + late - older for late in bus])
    white = zip(recorder["memory"], rng.normal(size=torque.shape).T, strict=True)
    coloured = [signal.lfilter([np.sqrt(1 - phi**2)], [1, -phi], each) for phi, each in white]
    sd = recorder["torque_noise"] * scale
    noisy = torque + sd * (0.8 * np.column_stack(coloured) + 0.6 * rng.normal(size=torque.shape))
    coarse = recorder.get("coarse")
    step = recorder["torque_step"] * sd if coarse is None else coarse
    noisy = np.round(noisy / step) * step
    line = 2 * np.pi / 2 ** recorder["bits"]
    q = np.round((q + recorder["position_noise"] * line * rng.normal(size=q.shape)) / line) * line
    v = None
    if recorder["velocity"] == "filtered":
        keep = np.exp(-2 * np.pi * recorder["velocity_band"] / rate)
        speed = np.diff(q, axis=0, prepend=q[:1]) * rate
        v = signal.lfilter([1 - keep], [1, -keep], speed, axis=0)
    return t + begin + (s.t[0] if recorder["clock"] == "session" else 0.0), q, v, noisy


def noise_floor(arm, recorder, scale, s, tau, rng):
    """Return the noise of each joint below 10 Hz: that of the torques and what noisy positions do to the model, (n,) [N m]."""
    exact = {"torque_noise": 1e-9 + 0 * scale, "bits": 40, "position_noise": 0.0, "coarse": None}
    exact, rate = recorder | exact | {"jitter": 0.0}, recorder["rate"]
    slow, left = max(1, int(rate // 50)), []
    for each, draws in ((recorder, rng), (exact, np.random.default_rng(0))):
        _, q, _, torque = record(draws, each, scale, s, tau, s.q, 0.0)
        kept = low(q, rate=rate)
        states = [x[::slow] for x in (kept, *slopes(kept, 1 / rate))]
        left.append((torque, arm.rigid(*states) + arm.rotors * states[2]))
    (noisy, model), (clean, true) = left
    return rms((low(noisy - clean, rate=rate)[::slow] - (model - true))[10:-10])


def write_log(path, recorder, stamp, q, v, tau):
    """Write a log as a user has it: a table, or arrays."""
    columns = {"t": stamp, "q": q} | ({} if v is None else {"qd": v}) | {"tau": tau}
    path = path.with_suffix(f".{recorder['format']}")
    if recorder["format"] == "npz":
        np.savez(path, **columns)
        return path.name
    joints = range(1, q.shape[1] + 1)
    head = ["t", *(f"{kind}_axis_{j}" for kind in list(columns)[1:] for j in joints)]
    table_ = np.column_stack(list(columns.values()))
    np.savetxt(path, table_, "%.9g", ",", header=",".join(head), comments="")
    return path.name


def write_robot(path, arm, left_out):
    """Write the robot file that a user would have: geometry, limits and which friction there is."""
    lines = [
        f"name: stranger\nconvention: {arm.convention}\ngravity: {arm.gravity.tolist()}",
        f"mount: {arm.mount}\njoints:",
    ]
    words = {"torque_offset": "offset", "viscous": "viscous", "coulomb": "coulomb"}
    for j, (a, twist, d) in enumerate(arm.rows):
        kept = [word for kind, word in words.items() if (kind, j) not in left_out]
        lines.append(
            f"""\
  - name: axis_{j + 1}
    a: {a}
    twist: {twist:.15g}
    d: {d}
    theta_offset: {arm.turn[j]:.15g}
    limits: {{velocity: {arm.speed[j] * 1.2:.3f}, torque: {arm.torque[j]:.3f}}}
    friction: [{", ".join(kept)}]"""
        )
        if ("motor_inertia", j) in left_out:
            lines.append("    motor_inertia: false")
    path.write_text("\n".join([*lines, "driver: {kind: generic}"]) + "\n")


# --- a case ---------------------------------------------------------------------------------------


def wanted_size(rng):
    """Return a visible size: most above the noise, some below."""
    sizes = [(1, 4), (0.5, 1), (0.3, 0.5)]
    return float(spread(rng, *sizes[int(rng.choice(3, p=[0.6, 0.25, 0.15]))]))


def pick(kind, rng, k):
    """Return names to hide for a set, in a fixed rotation so that a seed meets most of them."""
    turn = int(rng.integers(100))
    if kind == "double":
        return list(rng.choice(["stribeck", *CATALOGUED], 2, replace=False))
    if kind == "single":
        return [list(CATALOGUED)[(7 * k + turn) % len(CATALOGUED)]]
    some = {"outside": list(OUTSIDE), "changed": CHANGES, "stribeck": ["stribeck"]}.get(kind)
    return [some[(k + turn) % len(some)]] if some else []


def hide(name, kind, rng, arm, motions, noise):
    """Return a hidden thing on the first of four joints where it is as visible as wanted, and what the file then lacks."""
    wanted, found = wanted_size(rng) if kind != "outside" else rng.uniform(1, 4), []
    if name == "coarse":
        return Hidden("coarse", 0, 0.5, {}), set()
    for joint in rng.permutation(arm.n)[:4].tolist():
        if name == "motor_inertia" and joint < 2:
            continue
        lacks = {(name, joint)} if kind in ("single", "double") and name in LEFT_OUT else set()
        yard = Yardstick(arm, motions, noise, lacks)
        one = draw_hidden(name, joint, rng, arm, motions[0])
        one = scaled(motions, yard, one, wanted, kind != "changed")
        if np.isfinite(one.visible):
            with np.errstate(divide="ignore"):
                found.append((abs(np.log(one.visible / wanted)), len(found), one, lacks))
        if found and 0.7 < min(found)[2].visible / wanted < 1.4:
            break
    if not found or min(found)[2].visible < 0.15:
        raise RuntimeError("cannot be seen")
    return min(found)[2:]


def draw_plan(rng, kind):
    """Return which motion is recorded when, and whether what is hidden is there."""
    twice = 2 if rng.random() < 0.75 else 1
    third = rng.random() < 0.8
    if kind == "changed":
        other = 0 if rng.random() < 0.5 else 2
        again = twice if rng.random() < 0.7 else 1
        return [(which, False) for which in sorted([0, 1] * twice)] + [(other, True)] * again
    more = [2] * (int(rng.integers(1, twice + 1)) if third else 0)
    return [(which, True) for which in sorted([0, 1] * twice + more)]


def make_case(folder, seed, k):
    """Make one case: robot file, logs and truth.json."""
    for attempt in range(10):
        try:
            return _make_case(folder, seed, k, np.random.default_rng([28, seed, k, attempt]))
        except RuntimeError:
            continue
    raise RuntimeError(f"seed {seed} case {k}: no arm could be driven")


def _make_case(folder, seed, k, rng):
    kind, arm, seconds = CYCLE[k % len(CYCLE)], Arm(rng), rng.uniform(15, 28)
    kinds = [harmonics, harmonics, harmonics, moves, chirp, sweeps]
    kinds = [harmonics, *(kinds[i] for i in rng.choice(len(kinds), 2))]
    references = [draw_reference(rng, arm, one, seconds) for one in kinds]
    nominal = [smooth_states(ref, STEP, 40.0 * i) for i, ref in enumerate(references)]
    recorder, tau0 = draw_recorder(rng, arm.n), torques(arm, nominal[0], [])[0]
    scale = rms(tau0) + 0.02 * np.sqrt(np.mean(tau0**2))
    noise = noise_floor(arm, recorder, scale, nominal[0], tau0, rng)
    names = pick(kind, rng, k)
    if "coarse" in names:
        recorder["coarse"] = np.minimum(0.5, 0.6 * scale)  # weak joints would be silent
    some = [hide(name, kind, rng, arm, nominal[:2], noise) for name in names if name != "nothing"]
    hidden, left_out, always = [one for one, _ in some], set().union(*(x for _, x in some)), []
    for name, j in left_out:  # what is left out of the model is the whole of that friction
        getattr(arm, LEFT_OUT[name])[j] = 0.0
    if kind == "changed" and rng.random() < 0.25:  # a model that lacked something before, too
        one = draw_hidden("stribeck", int(rng.integers(arm.n)), rng, arm, nominal[0])
        yard = Yardstick(arm, nominal[:2], noise, ())
        always = [scaled(nominal[:2], yard, one, 1.0, True)]
    if ONE_CLOCK & {one.name for one in hidden}:
        recorder["clock"] = "session"
    plan = draw_plan(rng, kind)
    folder.mkdir(parents=True, exist_ok=True)
    write_robot(folder / "arm.yaml", arm, left_out)
    logs, clock, driven = [], 0.0, []
    for number, (which, there) in enumerate(plan):
        now = [*always, *(hidden if there else [])]
        for one in now:
            if one.name == "push":
                one.shape["now"] = number == len(plan) // 2
        s = replace(nominal[which], t=nominal[which].t - nominal[which].t[0] + clock)
        pull = torques(arm, s, now)[0] - torques(arm, s, [])[0]
        s = smooth_states(drive(arm, references[which], rng, pull), 2 * STEP, clock)
        tau, seen, _ = torques(arm, s, now)
        begin = 0.0 if recorder["same_start"] else float(rng.uniform(0, 0.4))
        when = "" if kind != "changed" else "_new" if there else "_old"
        place = (
            folder / f"{'abc'[which]}{1 + [each for each, _ in plan[:number]].count(which)}{when}"
        )
        name = write_log(place, recorder, *record(rng, recorder, scale, s, tau, seen, begin))
        logs.append({"file": name, "motion": which, "there": there})
        driven += [s] if there else []
        clock += seconds + rng.uniform(3, 30)
    first = driven[:: max(1, len(driven) // 2)][:2]
    yard = Yardstick(arm, first, noise, left_out)
    for one in hidden:
        if one.name not in ("coarse", "push"):
            one.visible = yard.visible(first, one, kind != "changed")
    truth = {
        "seed": seed,
        "case": k,
        "set": kind if kind != "stribeck" else "single",
        "effects": [vars(one) | {"joint": one.joint + 1} for one in hidden],
        "always": [vars(one) | {"joint": one.joint + 1} for one in always],
        "noise": noise,
        "logs": logs,
        "recorder": recorder,
    }
    text = json.dumps(truth, indent=1, default=lambda value: np.asarray(value).tolist())
    (folder / "truth.json").write_text(text)


# --- what dynid says ------------------------------------------------------------------------------


def sizes_inside(effect, parameters):
    """Yield for each amplitude that has a name of its own: true, found, standard error, inside 95 %."""
    size, shape, name = effect["size"], effect["shape"], effect["name"]
    if shape.get("elements", 1) != 1 or shape.get("cubic"):
        return
    letter, second = LAWS[name].letter, size * shape.get("ratio", 0)
    named = {
        "torque_gain": {"g": (size, size / (1 + size))},
        "warmup_friction": {"a1": (size,), "a2": (second,)},
        "joint_coupling": {"a": (size,), "b": (second,)},
    }.get(name, {letter: (abs(size) if "&" in letter else size,)})
    for letters, truths in named.items():
        found = [parameters.get(each, {}) for each in letters.split("&")]
        if any(one.get("std_error") is None for one in found):
            continue
        values, errors = (np.array([one[key] for one in found]) for key in ("value", "std_error"))
        value, error = float(values[0]), float(errors[0])
        if len(found) > 1:
            value = float(np.linalg.norm(values))
            error = float(np.linalg.norm(values * errors) / max(value, 1e-300))
        inside = any(abs(value - truth) <= 1.96 * error for truth in truths)
        yield [name, float(truths[0]), value, error, inside]


def names(told, effect):
    """Tell whether a name is that of a hidden thing, on its joint."""
    # The zero of joint 1 turns the whole arm against gravity: it is a tilt of the base.
    if (told["effect"], effect["name"], effect["joint"]) == ("base_tilt", "encoder_offset", 1):
        return True
    joints, other = told["joints"], effect["shape"].get("other")
    here = joints[:1] == [f"axis_{effect['joint']}"]
    here &= other is None or len(joints) < 2 or joints[1] == f"axis_{other + 1}"
    return told["effect"] == effect["name"] and (here or effect["name"] in WHOLE)


def judge(truth, facts, identified_delay):
    """Return the answer of a search beside the truth: its kind, wrong names, sizes."""
    hidden = [one for one in truth["effects"] if one["name"] not in OUTSIDE]
    # What the model always lacked is told too, where nothing that changed is named.
    always = {(one["name"], f"axis_{one['joint']}") for one in truth["always"]}
    told = [one for one in facts["named"] if (one["effect"], *one["joints"][:1]) not in always]
    recorder = truth["recorder"]
    extra = recorder["skew_samples"] / recorder["rate"] if recorder["skew"] == "late" else 0.0
    wrong, sizes, found = [], [], []
    for one in told:
        meant = [effect for effect in hidden if names(one, effect)][:1]
        found += meant
        for effect in meant:
            same = effect["name"] == one["effect"]
            sizes += sizes_inside(effect, one["parameters"]) if same else []
        late = bool(extra) and one["effect"] == "torque_delay"
        late = late and abs(one["parameters"]["delay"]["value"] - extra) < 0.4 * extra + 2e-4
        if not meant and not late:  # a recorder whose torques are late is told rightly
            wrong.append(f"{one['effect']}@{one['joints']}")
    for effect in hidden:
        size, away = abs(effect["size"]), (identified_delay or np.nan) - extra
        if effect["name"] == "torque_delay" and abs(away - size) < 0.3 * size + 2e-4:
            found.append(effect)  # corrected, and told, before the search
    rest = [effect["name"] for effect in hidden if effect not in found]
    ambiguous = facts["verdict"] == "ambiguous"
    groups = {name for group in facts["alternatives"] for name in group}
    groups |= {one["effect"] for one in told if ambiguous}
    only_old = facts["question"] == "numbers" and len(told) < len(facts["named"])
    quiet = facts["verdict"] in ("nothing_missing", "nothing_changed")
    quiet |= truth["set"] == "changed" and only_old
    if ambiguous and hidden and all(any(name in each for each in groups) for name in rest):
        kind = "ambiguous"
    elif wrong:
        kind = "right and wrong" if found else "wrong"
    elif found:
        kind = "part" if rest else "exact"
    else:
        kind = "nothing" if quiet else "something"
    return {"kind": kind, "wrong": wrong, "sizes": sizes}


def run_case(folder, truth):
    """Identify and search one case by the public API, and return one line of results."""
    import dynid
    from dynid.errors import DynidError

    changed_, before = truth["set"] == "changed", time.process_time()
    there = [folder / log["file"] for log in truth["logs"] if log["there"]]
    fitted = [
        folder / log["file"]
        for log in truth["logs"]
        if (not log["there"] if changed_ else log["motion"] < 2)
    ]
    row = {key: truth[key] for key in ("seed", "case", "set")}
    row["effects"] = [[x["name"], x["joint"], round(x["visible"], 3)] for x in truth["effects"]]
    row["always"] = [[x["name"], x["joint"]] for x in truth["always"]]
    try:
        known = dynid.identify(folder / "arm.yaml", fitted)
        before = time.process_time()
        facts = dynid.find_gap(known, there, earlier=None if changed_ else ()).facts()
    except DynidError as error:
        row |= {"kind": "refused", "why": str(error)[:300], "wrong": [], "sizes": []}
        return row | {"seconds": time.process_time() - before}

    def said(kind, *keys):
        return [[one["effect"], one["joints"], *map(one.get, keys)] for one in facts[kind]]

    return (
        row
        | judge(truth, facts, known.delay)
        | {key: facts[key] for key in ("verdict", "question", "not_repeatable")}
        | {"told": said("named", "probability", "p_value")}
        | {"closest": said("closest", "why_not", "probability")}
        | {"seconds": time.process_time() - before}
    )


# --- tables ---------------------------------------------------------------------------------------


def wilson(hits):
    """Return the share of what is true with its 95 % interval of Wilson, as text."""
    if not hits:
        return "-"
    found = stats.binomtest(sum(hits), len(hits))
    low_, high = found.proportion_ci(method="wilson")
    share = f"{100 * found.statistic:.0f} %; {100 * low_:.0f} to {100 * high:.0f}"
    return f"{found.k} of {found.n} ({share})"


def table(rows):
    """Return the rates as Markdown."""

    def kinds(set_, kind, least=-1, most=99, law=None):
        """Whether the answers on a set are of a kind, between visible sizes of its smallest hidden thing."""
        return [
            row["kind"] == kind
            for row in rows
            if row["set"] == set_
            and least <= min((size for *_, size in row["effects"]), default=0) < most
            and (law is None or any(law == name for name, *_ in row["effects"]))
        ]

    def unnamed(set_):
        return [not row["wrong"] for row in rows if row["set"] == set_]

    unchanged = [row for row in rows if row["set"] == "changed" and not row["effects"]]
    outside = [
        row["kind"] == "something" or bool(row.get("not_repeatable") and not row["wrong"])
        for row in rows
        if row["set"] == "outside" and row["effects"][0][0] != "coarse"
    ]
    seconds = [row["seconds"] for row in rows if row["kind"] != "refused"] or [np.nan]
    wrong = sum(len(row["wrong"]) for row in rows if row["kind"] != "ambiguous")
    rates = {
        "single >= 1 exact": kinds("single", "exact", 1),
        "single 0.5 to 1 exact": kinds("single", "exact", 0.5, 1),
        "Stribeck >= 1 exact": kinds("single", "exact", 1, law="stribeck"),
        "Stribeck 0.5 to 1 exact": kinds("single", "exact", 0.5, 1, "stribeck"),
        "double, both >= 1: both named": kinds("double", "exact", 1),
        "double, both >= 0.5: both named": kinds("double", "exact", 0.5),
        "clean: nothing is missing": kinds("clean", "nothing"),
        "clean: no name": unnamed("clean"),
        "outside: something is missing, without a name": outside,
        "outside: no name": unnamed("outside"),
        "changed >= 1 exact": kinds("changed", "exact", 1),
        "changed >= 0.5 exact": kinds("changed", "exact", 0.5),
        "unchanged: nothing said": [row["kind"] == "nothing" for row in unchanged],
        "true sizes inside 95 %": [each[-1] for row in rows for each in row["sizes"]],
    }
    spent = f"{np.median(seconds):.1f} s, {max(seconds):.1f} s"
    lines = [(name, wilson(hits)) for name, hits in rates.items()]
    lines += [
        ("wrong names in all cases", f"{wrong} in {len(rows)}"),
        ("processor time of the search, median and largest", spent),
    ]
    given = study.markdown("probability given | names | right", reliability(rows))
    return f"{study.markdown('rate | measured', lines)}\n\n{given}"


def reliability(rows):
    """Yield how often names of a given probability are right, of names and of likely names below the limit.

    What the arm always lacked is right where it is told of a changed one.
    """
    pairs = []
    for row in rows:
        hidden = {(name, joint) for name, joint, *_ in (*row["effects"], *row["always"])}
        laws = {name for name, _ in hidden}
        told = [(name, joints, p) for name, joints, p, _ in row.get("told", ())]
        told += [(name, joints, p) for name, joints, _, p in row.get("closest", ())]
        for name, joints, p in told:
            first = int(joints[0].removeprefix("axis_")) if joints else 0
            if p is not None:
                right = (name, first) in hidden or (name in WHOLE and name in laws)
                pairs.append((p, right))
    ends = (0, 0.5, 0.8, 0.9, 0.95, 0.99, 0.999, 1.01)
    for least, most in itertools.pairwise(ends):
        chosen = [good for p, good in pairs if least <= p < most]
        if chosen:
            shown = f"{100 * least:g} to {min(100, 100 * most):g} %"
            yield shown, len(chosen), wilson(chosen)


def numbers(text):
    """Return the numbers of a list such as 1-3,7."""
    spans = [part.split("-") for part in text.split(",")]
    return [k for span in spans for k in range(int(span[0]), int(span[-1]) + 1)]


def work(folder, seed, k):
    """Make a case if it is not there, run it, return its line."""
    place = folder / f"{seed}" / f"{k:03d}"
    if not (place / "truth.json").exists():
        make_case(place, seed, k)
    row = run_case(place, json.loads((place / "truth.json").read_text()))
    return json.loads(json.dumps(row, default=float))


def main():
    """Run the cases that are asked for and not there yet, and print the table."""
    args = study.arguments(
        __doc__,
        seeds="1",
        cases="0-59",
        only="",
        jobs=1,
        folder=Path(tempfile.gettempdir()) / "gap_stranger",
        out=Path("gap_stranger.json"),
    )
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    answers, jobs, wanted = study.Answers(args.out), [], []
    for seed, k in itertools.product(numbers(args.seeds), numbers(args.cases)):
        kind, name = CYCLE[k % len(CYCLE)], f"{seed}/{k:02d}"
        if args.only in ("", kind, "single" if kind == "stribeck" else kind):
            wanted.append(name)
            jobs += [] if name in answers else [(args.folder, seed, k)]
    with ProcessPoolExecutor(args.jobs) as pool:
        for row in pool.map(work, *zip(*jobs, strict=True)):
            name = f"{row['seed']}/{row['case']:02d}"
            answers.keep(name, row)
            hidden = ", ".join(f"{n}@{j} {v:.2f}" for n, j, v in row["effects"]) or "-"
            told = ", ".join(f"{n}@{'+'.join(j)}" for n, j, *_ in row.get("told", ())) or "-"
            head = f"{name} {row['set']:8} {row['kind']:15} {row['seconds']:5.1f} s"
            print(f"{head}  {hidden}  ->  {told}", flush=True)
    print(table([answers[name] for name in wanted]))


if __name__ == "__main__":
    main()
