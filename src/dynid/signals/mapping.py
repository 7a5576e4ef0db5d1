"""Does the robot file describe the arm that made the log? If not: which single edits would explain it far better.

Each hypothesis is a robot file with one to three edits: the other DH convention, reversed joints, another order of the
columns, offsets of multiples of 90 degrees, another unit, another direction of gravity. All are fitted to a few hundred
samples by least squares, bodies and friction free, and compared by what they leave unexplained. Base parameters absorb
some mistakes whole; those do no harm and are not named.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dynid.errors import Finding, WrongMapping
from dynid.log import Log
from dynid.model.numeric_regressor import body_regressor
from dynid.robot import DriverSpec, JointMap, Robot
from dynid.signals.columns import in_si, matching_columns, robot_columns
from dynid.signals.gravity import expected_torque
from dynid.signals.motion import MOVING_SPEED, bandwidth, per_joint
from dynid.text import yaml_word

Floats = NDArray[np.float64]

#: Samples that hypotheses are fitted to, and those that a first choice among them is made with.
SAMPLES = 250
#: Longest time that positions are smoothed over before they are differentiated [s]; a third of the fastest period.
SMOOTHING = 0.15
#: Samples from the middle of a long log.
MOST_SAMPLES = 60_000
#: Mean logarithm of the residuals per joint below which one robot file is better than another.
CLEAR = 0.12
#: A further edit has to earn so much more than the one before it.
FURTHER = 0.06
#: Hypotheses that are taken further with a second edit, and a third.
BEAM = 3
#: A robot file that leaves less than this share of what constant and friction leave is not questioned.
GOOD = 0.1
#: Eigenvalues below this share of the largest are combinations of parameters that the log does not show.
RANK = 1e-9
#: Usual sizes of the ten parameters of a link [kg, kg m, kg m^2]: much larger values come from fitting noise.
USUAL = np.array([5.0, 1.0, 1.0, 1.0, 0.3, 0.3, 0.3, 0.3, 0.3, 0.3])
#: Samples that follow each other say the same: so many count as one.
ALIKE = 10.0
#: Torques are never modelled better than to this share of what a joint's change at all.
MODELLED = 0.01
#: Weight of implausible inertias and frictions in the comparison, where two hypotheses explain alike.
IMPLAUSIBLE = 0.05


@dataclass(frozen=True)
class Edit:
    """One edit of a robot file.

    Attributes:
        kind: ``"convention"``, ``"sign"``, ``"order"``, ``"offset"``, ``"unit"`` or ``"gravity"``.
        value: joint numbers, order of the columns, offset in quarter turns, factor or direction.
    """

    kind: str
    value: tuple[float, ...]


@dataclass(frozen=True)
class Hypothesis:
    """A robot file with edits, and how well it explains the log.

    Attributes:
        edits: what is changed.
        left: what it leaves of each joint's torque, root mean square, (n,) [N m or N].
        floor: what a constant, friction and rotor inertia alone leave, (n,) [N m or N].
        implausible: share of joints with negative inertia or friction.
    """

    edits: tuple[Edit, ...]
    left: Floats
    floor: Floats
    implausible: float

    @property
    def unexplained(self) -> float:
        """Share that it leaves of what constant, friction and rotor inertia leave, over all joints."""
        return float(np.linalg.norm(self.left) / np.linalg.norm(self.floor))

    def rank(self, noise: float) -> float:
        """What hypotheses are ordered by, lower is better: fit, plausibility, few edits.

        Args:
            noise: what the best hypothesis leaves of the torques [N m or N]; less than this says nothing.
        """
        share = np.hypot(self.left, noise) / np.hypot(self.floor, noise)
        return float(np.mean(np.log(share))) + IMPLAUSIBLE * self.implausible + 0.5 * FURTHER * len(self.edits)


@dataclass(frozen=True)
class Diagnosis:
    """What was found out about a robot file and a log.

    Attributes:
        given: the robot file as it is.
        best: the best hypotheses, the best first.
        wrong: whether the best one is so much better that the file must be wrong.
    """

    given: Hypothesis
    best: tuple[Hypothesis, ...]
    wrong: bool


@dataclass(frozen=True)
class _Motion:
    """A thinned log in the driver's columns and SI units.

    Attributes:
        x: position, velocity, acceleration, (3, N, n).
        tau: torques, (N, n).
        apart: whether torques are currents of unknown gains, so that each joint is fitted for itself.
    """

    x: Floats
    tau: Floats
    apart: bool


class _Judge:
    """Fits hypotheses to one log.

    Args:
        robot: the arm as its file says.
        motion: the thinned log.
        mapped: whether signs, offsets and order of the columns still have a say.
    """

    def __init__(self, robot: Robot, motion: _Motion, names: Sequence[str], mapped: bool) -> None:
        self.robot, self.motion, self.names, self.mapped = robot, motion, names, mapped
        map_ = robot.driver.map if robot.driver and mapped else JointMap((1.0,) * robot.n, (0.0,) * robot.n)
        self.sign, self.offset = np.array(map_.sign), np.array(map_.offset)
        self.coupling = np.array(robot.coupling.matrix) if robot.coupling is not None and mapped else None
        x, tau = self._dh(())
        friction = self._friction(x[1], x[2])
        self.floor = np.maximum([_left(friction[j], tau[:, j]) for j in range(robot.n)], 1e-9)

    # ------------------------------------------------------------ one hypothesis
    def _dh(self, edits: Sequence[Edit]) -> tuple[Floats, Floats]:
        """Return position, velocity, acceleration (3, N, n), and torques (N, n), in DH quantities under edits."""
        x, tau = self.motion.x.copy(), self.motion.tau
        sign, offset = self.sign.copy(), self.offset.copy()
        for edit in edits:
            if edit.kind == "order":
                order = [int(k) for k in edit.value]
                x, tau = x[:, :, order], tau[:, order]
            elif edit.kind == "unit":
                x = x * edit.value[0]
            elif edit.kind == "sign":
                sign[int(edit.value[0])] *= -1
            elif edit.kind == "offset":
                offset[int(edit.value[0])] += edit.value[1] * math.pi / 2
        if self.coupling is not None:
            x, tau = x @ np.linalg.inv(self.coupling).T, tau @ self.coupling
        x = x * sign
        x[0] += offset
        return x, tau * sign

    def _robot(self, edits: Sequence[Edit]) -> Robot:
        robot = self.robot
        for edit in edits:
            if edit.kind in ("convention", "gravity"):
                robot = edited(robot, edit)
        return replace(robot, gravity=(0.0, 0.0, 0.0)) if robot.torque.source == "gravity_free" else robot

    def _friction(self, qd: Floats, qdd: Floats) -> list[Floats]:
        """Return the columns of rotor inertia and friction of each joint, n of (N, 4)."""
        slow = per_joint(MOVING_SPEED, self.robot)
        return [
            np.column_stack([np.ones(len(qd)), qd[:, j], np.tanh(qd[:, j] / slow[j]), qdd[:, j]])
            for j in range(self.robot.n)
        ]

    def fit(self, edits: tuple[Edit, ...]) -> Hypothesis:
        """Fit a robot file with edits; every joint counts by its own noise."""
        x, tau = self._dh(edits)
        robot = self._robot(edits)
        bodies = body_regressor(robot, *x)
        friction = self._friction(x[1], x[2])
        if self.motion.apart:
            left = np.array([_left(np.hstack([friction[j], bodies[:, j]]), tau[:, j]) for j in range(robot.n)])
            theta = np.zeros(bodies.shape[2])
            own: list[Floats] = []
        else:
            left, theta, own = _shared(bodies, friction, tau)
        return Hypothesis(edits, left, self.floor, self._implausible(robot, x[0], theta, own))

    def _implausible(self, robot: Robot, q: Floats, theta: Floats, own: list[Floats]) -> float:
        """Return the share of joints with negative inertia (mean over poses) or negative friction."""
        if not own:
            return 0.0
        some = q[:: max(1, len(q) // 20)]
        free = replace(robot, gravity=(0.0, 0.0, 0.0))
        bad = 0.0
        for j in range(robot.n):
            push = np.zeros_like(some)
            push[:, j] = 1.0
            inertia = body_regressor(free, some, np.zeros_like(some), push)[:, j] @ theta + own[j][3]
            speed = own[j][1] + own[j][2]
            bad += 0.5 * float(np.mean(inertia < 0)) + 0.5 * float(speed < 0)
        return bad / robot.n

    # ------------------------------------------------------------ which edits
    def single(self) -> Iterator[Edit]:
        """Yield all single edits."""
        robot, n = self.robot, self.robot.n
        yield Edit("convention", ())
        gravity = np.array(robot.gravity)
        size = float(np.linalg.norm(gravity))
        if size and robot.torque.source != "gravity_free":
            for axis in range(3):
                for sign in (1.0, -1.0):
                    other = np.zeros(3)
                    other[axis] = sign * size
                    if not np.allclose(other, gravity, atol=0.1 * size):
                        yield Edit("gravity", tuple(other.tolist()))
        if not self.mapped:
            return
        for j in range(n):
            yield Edit("sign", (float(j),))
        for j in range(n):
            for quarter in (1.0, -1.0, 2.0):
                if robot.joints[j].revolute:
                    yield Edit("offset", (float(j), quarter))
        degrees = robot.driver is not None and robot.driver.units["position"] == "deg"
        yield Edit("unit", (180 / math.pi if degrees else math.pi / 180,))
        yield from self.orders()

    def orders(self) -> Iterator[Edit]:
        """Yield orders of the columns: every exchange of two, and whole ones that recorders and people make."""
        n = self.robot.n
        same = list(range(n))
        seen = {tuple(same)}
        whole = [same[::-1], [*same[1:], 0], [n - 1, *same[:-1]], self._sorted(), self._unsorted(), self._alike()]
        swaps = [[b if k == a else a if k == b else k for k in same] for a in range(n) for b in range(a + 1, n)]
        for order in [*swaps, *whole]:
            if sorted(order) == same and tuple(order) not in seen:
                seen.add(tuple(order))
                yield Edit("order", tuple(float(k) for k in order))

    def _sorted(self) -> list[int]:
        return sorted(range(self.robot.n), key=lambda k: self.names[k])

    def _unsorted(self) -> list[int]:
        order = self._sorted()
        return [order.index(k) for k in range(self.robot.n)]

    def _alike(self) -> list[int]:
        """Return the assignment of columns to joints by range of motion, speed and size of the torque."""
        from scipy.optimize import linear_sum_assignment

        robot, x = self.robot, self.motion.x
        have = np.std(self.motion.tau, axis=0) + 1e-9
        carried = np.sqrt(np.mean(expected_torque(x[0], robot) ** 2, axis=0)) + 0.02
        rating = [joint.limits.torque for joint in robot.joints]
        size = np.array([value or np.nan for value in rating])
        wanted = size if np.isfinite(size).all() else carried
        cost = np.abs(np.log(have / have.mean())[None, :] - np.log(wanted / wanted.mean())[:, None])
        for j, joint in enumerate(robot.joints):
            if joint.limits.position is not None and self.coupling is None:
                low, high = sorted((np.array(joint.limits.position) - self.offset[j]) * self.sign[j])
                outside = np.maximum(0, x[0].max(axis=0) - high) + np.maximum(0, low - x[0].min(axis=0))
                cost[j] += 3.0 * outside
        return [int(k) for k in linear_sum_assignment(cost)[1]]


def diagnose(log: Log, robot: Robot, names: Sequence[str] = (), *, always: bool = False) -> Diagnosis | None:
    """Return what a log says about a robot file; None where the file explains the log well, or nothing can be said.

    Args:
        log: the robot's columns in SI units, with increasing time and finite numbers.
        robot: the arm.
        names: names of the columns in the log, in chain order; () where it names none.
        always: whether hypotheses are also tried where the file explains the log well.
    """
    judge = judge_of(log, robot, names)
    if judge is None:
        return None
    given = judge.fit(())
    if given.unexplained < GOOD and not always:
        return None
    found = {hypothesis.edits: hypothesis for hypothesis in map(judge.fit, [(), *((e,) for e in judge.single())])}
    for _ in range(2):
        ranked = _ranked(found.values())
        if ranked[0].unexplained < GOOD:
            break
        further = {
            edits
            for start in ranked[:BEAM]
            for edit in judge.single()
            if (edits := _with(start.edits, edit)) is not None
        } - set(found)
        found |= {edits: judge.fit(edits) for edits in sorted(further, key=str)}
        if _ranked(found.values())[0] is ranked[0]:
            break
    ranked = _ranked(found.values())
    noise = _noise(found.values())
    return Diagnosis(given, tuple(ranked[:5]), ranked[0].rank(noise) < given.rank(noise) - CLEAR)


def _noise(found: Iterable[Hypothesis]) -> float:
    return min(float(np.sqrt(np.mean(each.left**2))) for each in found)


def _ranked(found: Iterable[Hypothesis]) -> list[Hypothesis]:
    noise = _noise(found)
    return sorted(found, key=lambda each: each.rank(noise))


def _with(edits: tuple[Edit, ...], edit: Edit) -> tuple[Edit, ...] | None:
    """Return edits with one more, None where that says nothing new."""
    for before in edits:
        if before.kind == edit.kind and (
            edit.kind in ("convention", "gravity", "unit")
            or (before.value[0] == edit.value[0] and edit.kind != "order")
        ):
            return None
    if edit.kind == "order":
        own = next((before for before in edits if before.kind == "order"), None)
        if own is not None:
            order = tuple(own.value[int(k)] for k in edit.value)
            if order == tuple(float(k) for k in range(len(order))):
                return None
            rest = tuple(before for before in edits if before is not own)
            return tuple(sorted((*rest, Edit("order", order)), key=_place))
    return tuple(sorted((*edits, edit), key=_place))


def _place(edit: Edit) -> tuple[str, tuple[float, ...]]:
    return edit.kind, edit.value


def edited(robot: Robot, edit: Edit) -> Robot:
    """Return a robot file with one edit."""
    if edit.kind == "convention":
        return replace(robot, convention="modified" if robot.convention == "standard" else "standard")
    if edit.kind == "gravity":
        return replace(robot, gravity=edit.value)  # type: ignore[arg-type]
    n = robot.n
    driver = robot.driver or DriverSpec("generic", None, robot.joint_names, JointMap((1.0,) * n, (0.0,) * n))
    sign, offset = list(driver.map.sign), list(driver.map.offset)
    if edit.kind == "sign":
        sign[int(edit.value[0])] *= -1
    elif edit.kind == "offset":
        j = int(edit.value[0])
        turned = offset[j] + edit.value[1] * math.pi / 2
        offset[j] = math.remainder(turned, 2 * math.pi) if robot.joints[j].revolute else turned
    elif edit.kind == "order":
        names = robot.log_names
        driver = replace(driver, joint_names=tuple(names[int(k)] for k in edit.value))
    elif edit.kind == "unit":
        unit = "deg" if driver.units["position"] == "rad" else "rad"
        driver = replace(driver, units={**driver.units, "position": unit})
    return replace(robot, driver=replace(driver, map=JointMap(tuple(sign), tuple(offset))))


def check_mapping(
    log: Log, robot: Robot, names: Sequence[str], *, anyway: bool = False, least_gain: float = 1.0
) -> tuple[Finding, ...]:
    """Raise when another mapping of the columns, or another table, would explain a log far better than the robot file.

    Args:
        log: the robot's columns in SI units, not yet in DH quantities, checked but for this.
        robot: the arm.
        names: names of the columns in the log, in chain order; () where it names none.
        anyway: whether to go on with finding W329.
        least_gain: by what factor the unexplained share has to shrink.

    Raises:
        WrongMapping: names the likeliest mistake, with the edit.
    """
    found = diagnose(log, robot, names)
    if found is None or not found.wrong or found.given.unexplained < least_gain * found.best[0].unexplained:
        return ()
    best = found.best[0]
    now, then = (f"{100 * each.unexplained:.0f} %" for each in (found.given, best))
    what = (
        f"the robot file leaves {now} of the torques unexplained that are more than friction; "
        f"it would be {then} with {' and '.join(said(edit, robot) for edit in best.edits)}"
    )
    evidence = {
        "unexplained": found.given.unexplained,
        "hypotheses": [
            {"edits": [said(e, robot) for e in each.edits], "unexplained": each.unexplained} for each in found.best
        ],
    }
    if anyway:
        return (Finding("W329", "warning", what, evidence),)
    others = [" and ".join(said(e, robot) for e in each.edits) for each in found.best[1:3] if each.edits]
    raise WrongMapping(
        what,
        why="the model explains little more than a constant and friction"
        + (f"; next likely: {'; '.join(others)}" if others else ""),
        fix=f"in {robot.path or 'the robot file'}: {pasted(best.edits, robot, bool(names))}; or go on with --anyway",
    )


def said(edit: Edit, robot: Robot) -> str:
    """Return an edit in words."""
    if edit.kind == "convention":
        return "the other DH convention"
    if edit.kind == "gravity":
        return f"gravity along {'-' if sum(edit.value) < 0 else '+'}{'xyz'[int(np.argmax(np.abs(edit.value)))]}"
    if edit.kind == "unit":
        return "positions in the other unit"
    if edit.kind == "order":
        moved = [robot.joint_names[k] for k, source in enumerate(edit.value) if source != k]
        return f"the columns of {', '.join(moved)} in another order"
    name = robot.joint_names[int(edit.value[0])]
    return f"{name} reversed" if edit.kind == "sign" else f"{name} offset by {90 * edit.value[1]:+.0f} deg"


def pasted(edits: Sequence[Edit], robot: Robot, named: bool = True) -> str:
    """Return edits as lines of a robot file."""
    changed = robot
    for edit in edits:
        changed = edited(changed, edit)
    kinds = {edit.kind for edit in edits}
    lines = []
    if "convention" in kinds:
        lines.append(f"`convention: {changed.convention}`")
    if "gravity" in kinds:
        lines.append(f"`gravity: [{', '.join(f'{g:g}' for g in changed.gravity)}]`")
    spec = changed.driver
    if spec is None or not kinds & {"order", "sign", "offset", "unit"}:
        return " and ".join(lines)
    if "order" in kinds and not named:
        lines.append(f"put the columns of the log in the order {', '.join(spec.joint_names)}")
    return " and ".join([*lines, *_driver_keys(spec, kinds, robot.driver is not None, named)])


def _driver_keys(spec: DriverSpec, kinds: set[str], there: bool, named: bool) -> list[str]:
    keys = {
        "order": f"joint_names: [{', '.join(map(yaml_word, spec.joint_names))}]" if named else "",
        "sign": f"sign: [{', '.join(f'{s:g}' for s in spec.map.sign)}]",
        "offset": f"offset: [{', '.join(map(_angle, spec.map.offset))}]",
        "unit": f"units: {{position: {spec.units['position']}}}",
    }
    inside = ", ".join(text for kind, text in keys.items() if kind in kinds and text)
    if not inside:
        return []
    return [f"under `driver:` `{inside}`" if there else f"`driver: {{kind: generic, {inside}}}`"]


def _angle(value: float) -> str:
    return f"{math.degrees(value):.6g} deg" if value else "0"


def driver_columns(log: Log, robot: Robot) -> tuple[Log, list[str]]:
    """Return a log as ``diagnose`` takes it, and the names of its columns in chain order."""
    names = [log.names[k] for k in matching_columns(log, robot)[0]] if log.names else []
    return in_si(robot_columns(log, robot), robot), names


def judge_of(log: Log, robot: Robot, names: Sequence[str]) -> _Judge | None:
    """Return what fits hypotheses to a log; None where the log hardly moves."""
    motion = _motion(log, robot)
    return None if motion is None else _Judge(robot, motion, names or robot.log_names, not log.dh)


def _motion(log: Log, robot: Robot) -> _Motion | None:
    """Smooth, differentiate and thin a log in SI units; None where it hardly moves."""
    if len(log) < 50:
        return None
    first = max(0, (len(log) - MOST_SAMPLES) // 2)
    part = slice(first, first + MOST_SAMPLES)
    t, q, tau = log.t[part], log.q[part], log.tau[part]
    usual = float(np.median(np.diff(t)))
    fastest = bandwidth(log, robot)
    width = max(3, round(min(SMOOTHING, 0.33 / max(fastest, 0.1)) / usual))
    if len(t) < 6 * width + 20:
        return None
    kernel = np.hanning(width + 2) / np.hanning(width + 2).sum()
    turning = np.array([joint.revolute for joint in robot.joints])
    q = np.where(turning, np.unwrap(q, axis=0), q)

    def smooth(x: Floats) -> Floats:
        return np.apply_along_axis(np.convolve, 0, x, kernel, "valid")

    def slope(x: Floats) -> Floats:
        return np.asarray(np.gradient(x, clock, axis=0))

    clock = np.convolve(t, kernel, "valid")
    x0 = smooth(q)
    x1 = smooth(slope(x0))
    clock = np.convolve(clock, kernel, "valid")
    x2 = smooth(slope(x1))
    twice = smooth(smooth(smooth(tau)))
    count = len(x2)
    edge = (len(x0) - count) // 2, (len(x1) - count) // 2
    position, velocity = x0[edge[0] : edge[0] + count], x1[edge[1] : edge[1] + count]
    span = len(kernel)
    reach = t[3 * (span - 1) :][:count] - t[:count]
    whole = reach < 1.5 * 3 * (span - 1) * usual + 3 * usual
    alive = np.any(np.abs(velocity) > per_joint(MOVING_SPEED, robot), axis=1) & whole
    rows = np.flatnonzero(alive)
    if len(rows) < 50:
        return None
    rows = rows[:: max(1, len(rows) // SAMPLES)]
    unknown = log.tau_unit == "A" and (robot.torque.gain is None or any(g is None for g in robot.torque.gain))
    gain = np.array(robot.torque.gain, dtype=float) if log.tau_unit == "A" and not unknown else np.ones(log.n)
    return _Motion(np.stack([position[rows], velocity[rows], x2[rows]]), twice[:count][rows] * gain, unknown)


def _left(columns: Floats, tau: Floats) -> float:
    """Return the root mean square that least squares leaves of one joint's torque."""
    scaled = columns / np.maximum(np.linalg.norm(columns, axis=0), 1e-12)
    G = scaled.T @ scaled
    value, vector = np.linalg.eigh(G)
    kept = value > RANK * value[-1]
    fit = vector[:, kept] @ ((vector[:, kept].T @ (scaled.T @ tau)) / value[kept])
    return float(np.sqrt(np.mean((tau - scaled @ fit) ** 2)))


def _shared(bodies: Floats, friction: list[Floats], tau: Floats) -> tuple[Floats, Floats, list[Floats]]:
    """Return what is left of each joint's torque, the bodies' parameters, and each joint's friction.

    Friction is taken out joint by joint; weights are found in three rounds, from what each joint leaves.
    """
    n, p = tau.shape[1], bodies.shape[2]
    rest, left, bases = [], [], []
    for j in range(n):
        Q, R = np.linalg.qr(friction[j])
        rest.append(bodies[:, j] - Q @ (Q.T @ bodies[:, j]))
        left.append(tau[:, j] - Q @ (Q.T @ tau[:, j]))
        bases.append((Q, R))
    grams = [a.T @ a for a in rest]
    sides = [a.T @ b for a, b in zip(rest, left, strict=True)]
    energies = np.array([float(b @ b) for b in left])
    rms = np.sqrt(np.maximum(energies / len(tau), 1e-18))
    theta = np.zeros(p)
    for _ in range(3):
        G = sum(gram / s**2 for gram, s in zip(grams, rms, strict=True))
        side = sum(side / s**2 for side, s in zip(sides, rms, strict=True))
        theta = np.linalg.solve(G / ALIKE + np.diag(np.tile(USUAL**-2.0, p // 10)), side / ALIKE)
        quads = np.array([float(theta @ gram @ theta - 2 * theta @ s) for gram, s in zip(grams, sides, strict=True)])
        rms = np.sqrt(np.maximum((energies + quads) / len(tau), 1e-12 * energies / len(tau) + 1e-18))
        rms = np.maximum(rms, MODELLED * np.sqrt(energies / len(tau)))
    own = [
        np.linalg.lstsq(R, Q.T @ (tau[:, j] - bodies[:, j] @ theta), rcond=1e-9)[0] for j, (Q, R) in enumerate(bases)
    ]
    return rms, theta, own
