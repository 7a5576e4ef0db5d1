"""Contacts on a log: the torque from outside, the threshold that a stated rate of false alarms asks for, intervals.

The threshold is a multiple of the size that the residual model and the posterior expect of the outside torque without a
contact, joint by joint and instant by instant. The multiple follows from the rate at which a low-pass noise crosses a
level (Rice 1944), with a size that is itself uncertain: the multiple of Student's distribution. Where a log is rougher
than expected its own median says so. Friction is no noise: it holds for as long as the arm is warm, and adds to the
threshold what it may differ by. A joint that sticks may carry anything up to its static friction.

A position that was sent twice looks like a blow: the observer sees a momentum that comes and goes without a torque. So
the size holds what momentum is uncertain by, from how far each position lies beside the cubic through its neighbours.
A real push bends the path so little within a quarter of the observer's time that it hides a few percent of itself.
The ends of a recording, where its own filters had no neighbours, are not judged.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import WrongUsage
from dynid.estimation import tuning
from dynid.estimation.least_squares import symmetric_root
from dynid.estimation.momentum_observer import MomentumObserver
from dynid.estimation.residual_model import orthogonal, shapes_of
from dynid.estimation.stack import scaled
from dynid.log import Log
from dynid.signals.checks import prepare
from dynid.signals.conditioned_log import ConditionedLog, Segment, condition_log
from dynid.signals.filters import too_short

if TYPE_CHECKING:
    from dynid.estimation.result import Identification

Floats = NDArray[np.float64]

#: Median of the absolute value of a normal number.
MEDIAN = 0.6745


@dataclass(frozen=True)
class Contact:
    """One interval in which something touched the arm, as one joint feels it.

    Attributes:
        start: first instant above the threshold, in the log's clock [s].
        end: last one [s].
        joint: name.
        peak: largest outside torque, with its sign [N m or N].
    """

    start: float
    end: float
    joint: str
    peak: float

    def facts(self) -> dict[str, Any]:
        """Return the contact for JSON."""
        return {"start_s": self.start, "end_s": self.end, "joint": self.joint, "peak_nm": self.peak}


@dataclass(frozen=True)
class ExternalTorque:
    """The torque from outside along a log, and what would be an alarm; N samples, n joints.

    Attributes:
        t: time in the log's clock, (N,) [s].
        joints: names, (n,).
        torque: from outside, (N, n) [N m or N].
        threshold: absolute torque above which it counts as a contact, (N, n) [N m or N].
        contacts: intervals, in order of time.
        false_alarms: rate that the threshold is made for [1/h].
        rate: samples a second [Hz].
        rougher: how many times the outside torque of this log is larger than expected, at least 1, (n,).
        begin: first time of the log, whose ends are not judged [s].
    """

    t: Floats
    joints: tuple[str, ...]
    torque: Floats
    threshold: Floats
    contacts: tuple[Contact, ...]
    false_alarms: float
    rate: float
    rougher: Floats
    begin: float

    @property
    def changed(self) -> bool:
        """Whether so much of the log is above the threshold that the arm is another than the identified one."""
        above = np.any(np.abs(self.torque) > self.threshold, axis=1)
        return bool(np.mean(above) > tuning.CONTACT_CHANGED)

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid contacts`` says of it."""
        return {
            "contacts": [contact.facts() for contact in self.contacts],
            "threshold_nm": np.median(self.threshold, axis=0).tolist(),
            "threshold_largest_nm": self.threshold.max(axis=0).tolist(),
            "rate_hz": self.rate,
            "false_alarms_per_h": self.false_alarms,
            "arm_changed": self.changed,
            "rougher_than_expected": self.rougher.tolist(),
            "joints": list(self.joints),
            "duration_s": float(self.t[-1] - self.t[0]),
        }


def external_torque(result: Identification, log: Log, false_alarms: float = 1.0) -> ExternalTorque:
    """Return the torque from outside along a log and the contacts on it.

    Args:
        result: the identified arm.
        log: the recording.
        false_alarms: false alarms an hour, over all joints together, that the threshold is made for [1/h].

    Raises:
        WrongUsage: no such rate can be had.
        DynidError: the first serious fault of the log.
    """
    if not isinstance(false_alarms, (int, float)) or not 1e-6 <= false_alarms <= 1e6:
        raise WrongUsage(
            f"{false_alarms!r} false alarms an hour cannot be had", fix="a number such as 1, or 0.1"
        )
    base = result.base
    checked = prepare(log, result.robot, identify=False)
    conditioned = condition_log(checked, base.model, cutoff=result.cutoff, delay=result.delay)
    (there,) = scaled([conditioned], base, result.theta)
    ends = 1.0 / there.filter.cutoff if there.filter.cutoff else 0.0
    parts = [
        _segment(result, part, there, ends)
        for part in there.segments
        if np.ptp(part.t) > 3.0 * ends
    ]
    if not parts:
        longest = max(float(np.ptp(part.t)) for part in there.segments)
        raise too_short(
            checked,
            f"{longest:.2f} s are left of the longest part",
            there.filter.cutoff,
            3.0 * ends,
        )
    t, torque, size, hold = (np.concatenate(each) for each in zip(*parts, strict=True))
    ratio = np.abs(torque) / (size + hold)
    # Why at least 1: a log that happens to be smooth proves nothing about the next minute.
    rougher = np.maximum(1.0, np.median(ratio, axis=0) / MEDIAN)
    threshold = (
        multiple(false_alarms, len(result.noise), there.filter.cutoff) * rougher * size + hold
    )
    names = result.robot.joint_names
    found: list[Contact] = []
    start = 0
    for part in parts:
        rows = slice(start, start + len(part[0]))
        found += _intervals(t[rows], torque[rows], threshold[rows], names)
        start = rows.stop
    found.sort(key=lambda each: (each.start, each.joint))
    rate = 1.0 / float(there.segments[0].t[1] - there.segments[0].t[0])
    return ExternalTorque(
        t,
        names,
        torque,
        threshold,
        tuple(found),
        float(false_alarms),
        rate,
        rougher,
        float(checked.t[0]),
    )


def multiple(false_alarms: float, n: int, cutoff: float) -> float:
    """Return how many times its expected size the outside torque must be to count as a contact.

    Args:
        false_alarms: an hour, over all joints [1/h].
        n: number of joints.
        cutoff: of the log's filter [Hz]; 0 for none.
    """
    band = tuning.OBSERVER_GAIN / (2.0 * np.pi)
    crossings = 2.0 * n * min(band, cutoff or band)
    tail = tuning.CONTACT_TAIL
    share = min(1.0, false_alarms / 3600.0 / crossings)
    return float(np.sqrt(tail * (share ** (-2.0 / tail) - 1.0)))


def inertial_columns(result: Identification) -> NDArray[np.bool_]:
    """Return which base parameters move masses and rotors, (p,)."""
    model = result.base.model
    kinds = [
        model.parameters[k].kind if k < model.plain_size else "effect"
        for k in result.reduction.base
    ]
    return np.array([kind not in ("fv", "fc", "fo", "fvc", "fcc", "effect") for kind in kinds])


def own_parameters(result: Identification) -> dict[int, Floats]:
    """Return the base parameters of each joint that contradicts the others, (p,), by number of the joint."""
    error = result.model_error
    return (
        {} if error is None else {int(j): result.theta + error.own[j] for j in error.joints_apart}
    )


def _segment(
    result: Identification, segment: Segment, log: ConditionedLog, ends: float
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return times, outside torque, its expected size without a contact, and what friction may hold.

    Args:
        result: the identified arm.
        segment: a part of the log.
        log: the log.
        ends: what is left out at each end [s].
    """
    base, observer = result.base, result.base.observer
    q, qd = segment.q, segment.qd
    sign = segment.coulomb_sign if segment.coulomb_sign.size else observer.coulomb_sign(qd)
    W = observer.dense(q, qd, np.zeros_like(q))
    names = result.names
    for joint in range(result.robot.n):
        if f"fc{joint + 1}" in names:
            W[:, joint, names.index(f"fc{joint + 1}")] = sign[:, joint]
    if base.model.added:
        wanted, count = observer.added_entries, len(observer.rows) - len(observer.added_entries)
        W[:, observer.rows[count:], observer.cols[count:]] = segment.effects[:, wanted]
    inertial, error = inertial_columns(result), result.model_error
    other = W[:, :, ~inertial] @ result.theta[~inertial]
    if error is None:
        root = symmetric_root(result.covariance)
        variance = np.stack(
            [np.sum((W[:, j] @ root) ** 2, axis=1) for j in range(W.shape[1])], axis=1
        )
    else:
        Z = orthogonal(
            shapes_of(q, qd, sign, error.speed), W, error.reference, error.scale, error.projection
        )
        own = np.einsum("mjp,jp->mj", W[:, :, ~inertial], error.own[:, ~inertial])
        other = other + np.einsum("mjk,jk->mj", Z, error.mean) + own
        variance = error.variance(W, Z, result.covariance)
    noise = result.noise if result.expected is None else result.expected.noise
    dt = float(segment.t[1] - segment.t[0])
    found = MomentumObserver(
        observer, result.theta, inertial, tuning.OBSERVER_GAIN, own_parameters(result)
    )
    torque = found.run(q, qd, segment.tau, other, dt)
    doubt = found.gain * found.momentum_size(q, _unsteadiness(q, dt))
    hold, doubt = (_spread(x, dt, log.filter.cutoff) for x in (_friction_doubt(result, qd), doubt))
    kept = slice(round(ends / dt), len(q) - round(ends / dt))
    return segment.t[kept], torque[kept], np.sqrt(variance + noise**2 + doubt**2)[kept], hold[kept]


def _unsteadiness(q: Floats, dt: float) -> Floats:
    """Return how far velocities may be off where positions are no path of a moving mass, (N, n) [rad/s or m/s]."""
    found = np.zeros_like(q)
    for step in range(1, max(1, int(0.25 / tuning.OBSERVER_GAIN / dt)) + 1):
        if len(q) <= 4 * step:
            break
        middle = slice(2 * step, -2 * step)
        far, near = q[: -4 * step] + q[4 * step :], q[step : -3 * step] + q[3 * step : -step]
        beside = np.abs(q[middle] - (4.0 * near - far) / 6.0) / (step * dt)
        np.maximum(found[middle], beside, out=found[middle])
    return found


def _friction_doubt(result: Identification, qd: Floats) -> Floats:
    """Return by how much friction may differ from what the model says, (N, n) [N m or N]."""
    slow = np.abs(qd) < tuning.STICKING_SPEEDS * np.array(result.robot.coulomb_shape.velocity)
    coulomb, viscous = friction_sizes(result, "fc"), friction_sizes(result, "fv")
    moving = tuning.FRICTION_LEVEL * (coulomb + viscous * np.abs(qd))
    return np.asarray(np.where(slow, (1.0 + tuning.STATIC_SHARE) * coulomb, moving))


def friction_sizes(result: Identification, kind: str) -> Floats:
    """Return the size of a coefficient of each joint's friction, 0 where it has none, (n,) [SI units].

    Args:
        result: the identified arm.
        kind: ``fc`` for Coulomb, ``fv`` for viscous friction.
    """
    values = dict(zip(result.names, result.theta.tolist(), strict=True))
    return np.array([abs(values.get(f"{kind}{j + 1}", 0.0)) for j in range(result.robot.n)])


def _spread(x: Floats, dt: float, cutoff: float) -> Floats:
    """Return the largest value within the reach of the filter and the memory of the observer, (N, n)."""
    from scipy.ndimage import maximum_filter1d

    before = round(3.0 / tuning.OBSERVER_GAIN / dt)
    around = round((1.0 / cutoff if cutoff else 0.0) / dt)
    wide = maximum_filter1d(x, 2 * around + 1, axis=0, mode="nearest")
    # What the observer remembers lies before an instant only.
    return np.asarray(
        maximum_filter1d(wide, before + 1, axis=0, mode="nearest", origin=before // 2)
    )


def _intervals(
    t: Floats, torque: Floats, threshold: Floats, names: tuple[str, ...]
) -> list[Contact]:
    """Return the intervals of each joint above its threshold."""
    found = []
    for j, name in enumerate(names):
        above = np.flatnonzero(np.abs(torque[:, j]) > threshold[:, j])
        if not len(above):
            continue
        cuts = np.flatnonzero(np.diff(t[above]) > tuning.CONTACT_GAP_S) + 1
        for part in np.split(above, cuts):
            rows = slice(part[0], part[-1] + 1)
            peak = torque[rows, j][np.argmax(np.abs(torque[rows, j]))]
            found.append(Contact(float(t[part[0]]), float(t[part[-1]]), name, float(peak)))
    return found
