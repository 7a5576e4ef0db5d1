"""The gap in the simulator itself: exported files driven along an unseen motion, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynid.arguments import public
from dynid.errors import WrongUsage
from dynid.estimation.result import Identification
from dynid.exporters.driven import drive
from dynid.loading import LogLike, ResultLike, as_log, as_results, checked_log
from dynid.model.regressor import mass_matrices
from dynid.options import LogOptions
from dynid.progress import Progress, heard_by, stage
from dynid.reports.figures import write_figure
from dynid.reports.gap_figures import simulator_figure
from dynid.signals.conditioned_log import condition_logs
from dynid.sim import tuning
from dynid.sim.comparison import SimulatorGap
from dynid.workflows.export import identified_arm
from dynid.workflows.gap import Gap


@public
def compare_in_simulator(
    results: ResultLike | Sequence[ResultLike],
    log: LogLike,
    *,
    seconds: float | None = None,
    progress: Progress | None = None,
) -> SimulatorGap:
    """Drive the exported files of results along a recording in a simulator, with one controller for all.

    Measured torques act on the simulated arm; a soft controller of 1 Hz holds it near the recorded motion. The position
    error is how far it strays, the torque error what the controller had to add.

    Args:
        results: results of one arm, such as before and after an effect was added.
        log: a recording, best one that was not fitted.
        seconds: the last so many seconds of the recording are driven; None for all [s].
        progress: reports what is simulated.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).
        NotSimulated: a simulation diverges.
        DynidError: the first serious fault of the log.

    Example:
        dynid.compare_in_simulator(["out/before", "out/after"], "run3.bag")
    """
    given = as_results(results)
    first, last = given[0], given[-1]
    robot, options = first.robot, LogOptions(cutoff=first.cutoff or None, delay=first.delay)
    recording = as_log(log, robot, options)
    names = ("before", "after") if len(given) == 2 else [str(k + 1) for k in range(len(given))]
    if any(each.robot.joint_names != robot.joint_names for each in given):
        raise WrongUsage("the results are of different arms", fix="results of one arm")
    with heard_by():
        checked = checked_log(recording, robot, options, identify=False)
        (conditioned,) = condition_logs([checked], first.base.model, options)
    # The end of the longest part without gaps.
    longest = max(conditioned.segments, key=len)
    begin = -np.inf if seconds is None else longest.t[-1] - seconds
    start = int(np.searchsorted(longest.t[:-2], begin))
    t, q, qd, tau = (x[start:] for x in (longest.t, longest.q, longest.qd, longest.tau))
    some = q[:: max(1, len(q) // 100)]
    matrices = mass_matrices(lambda *state: last.base.observer.torque(last.theta, *state), some)
    # What each joint moves, on average along the motion, (n,) [kg m^2 or kg].
    inertia = np.abs(np.diagonal(matrices, axis1=1, axis2=2)).mean(axis=0)
    runs = []
    for name, each in zip(names, given, strict=True):
        arm = identified_arm(each, ("mjcf",))
        stage("simulate", f"{name}, {len(t)} samples")
        runs.append(drive(arm, (t - t[0], q, qd, tau), inertia))
    simulated, added = (np.array(each) for each in zip(*runs, strict=True))
    return SimulatorGap(
        robot=robot,
        log=str(recording.source or recording.name),
        engine="mujoco",
        models=tuple(names),
        t=t - t[0],
        q=q,
        simulated=simulated,
        added=added,
    )


def gap_in_simulator(gap: Gap, after: Identification) -> SimulatorGap:
    """Drive an arm without and with what a search named along a recording, at best one that was held out.

    Args:
        gap: the search.
        after: what ``gap.apply`` returned.

    Raises:
        NotSimulated: a simulation diverges.
    """
    assert gap.searched is not None
    log = (*gap.unseen_logs, *reversed(gap.recordings))[0]
    return compare_in_simulator((gap.searched, after), log, seconds=tuning.DRIVEN_S)


def save_figure(gap: SimulatorGap, path: Path) -> Path:
    """Write the picture of the position errors."""
    return write_figure(simulator_figure(gap), path)
