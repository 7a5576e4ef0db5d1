"""From recordings to what rows are made of: read, checked, conditioned, known torques taken off."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from dynid.errors import Finding
from dynid.estimation.effect_columns import on_time, with_effects
from dynid.estimation.stack import Source
from dynid.files.logs import read_log
from dynid.log import Log
from dynid.model.effects.catalogue import delay_of
from dynid.model.prior import prior_parameters
from dynid.model.regressor import Model
from dynid.signals.checks import prepare
from dynid.signals.conditioning import Segment, choose_filter, condition
from dynid.signals.delay import without_delay
from dynid.signals.spikes import despiked


@dataclass(frozen=True)
class Reading:
    """How logs are read and conditioned.

    Attributes:
        topic: ROS topic, None for the driver's.
        rate: sample rate of text files without time [Hz].
        cutoff: cut-off of the parallel filter [Hz], None to choose it from the motion.
        velocity: ``"derived"`` from positions, whatever the driver measured; ``"measured"`` by the driver; or ``""``:
            derived, after the measured one was compared with it.
        exclude: stretches to leave out [s].
        sort_time: sort shuffled stamps.
        delay: by how much the torques are late; they are moved back by it [s].
        identify: refuse logs that are too short or too still to identify from.
    """

    topic: str | None = None
    rate: float | None = None
    cutoff: float | None = None
    velocity: str = ""
    exclude: tuple[tuple[float, float], ...] = ()
    sort_time: bool = False
    delay: float = 0.0
    identify: bool = True


def read_source(path: Path, model: Model, reading: Reading) -> tuple[Source, Log]:
    """Read one log into what rows are made from.

    Args:
        path: the log.
        model: the model whose rows are wanted.
        reading: how to read it.

    Returns:
        The conditioned log and the prepared one, whose findings are worth showing.
    """
    robot = model.robot
    log = read_log(path, robot=robot, topic=reading.topic, rate=reading.rate)
    if reading.velocity == "derived":
        log = replace(log, qd=None)
    log = prepare(log, robot, exclude=reading.exclude, sort_time=reading.sort_time, identify=reading.identify)
    if reading.velocity == "measured" and log.qd is None:
        log = replace(log, qd=log.extra.get("qd_reported"))
    if reading.velocity == "measured" and log.qd is None:
        text = f"{path.name} has no velocity; the derived one is used"
        log = replace(log, findings=(*log.findings, Finding("W308", "warning", text)))
    cutoff = choose_filter(log, robot, reading.cutoff).cutoff
    log, spikes = despiked(log, cutoff)
    log = replace(log, findings=(*log.findings, *spikes))
    return conditioned_source(log, model, replace(reading, cutoff=cutoff), path.name), log


def conditioned_source(log: Log, model: Model, reading: Reading, name: str) -> Source:
    """Return what rows are made from, of a prepared log.

    Args:
        log: a prepared log, in DH quantities.
        model: the model whose rows are wanted.
        reading: how to condition it.
        name: the log's name.
    """
    robot = model.robot
    chosen = choose_filter(log, robot, reading.cutoff)
    aligned = without_delay(log, reading.delay)
    coulomb = robot.coulomb_shape
    turns = zip(coulomb.velocity, robot.joints, strict=True)
    rest = np.array([v if "coulomb" in joint.friction else 0.0 for v, joint in turns])
    measured = reading.velocity == "measured"
    segments = condition(aligned, chosen, reading.exclude, measured_velocity=measured, coulomb=coulomb, rest_speed=rest)
    source = Source([on_time(s, delay_of(robot)) for s in without_known(segments, model)], chosen, name)
    return with_effects(source, model)


def common_cutoff(sources: Sequence[Source]) -> float:
    """Return the largest cut-off of several logs [Hz]: one filter has to serve all that are stacked."""
    return max(source.chosen.cutoff for source in sources)


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
