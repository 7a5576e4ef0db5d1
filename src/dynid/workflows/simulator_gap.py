"""The gap in the simulator itself: exported files driven along an unseen motion, before and after."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from dynid import arguments
from dynid.arguments import public
from dynid.arrays import Floats
from dynid.errors import WrongUsage
from dynid.estimation.result import Identification
from dynid.exporters.driven import drive
from dynid.exporters.engines import module
from dynid.loading import LogLike, ResultLike, as_log, as_results, checked_log, condition_logs
from dynid.log import Log
from dynid.model.regressor import mass_matrices
from dynid.options import LogOptions
from dynid.progress import Progress, heard_by, stage
from dynid.reports.figures import write_figure
from dynid.reports.gap_figures import simulator_figure
from dynid.sim import tuning
from dynid.sim.comparison import SimulatorGap
from dynid.workflows.export import identified_arm
from dynid.workflows.gap import Gap

#: Engines that an exported file can be driven in.
ENGINES = ("mujoco", "pybullet")


@public
def compare_in_simulator(
    results: ResultLike | Sequence[ResultLike],
    log: LogLike,
    *,
    engine: str = "mujoco",
    names: Sequence[str] = (),
    seconds: float | None = None,
    progress: Progress | None = None,
) -> SimulatorGap:
    """Drive the exported files of results along a recording in a simulator, with one controller for all.

    Measured torques act on the simulated arm; a soft controller of 1 Hz holds it near the recorded motion. The position
    error is how far it strays, the torque error what the controller had to add.

    Args:
        results: results of one arm, such as before and after an effect was added.
        log: a recording, best one that was not fitted.
        engine: ``"mujoco"`` or ``"pybullet"``.
        names: of the results; before and after for two of them.
        seconds: the last so many seconds of the recording are driven; None for all [s].
        progress: reports what is simulated.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).
        PackageMissing: the simulator is not installed.
        NotSimulated: a simulation diverges.
        DynidError: the first serious fault of the log.

    Example:
        dynid.compare_in_simulator(["out/before", "out/after"], "run3.bag")
    """
    given = as_results(results)
    robot, count = given[0].robot, len(given)
    recording = as_log(log, robot, LogOptions())
    if arguments.words((engine,), "engine", ENGINES) != (engine,):
        raise WrongUsage(f"there is no engine '{engine}'", fix=" or ".join(ENGINES))
    models = arguments.words(names, "names") or (
        ("before", "after") if count == 2 else tuple(f"{k + 1}" for k in range(count))
    )
    if seconds is not None:
        wanted = "a length in seconds, such as 10.0, or None for all"
        seconds = arguments.number(seconds, "seconds", wanted)
        if not seconds > 0.0:
            raise WrongUsage(f"{seconds:g} s cannot be driven", fix="seconds=10.0, or None for all")
    if any(each.robot.joint_names != robot.joint_names for each in given):
        raise WrongUsage("the results are of different arms", fix="results of one arm")
    if len(models) != count:
        raise WrongUsage(f"{len(models)} names for {count} results", fix="one name per result")
    recorded = _recorded(given[0], recording, seconds)
    arms = [identified_arm(each, ("mjcf",)) for each in given]
    inertia, runs = _inertia(given[-1], recorded[1]), []
    for name, arm in zip(models, arms, strict=True):
        stage("simulate", f"{name}, {len(recorded[0])} samples")
        runs.append(drive(arm, engine, recorded, inertia))
    return SimulatorGap(
        robot=robot,
        log=str(recording.source or recording.name),
        engine=engine,
        models=models,
        t=recorded[0],
        q=recorded[1],
        simulated=np.array([q for q, _ in runs]),
        added=np.array([added for _, added in runs]),
    )


def gap_in_simulator(gap: Gap, after: Identification) -> SimulatorGap:
    """Drive an arm without and with what a search named along a recording, at best one that was held out.

    Args:
        gap: the search.
        after: what ``gap.apply`` returned.

    Raises:
        PackageMissing: no simulator is installed.
        NotSimulated: a simulation diverges.
    """
    assert gap.searched is not None
    log = (*gap.unseen_logs, *reversed(gap.recordings))[0]
    engine = next((name for name in ENGINES if module(name) is not None), ENGINES[0])
    return compare_in_simulator((gap.searched, after), log, engine=engine, seconds=tuning.DRIVEN_S)


@heard_by()
def _recorded(
    result: Identification, log: Log, seconds: float | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return time, position, velocity and torque of the end of the longest part without gaps of a log, filtered."""
    options = LogOptions(cutoff=result.cutoff or None, delay=result.delay)
    checked = checked_log(log, result.robot, options, identify=False)
    (conditioned,) = condition_logs([checked], result.base.model, options)
    longest = max(conditioned.segments, key=len)
    first = 0 if seconds is None else int(np.searchsorted(longest.t[:-2], longest.t[-1] - seconds))
    t, q, qd, tau = (x[first:] for x in (longest.t, longest.q, longest.qd, longest.tau))
    return t - t[0], q, qd, tau


def _inertia(result: Identification, q: Floats) -> Floats:
    """Return what each joint moves, on average along a motion, (n,) [kg m^2 or kg]."""
    some = q[:: max(1, len(q) // 100)]
    matrices = mass_matrices(lambda *state: result.base.observer.torque(result.theta, *state), some)
    return np.asarray(np.abs(np.diagonal(matrices, axis1=1, axis2=2)).mean(axis=0))


def save_figure(gap: SimulatorGap, path: Path) -> Path:
    """Write the picture of the position errors."""
    return write_figure(simulator_figure(gap), path)
