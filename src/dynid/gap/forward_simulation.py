"""The gap in the forward simulation: held-out torques replayed through the model in short windows, before and after.

What is simulated is the physically possible arm next to the fitted base parameters, as it would be exported: small
errors of light links would otherwise make mass matrices that no arm has.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.possible_arm import constraints_of, fit_pooled
from dynid.gap.apply import specs_of, with_specs
from dynid.gap.problem import GapProblem, information_root
from dynid.gap.regression import Regression
from dynid.gap.selected_effects import SelectedEffect
from dynid.model.base_model import BaseModel
from dynid.model.effects.motion import ArmMotion, ReferenceTorques
from dynid.model.parameters import BODY_PARAMETERS, body_columns
from dynid.robot import Body
from dynid.signals.conditioned_log import arm_motion

#: Smallest inertia that an arm must have in all directions to be replayed [kg m^2]; below, small errors of torque
#: become hundreds of rad/s^2.
LEAST_INERTIA = 2e-3
#: States along the motion at which that is checked.
CHECKED = 200
#: Windows of a replay, and how long each is [s]: long enough for an effect to move the arm, short enough that errors
#: stay in the linear range.
WINDOWS, WINDOW_S = 24, 0.5


def simulate_held_out(
    problem: GapProblem, fit: Regression, selected: Sequence[SelectedEffect]
) -> Floats | None:
    """Replay the longest held-out segment through a model; return the errors of the positions, (n,) [rad or m].

    Args:
        problem: the problem.
        fit: the fitted model, with the effects.
        selected: these effects.

    Returns:
        The errors; None when little is held out, or when the arm is too light somewhere to be replayed, or too stiff.
    """
    rows, bare = problem.rows, problem.base
    # Of equally long ones, the last.
    count, k = max((int(rows.held[part].sum()), k) for k, part in enumerate(rows.parts))
    if count < 2 * rows.rate:
        return None
    p, sizes = bare.rank, fit.amplitudes.copy()
    theta = nearest_possible(bare, fit.theta[:p], fit.root[:p] @ fit.root[:p].T)
    ends = np.cumsum([0, *(len(one.amplitudes) for one in selected)])
    for one, *edges in zip(selected, ends[:-1], ends[1:], strict=True):
        # Why not as a torque: what is carried moves with the arm, which is lighter without it and follows noise more.
        if one.name == "payload" and bare.robot.n in body_columns(bare.model.parameters):
            theta += load_parameters(bare, one)
            sizes[slice(*edges)] = 0.0
    base, theta = with_specs(bare, specs_of(selected, bare.robot)), np.append(theta, sizes)
    log, held = rows.logs[k], rows.held & (rows.part == k)
    segment = log.segments[0]
    part = slice(*np.searchsorted(segment.elapsed, rows.t[held][[0, -1]]).tolist())
    reference = base.torques(theta)
    # Why along the measured motion: states such as a bristle's need the path, and the windows stay close to it.
    motion = arm_motion(segment, log.filter, base.model, reference)
    tau = segment.tau[part] - torque_of_effects(base, theta, motion)[part]
    some = slice(part.start, part.stop, max(1, (part.stop - part.start) // CHECKED))
    if least_inertia(reference, segment.q[some]) < LEAST_INERTIA:
        return None

    return replay(reference, segment.elapsed[part], segment.q[part], segment.qd[part], tau)


def replay(
    reference: ReferenceTorques, t: Floats, q: Floats, qd: Floats, tau: Floats
) -> Floats | None:
    """Integrate a model under measured torques from many places; return the rms position errors, (n,) [rad or m].

    None where it flies off by more than the motion is wide, as one that is stiffer than the samples are close does.

    Args:
        reference: the model.
        t: times, evenly spaced, (N,) [s].
        q: measured positions, (N, n).
        qd: measured velocities, (N, n).
        tau: measured torques, (N, n).
    """
    dt = t[1] - t[0]
    length = round(WINDOW_S / dt)
    count = max(1, min(WINDOWS, (len(t) - 1) // length))
    starts = np.linspace(0, len(t) - length - 1, count).astype(int)
    x, v, errors = q[starts], qd[starts], np.zeros((count, q.shape[1]))
    widest = np.ptp(q, axis=0).max()
    for at in (starts + k for k in range(length)):
        bias, M = _dynamics(reference, x, v)
        torque = 0.5 * (tau[at] + tau[at + 1]) - bias
        v += dt * np.linalg.solve(M, torque[..., None])[..., 0]
        x += dt * v
        off = x - q[at + 1]
        if not np.abs(off).max() < widest:
            return None
        errors += off**2
    return np.asarray(np.sqrt(errors.mean(axis=0) / length))


def nearest_possible(base: BaseModel, theta: Floats, covariance: Floats) -> Floats:
    """Return the base parameters of the physically possible arm next to fitted ones, (p,).

    Args:
        base: model and base parameters.
        theta: fitted base parameters, (p,).
        covariance: of them, (p, p).
    """
    R, K = information_root(covariance), base.reduction.K
    return np.asarray(K @ fit_pooled(R @ K, R @ theta, constraints_of(base))[0].x)


def load_parameters(base: BaseModel, load: SelectedEffect) -> Floats:
    """Return by how much a load on the last link changes the base parameters, (p,).

    Args:
        base: model and base parameters.
        load: the effect, with values; where its inertia is not known, its mass is taken to be in one point.
    """
    m, *first = (load.values.get(name, 0.0) for name in BODY_PARAMETERS[:4])
    x, y, z = (each / m if m else 0.0 for each in first)
    body = Body(m, (x, y, z)).parameters()
    if all(name in load.values for name in BODY_PARAMETERS):
        body = np.array([load.values[name] for name in BODY_PARAMETERS])
    return np.asarray(base.reduction.K[:, body_columns(base.model.parameters)[base.robot.n]] @ body)


def torque_of_effects(base: BaseModel, theta: Floats, motion: ArmMotion) -> Floats:
    """Return the torque of all effects of a model along a motion, (N, n).

    Args:
        base: model and base parameters.
        theta: values of the base parameters, (p,).
        motion: the motion.
    """
    columns = base.reduction.base
    added = columns >= base.model.size_without_effects
    torque: Floats = base.model.observer(columns[added]).along(motion) @ theta[added]
    return torque


def least_inertia(reference: ReferenceTorques, q: Floats) -> float:
    """Return the smallest eigenvalue of the mass matrix over positions, [kg m^2]."""
    return float(np.linalg.eigvalsh(_dynamics(reference, q, np.zeros_like(q))[1]).min())


def _dynamics(reference: ReferenceTorques, q: Floats, qd: Floats) -> tuple[Floats, Floats]:
    """Return the torques of states at no acceleration, (B, n), and mass matrices, (B, n, n)."""
    count, n = q.shape
    unit = np.tile(np.concatenate([np.zeros((1, n)), np.eye(n)]), (count, 1))
    torque = reference.total(np.repeat(q, n + 1, axis=0), np.repeat(qd, n + 1, axis=0), unit)
    torque = torque.reshape(count, n + 1, n)
    M = torque[:, 1:] - torque[:, :1]
    return torque[:, 0], 0.5 * (M + M.transpose(0, 2, 1))
