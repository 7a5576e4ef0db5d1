"""From checked logs to what rows are made of: conditioned, known torques taken off, columns of effects added."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.estimation.effect_columns import on_time, with_effects
from dynid.estimation.stack import Source
from dynid.log import Log
from dynid.model.effects.catalogue import delay_of
from dynid.model.prior import prior_parameters
from dynid.model.regressor import Model
from dynid.signals.conditioning import Segment, choose_filter, condition
from dynid.signals.delay import without_delay


@dataclass(frozen=True)
class Conditioning:
    """How checked logs are filtered.

    Attributes:
        cutoff: cut-off of the parallel filter [Hz], None to choose it from the motion.
        delay: by how much the torques are late; they are moved back by it [s].
        measured_velocity: take the velocity that the driver measured, where there is one.
    """

    cutoff: float | None = None
    delay: float = 0.0
    measured_velocity: bool = False


def conditioned_source(log: Log, model: Model, how: Conditioning, name: str) -> Source:
    """Return what rows are made from, of a prepared log.

    Args:
        log: a prepared log, in DH quantities.
        model: the model whose rows are wanted.
        how: how to filter it.
        name: the log's name.
    """
    robot = model.robot
    chosen = choose_filter(log, robot, how.cutoff)
    aligned = without_delay(log, how.delay)
    coulomb = robot.coulomb_shape
    turns = zip(coulomb.velocity, robot.joints, strict=True)
    rest = np.array([v if "coulomb" in joint.friction else 0.0 for v, joint in turns])
    segments = condition(aligned, chosen, measured_velocity=how.measured_velocity, coulomb=coulomb, rest_speed=rest)
    source = Source([on_time(s, delay_of(robot)) for s in without_known(segments, model)], chosen, name)
    return with_effects(source, model)


def without_known(segments: Sequence[Segment], model: Model) -> list[Segment]:
    """Subtract the torque of links that keep their prior values, so that the rest fits the identified columns."""
    others = tuple(k for k in range(1, model.robot.n + 1) if k not in model.robot.identified_links)
    if not others:
        return list(segments)
    frozen = tuple(replace(joint, friction=(), motor_inertia=False) for joint in model.robot.joints)
    rest = Model(replace(model.robot, links=others, joints=frozen, coupling=None), model.rigid)
    prior = prior_parameters(model.robot).reshape(-1, 10)[np.array(others) - 1].ravel()
    observer = rest.observer()
    return [replace(s, tau=s.tau - observer.torque(prior, s.q, s.qd, s.qdd)) for s in segments]
