"""What a planned motion uses, teaches and costs: the JSON answer of ``dynid trajectory`` and the same in words."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common

if TYPE_CHECKING:
    from numpy.typing import NDArray

    from dynid.cli.trajectory import Task
    from dynid.cli.trajectory_preview import Verdict
    from dynid.model.store import BaseModel
    from dynid.motion import Motion
    from dynid.trajectory.limits import LimitCheck
    from dynid.trajectory.optimise import SearchOutcome
    from dynid.trajectory.planning import PlanningContext, Proposal


def search_facts(task: Task, chosen: Proposal, found: SearchOutcome | None) -> dict[str, Any] | None:
    """Return how a motion was found, with all that makes it again; None when a person gave the path."""
    if chosen.start is None:
        return None
    again = f"--seed {task.seed}"
    if found is not None and found.ended != "all starts":
        again += f" --replay {chosen.start}:{chosen.evaluation}"
    return {
        "seed": task.seed,
        "ended": "no search" if found is None else found.ended,
        "finished_starts": 0 if found is None else found.finished,
        "start": chosen.start,
        "evaluation": chosen.evaluation,
        "share": chosen.share,
        "again": again,
    }


def answer_of(task: Task, context: PlanningContext, verdict: Verdict) -> dict[str, Any]:
    """Return the JSON answer, the prediction included."""
    from dataclasses import asdict

    from dynid.cli.prior_information import noise_source
    from dynid.trajectory.predict import alpha_table, predict

    assert verdict.check is not None
    base, options, trajectory = context.base, context.options, verdict.trajectory
    columns = base.reduction.base
    motion = trajectory.sampled(options.rate)
    found = predict(base.model, columns, motion, options.noise, context.other, options.known)
    rows = alpha_table(trajectory, base.model, columns, options.noise, context.other, options.known)
    if task.options["select"] is not None:
        verdict.selected = _selected(task, base, motion)
    return {
        "schema": "dynid/trajectory/1",
        "robot": base.robot.name,
        "duration_s": trajectory.duration,
        "alpha": trajectory.alpha,
        "condition_number": found.figures.condition,
        "condition_number_scaled": found.figures.condition_scaled,
        "smallest_singular_value": found.figures.smallest,
        "peak": [
            {
                "joint": p.joint,
                "position_rad": p.position,
                "velocity_rad_s": p.velocity,
                "acceleration_rad_s2": p.acceleration,
                "torque_nm": p.torque,
                "limit_share": p.share,
            }
            for p in verdict.check.peaks
        ],
        "tool_speed_m_s": verdict.check.tool_speed,
        "collisions": [],
        "closest_m": min((d.distance for d in verdict.distances), default=None),
        "closest": [{"pair": d.pair, "distance_m": d.distance, "time_s": d.time} for d in verdict.distances[:5]],
        "predicted_std_error": dict(zip(base.reduction.base_names, found.std_error.tolist(), strict=True)),
        "expected_torque_error_nm": found.torque_error,
        "ladder": [asdict(row) for row in rows],
        "torque_noise_nm": options.noise.tolist(),
        "torque_noise_from": noise_source(base.robot, task.options["noise"], task.options["earlier"]),
        "selected_samples": None if verdict.selected is None else len(verdict.selected),
        "weakest": _weakest(context, found.std_error),
        "search": verdict.search,
    }


def _selected(task: Task, base: BaseModel, motion: Motion) -> NDArray[Any]:
    """Return the measurement points that Eqs. 15-16 choose."""
    from dynid.trajectory.cost import select_samples

    W = base.model.observer(base.reduction.base).dense(motion.q, motion.qd, motion.qdd)
    return select_samples(W, task.options["select"])


def _weakest(context: PlanningContext, std_error: NDArray[Any]) -> str:
    """Return the base parameter whose error costs the most torque on other motions."""
    import numpy as np

    cost = std_error * np.sqrt(np.diag(context.other))
    return context.base.reduction.base_names[int(np.argmax(cost))]


def show(common: Common, context: PlanningContext, verdict: Verdict, facts: dict[str, Any]) -> None:
    """Say on stderr what was found, and print the joints' peaks on stdout."""
    terminal, limits, trajectory = common.terminal, context.limits, verdict.trajectory
    assert verdict.check is not None
    basis = trajectory.basis.facts
    kind = (
        f"{len(basis['knots']) - 1} {basis['kind']} segments" if "knots" in basis else f"{basis['harmonics']} harmonics"
    )
    alpha, full = trajectory.alpha, trajectory.basis.duration
    slow = f"{trajectory.duration:.1f} s at alpha {alpha:g} (speed x{alpha:g}, acceleration x{alpha**2:.2g})"
    terminal.stage("plan", f"{kind}, {full:.1f} s at full speed; {slow}")
    if facts["search"] is not None:
        terminal.stage("search", _found_how(facts["search"]))
    terminal.stage("limits", _shares(verdict.check, limits))
    near = verdict.distances[0] if verdict.distances else None
    if near is not None:
        words = f"at least {1000 * near.distance:.0f} mm" if near.distance >= 0.3 else f"{1000 * near.distance:.0f} mm"
        terminal.stage("collision", f"none; nearest {near.pair} at {words}, t = {near.time:.1f} s")
    terminal.findings(verdict.findings)
    condition, scaled, smallest = (
        facts[key] for key in ("condition_number", "condition_number_scaled", "smallest_singular_value")
    )
    words = f"condition number {condition:.3g} (columns of equal length: {scaled:.3g})"
    terminal.stage("excitation", f"{words}   smallest singular value {smallest:.2g}")
    error, weakest = facts["expected_torque_error_nm"], facts["weakest"]
    terminal.stage("predicted", f"torque error {error:.2g} N m on other motions; weakest: {weakest}")
    low, high = min(facts["torque_noise_nm"]), max(facts["torque_noise_nm"])
    size = f"{low:.2g}" if low == high else f"{low:.2g} to {high:.2g}"
    terminal.stage("noise", f"{size} N m a sample, {facts['torque_noise_from']}")
    _show_ladder(common, facts)
    for path in verdict.pictures:
        terminal.stage("preview", str(path))
    rows = [
        (p.joint, f"{p.position:.3f}", f"{p.velocity:.3f}", f"{p.acceleration:.3f}",
         "-" if p.torque is None else f"{p.torque:.2f}", f"{100 * p.share:.0f} %")
        for p in verdict.check.peaks
    ]  # fmt: skip
    terminal.table(("joint", "position rad", "velocity rad/s", "accel. rad/s^2", "torque N m", "of limit"), rows)


def _found_how(search: dict[str, Any]) -> str:
    """Say how the search ended and what makes the same plan again."""
    count = search["finished_starts"]
    done = f"{count} start{'s' * (count != 1)} finished"
    how = {
        "no search": "a random motion",
        "all starts": f"all {done}",
        "time": f"the time was over, {done}",
        "interrupt": f"interrupted, {done}",
        "replay": "an earlier search's best, made again",
    }[search["ended"]]
    drawn = f", drawn in to {100 * search['share']:.0f} % to keep clear" if search["share"] < 1 else ""
    return f"{how}{drawn}; the same plan again: {search['again']}"


def _shares(check: LimitCheck, limits: Any) -> str:  # noqa: ANN401
    import numpy as np

    middle, half = (limits.upper + limits.lower) / 2, (limits.upper - limits.lower) / 2
    peaks = check.peaks
    shares = {
        "position": np.max(np.abs(np.array([p.position for p in peaks]) - middle) / half),
        "speed": np.max(np.array([p.velocity for p in peaks]) / limits.velocity),
        "acceleration": np.max(np.array([p.acceleration for p in peaks]) / limits.acceleration),
        "torque": np.max(np.array([p.torque or 0.0 for p in peaks]) / limits.torque),
    }
    words = "   ".join(f"{name} {100 * share:.0f} %" for name, share in shares.items())
    return f"{words}   of what the margin leaves: all inside; tool up to {check.tool_speed:.2f} m/s"


def _show_ladder(common: Common, facts: dict[str, Any]) -> None:
    """Say what slowing down costs, so that nobody identifies from a first, slow run by mistake."""
    rows = facts["ladder"]
    full = next(row for row in rows if row["alpha"] == 1.0)
    here = next(row for row in rows if row["alpha"] == facts["alpha"])
    for row in rows:
        times = row["torque_error"] / full["torque_error"]
        mark = "  <- this plan" if row is here else ""
        common.terminal.stage(
            "ladder", f"alpha {row['alpha']:g}: {row['duration']:.0f} s, expected torque error x{times:.3g}{mark}"
        )
    if here["alpha"] < 1:
        times = here["torque_error"] / full["torque_error"]
        cost = f"at alpha {here['alpha']:g} the expected torque error is {times:.2g} times larger than at 1.0"
        common.terminal.stage("note", f"{cost} for equally many samples: a first, safe run; then 0.5, then 1.0")
