"""Logs of the generator, conditioned for a search, and the model that lacks what is hidden in them."""

from dataclasses import replace
from functools import cache

import hidden_effects as hidden
import models
from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.robot import Coulomb
from dynid.signals.conditioned_log import condition_log
from dynid.signals.stamps import with_even_clock


@cache
def model_of(name):
    """Return the model of an arm with viscous and Coulomb friction."""
    robot = load_robot(hidden.ARMS[name][0])
    joints = (
        replace(j, friction=("viscous", "coulomb"), motor_inertia=False) for j in robot.joints
    )
    # The truth is tanh(v / 0.003); 0.005 leaves a difference that the search must not take for an effect.
    coulomb = Coulomb("smooth", (0.005,) * robot.n)
    return models.base_of(replace(robot, joints=tuple(joints), coulomb=coulomb))


def sources_of(logs, model):
    """Return logs conditioned at 10 Hz, on the clock of their session."""
    found = []
    for k, (t, q, tau) in enumerate(logs):
        log = with_even_clock(Log(t, q, tau, model.robot.joint_names))
        one = replace(condition_log(log, model, cutoff=10.0), name=f"log {k + 1}")
        since = t[0] - logs[0][0][0]
        moved = [replace(part, elapsed=part.elapsed + since) for part in one.segments]
        found.append(replace(one, segments=moved))
    return found


def logs_of(effects, size, arm, seed, drop_outs=False, **options):
    """Return logs with one effect, or with the torques of two added to the same motion and noise, and the cases."""
    cases = [hidden.Case(arm, name, joint, size, seed, drop_outs) for name, joint in effects]
    logs = hidden.simulate(cases[0], **options)
    for case in cases[1:]:
        other, bare = (hidden.simulate(case, hide=hide, **options) for hide in (True, False))
        logs = [
            (t, q, tau + a - b)
            for (t, q, tau), (_, _, a), (_, _, b) in zip(logs, other, bare, strict=True)
        ]
    return logs, cases
