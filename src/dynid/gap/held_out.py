"""What was found on rows that were never fitted: errors before and after, each effect by itself, and what is left."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.gap.counterbalance import Links
from dynid.gap.delays import EffectSearch
from dynid.gap.gap_rows import accelerated
from dynid.gap.problem import GapProblem
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_columns, with_selected
from dynid.judgement.gap import HeldOutEffect, HeldOutImprovement

#: Blocks of time that errors are taken from: longer than the memory of whitened residuals [s], and so many of them if
#: the rows last long enough.
SHORTEST_BLOCK, LONGEST_BLOCK, BLOCKS = 0.25, 1.0, 40
#: Fewest blocks of time whose spread says anything.
MIN_BLOCKS = 3
#: Draws of the block bootstrap: the ends of a 95 % interval come from the ten outermost on either side.
DRAWS = 400
#: Length of a simulation [s], and the least inertia of a joint [kg m^2 or kg]: fitted ones may be below zero.
WINDOW_S, LEAST_INERTIA = 0.5, 2e-3
#: Parts of a signal's range that tell whether the residual follows it, and the share of its power from which it does.
PARTS, FOLLOWED = 24, 0.1
#: By how much more of its power a signal has to follow time than anything else.
TIME_LEAD = 0.1


# ---------------------------------------------------------------- the error before and after
def prediction(
    problem: GapProblem, selected: Sequence[SelectedEffect]
) -> tuple[Floats, list[Floats]]:
    """Return what model and effects, fitted together, leave of all rows, and the torque of each effect, (M, n) each.

    They are fitted to the training rows, without what is not judged.
    """
    rows, weighted = problem.rows, replace(problem, noise=problem.in_force or problem.noise)
    fit = with_selected(weighted.regression(nuisance=False), selected)
    if any(one.effect.needs_model for one in selected):
        # Effects that follow the model's torque follow that of the fit.
        again = weighted.regression(fit.theta[: fit.base], nuisance=False)
        fit = with_selected(again, selected)
    theta, sizes = fit.theta[: fit.base], fit.amplitudes
    if problem.in_force is not None:
        theta, sizes, _ = Links.beside(fit, problem.base).fit()
    torques = torque_in_rows(replace(fit.rows, use=rows.use), selected, sizes)
    return rows.tau - rows.W @ theta - sum(torques), torques


def held_out(problem: GapProblem, selected: Sequence[SelectedEffect]) -> Floats:
    """Return what model and effects leave of the held-out rows, (M, n); no number where rows do not count."""
    return np.where(_judged(problem), prediction(problem, selected)[0], np.nan)


def _judged(problem: GapProblem) -> Mask:
    """Return which rows of each joint are held out and count, (M, n)."""
    rows = problem.rows.only(problem.rows.held)
    return np.array([problem.noise.counting(rows, j) for j in range(rows.use.shape[1])]).T


def rms_of(left: Floats) -> Floats:
    """Return the rms of each joint of what is left, (n,) [N m or N]."""
    return np.sqrt(np.nansum(left**2, axis=0) / np.maximum(np.isfinite(left).sum(0), 1))


def held_out_improvement(
    problem: GapProblem, before: Floats, after: Floats, known_power: Floats
) -> HeldOutImprovement:
    """Return the gap on held-out rows before and after.

    Args:
        problem: the problem.
        before: what is left without effects, (M, n).
        after: and with them.
        known_power: expected square of what no effect has to explain, (M, n).
    """
    rows, use = problem.rows, _judged(problem)
    # Why longer: what a joint leaves of a comparison with earlier logs goes on for longer.
    shortest = LONGEST_BLOCK if problem.since else SHORTEST_BLOCK
    length = np.clip(use.any(axis=1).sum() / rows.rate / BLOCKS, shortest, LONGEST_BLOCK)
    block = 1_000_000 * rows.part + rows.at // max(1, round(length * rows.rate))
    ratio = [_ratio(b, a, block, j) for j, (b, a) in enumerate(zip(before.T, after.T, strict=True))]
    # What no effect has to explain, but for noise.
    known = rms_of(np.where(use, np.sqrt(known_power), np.nan))
    return HeldOutImprovement(
        rms_of(before),
        rms_of(after),
        np.array(ratio),
        problem.noise.floor,
        known,
        *(simulated_error(problem, left) for left in (before, after)),
    )


def simulated_error(problem: GapProblem, left: Floats) -> Floats:
    """Return how far what is left of held-out torques drives each joint in half a second, rms, (n,) [rad or m].

    A forward simulation from many places to first order: against the inertia of the joint, the others held.

    Args:
        problem: the problem.
        left: torques, (M, n); no number where rows do not count.
    """
    rows, held = problem.rows, np.isfinite(left).any(axis=1)
    q, model, n = rows.q[held], problem.base.torques(problem.theta), left.shape[1]
    inertia = np.diagonal(accelerated(model, q, np.ones(1)), axis1=0, axis2=2)
    speed_up = np.nan_to_num(left[held]) / np.maximum(inertia, LEAST_INERTIA)
    length = min(max(1, len(q)), round(WINDOW_S * rows.rate))
    windows = speed_up[: len(q) // length * length].reshape(-1, length, n)
    return rms_of(windows.cumsum(axis=1).cumsum(axis=1).reshape(-1, n) / rows.rate**2)


def _ratio(before: Floats, after: Floats, block: Ints, seed: int) -> Floats:
    """Return the 95 % interval of the ratio of rms values, (2,), of blocks of time; all (M,)."""
    use = np.isfinite(before)
    names, block = np.unique(block[use], return_inverse=True)
    if len(names) < MIN_BLOCKS:
        return np.array([0.0, np.inf])
    one, other = (np.bincount(block, x[use] ** 2, len(names)) for x in (before, after))
    share = np.full(len(names), 1 / len(names))
    counts = np.random.default_rng(seed).multinomial(len(names), share, DRAWS)
    ratios = np.sqrt(counts @ other / np.maximum(counts @ one, 1e-30))
    return np.quantile(ratios, [0.025, 0.975])


# ---------------------------------------------------------------- each effect
def held_out_effects(
    problem: GapProblem, selected: Sequence[SelectedEffect]
) -> list[HeldOutEffect]:
    """Return what each effect with columns says of the held-out rows of its joint, beside all others."""
    rows, curves = problem.rows, []
    left, torques = prediction(problem, selected)
    for one, torque in zip(with_columns(selected), torques, strict=True):
        use = rows.use[:, one.joint] & rows.held
        own = torque[use, one.joint]
        follows, against, _ = _followed(problem, (one.joint, *one.joints), use, own)
        curves.append(
            HeldOutEffect(
                data=left[use, one.joint] + own, torque=own, against=against, follows=follows
            )
        )
    return curves


# ---------------------------------------------------------------- what no effect explains
def clue(search: EffectSearch, joint: int) -> str:
    """Return what is known of a joint that no effect explains: what its residual follows, and whether it repeats."""
    problem = search.problem
    regression = with_selected(problem.regression(), search.selected)
    noise, names = regression.noise, problem.base.robot.joint_names
    e, use = regression.e[joint] * noise.count[joint] ** 0.5, noise.counting(regression.rows, joint)
    near = [k for k in (joint, joint - 1, joint + 1) if 0 <= k < len(names)]
    best, _, share = _followed(problem, near, use, e)
    follows = "it depends on no single signal"
    if share > FOLLOWED:
        follows = (
            f"it depends most on the {best.partition(' [')[0]} ({100 * share:.0f} % of its power)"
        )
    power = max(float(np.mean(e**2)), 1e-30)
    repeats = f"{100 * max(0.0, 1 - 1 / power):.0f} % of the rest repeats with the motion; "
    return f"{names[joint]}: {repeats if noise.repeats else ''}{follows}"


def _followed(
    problem: GapProblem, joints: Sequence[int], use: Mask, y: Floats
) -> tuple[str, Floats, float]:
    """Return the quantity that a signal in some rows follows most, its values there, and the share of power.

    Args:
        problem: the rows.
        joints: whose position, speed and torque are tried, 0-based.
        use: the rows, (M,).
        y: the signal in them.
    """
    rows, quantities = problem.rows, {"time [s]": problem.rows.t}
    for j in dict.fromkeys(joints):
        joint = problem.base.robot.joints[j]
        unit, name = "rad" if joint.revolute else "m", joint.name
        quantities[f"position of {name} [{unit}]"] = rows.q[:, j]
        quantities[f"speed of {name} [{unit}/s]"] = rows.qd[:, j]
        quantities[f"torque of {name} [{joint.torque_unit}]"] = rows.tau[:, j]
    block = np.flatnonzero(use) // round(rows.rate)
    shares = {name: _explained(x[use], y, block) for name, x in quantities.items()}
    # Why: on seconds of a smooth motion every torque is also one of time.
    shares["time [s]"] -= TIME_LEAD
    best = max(shares, key=lambda name: shares[name])
    return best, quantities[best][use], shares[best]


def _explained(signal: Floats, y: Floats, block: Ints) -> float:
    """Return the share of a signal's power that its mean over parts of another one's range explains elsewhere."""
    if not len(y):
        return 0.0
    part = np.searchsorted(np.quantile(signal, np.linspace(0, 1, PARTS + 1)[1:-1]), signal)
    left = 0.0
    even = (np.unique(block, return_inverse=True)[1] // 4) % 2 == 0
    for fitted in (even, ~even):
        count = np.maximum(np.bincount(part[fitted], minlength=PARTS), 1)
        mean = np.bincount(part[fitted], y[fitted], PARTS) / count
        left += np.sum((y[~fitted] - mean[part[~fitted]]) ** 2)
    return float(1 - left / max(np.sum(y**2), 1e-30))
