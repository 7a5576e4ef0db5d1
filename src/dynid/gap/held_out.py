"""What an effect says on rows that were never fitted, and what is left of joints that no effect explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap.improvement import fitted_with
from dynid.gap.problem import GapProblem
from dynid.gap.search import EffectSearch
from dynid.gap.segments import SegmentRows, cut
from dynid.gap.selected_effects import SelectedEffect, torque_in_rows, with_columns, with_selected
from dynid.model.effects.interface import Floats

#: Parts of a signal's range that tell whether the residual follows it, and the share of its power from which it does.
PARTS, FOLLOWED = 12, 0.1
#: Bins in which the quantity that an effect follows is sought.
BINS = 24
#: By how much more of its power an effect has to follow time than anything else.
TIME_LEAD = 0.1


@dataclass(frozen=True)
class HeldOutEffect:
    """An effect on rows that were never fitted, of the joint that shows it most.

    Attributes:
        t: times, (M,) [s].
        residual: what is left without it, (M,) [N m or N].
        torque: what it says, (M,) [N m or N].
        left: what is left with it, everything fitted again, (M,) [N m or N].
        against: values of the quantity that its torque follows most, (M,).
        follows: that quantity with its unit, such as ``"speed of joint_3 [rad/s]"``.
    """

    t: Floats
    residual: Floats
    torque: Floats
    left: Floats
    against: Floats
    follows: str

    @property
    def data(self) -> Floats:
        """What the model leaves for the effect, (M,) [N m or N].

        Why not the residual without it: there the other parameters have taken up part of it.
        """
        return self.left + self.torque


def held_out_effect(
    problem: GapProblem, others: Sequence[SelectedEffect], one: SelectedEffect, joint: int
) -> HeldOutEffect:
    """Return what an effect says of the held-out rows of a joint, and what is left there without it.

    Args:
        problem: the rows.
        others: effects that are fitted with the model, and with it.
        one: the effect.
        joint: 0-based joint whose torque is looked at.
    """
    held, residual, _ = _held_out(problem, others)
    _, left, torques = _held_out(problem, [*others, one], one)
    use = np.concatenate([s.use[:, joint] for s in held])
    t = np.concatenate([s.t for s in held])
    torque = torques[:, joint][use]
    robot, quantities = problem.base.robot, {"time [s]": t[use]}
    for j in dict.fromkeys((joint, *one.joints)):
        unit = "rad" if robot.joints[j].revolute else "m"
        name = robot.joints[j].name
        quantities[f"position of {name} [{unit}]"] = np.concatenate([s.q[:, j] for s in held])[use]
        quantities[f"speed of {name} [{unit}/s]"] = np.concatenate([s.qd[:, j] for s in held])[use]
        load = np.concatenate([s.tau[:, j] for s in held])[use]
        quantities[f"torque of {name} [{robot.joints[j].torque_unit}]"] = load
    shares = {name: _follows(x, torque) for name, x in quantities.items()}
    # Why: on seconds of a smooth motion every torque is also one of time.
    shares["time [s]"] -= TIME_LEAD
    follows = max(shares, key=lambda name: shares[name])
    return HeldOutEffect(
        t[use], residual[:, joint][use], torque, left[:, joint][use], quantities[follows], follows
    )


def _follows(x: Floats, y: Floats) -> float:
    """Return the share of the variance of y, (M,), that lies between bins of equal count over x, (M,)."""
    parts = np.array_split(y[np.argsort(x, kind="stable")], BINS)
    means, counts = (
        np.array([part.mean() for part in parts if len(part)]),
        [len(part) for part in parts if len(part)],
    )
    return (
        float(np.average((means - y.mean()) ** 2, weights=counts) / max(float(y.var()), 1e-30))
        if len(y)
        else 0.0
    )


def _held_out(
    problem: GapProblem, selected: Sequence[SelectedEffect], shown: SelectedEffect | None = None
) -> tuple[list[SegmentRows], Floats, Floats]:
    """Return the segments with held-out rows alone, what effects leave of all rows, and the torque of the last, (M, n).

    Args:
        problem: the rows.
        selected: effects that are fitted with the model to the training rows.
        shown: the last of them, where its torque is wanted.
    """
    regression = fitted_with(problem, selected)
    theta, beta = regression.fit.theta[: problem.segments[0].W.shape[2]], regression.amplitudes
    held = cut(problem.segments, problem.held)
    e, torques = [], []
    for s, row in zip(held, regression.segments, strict=True):
        e.append(s.tau - s.W @ theta - torque_in_rows(row, selected, beta).T)
        if shown is not None:
            own = beta[len(beta) - len(shown.effect.amplitudes(shown.shape)) :]
            torques.append(torque_in_rows(row, [shown], own).T)
    return held, np.concatenate(e), np.concatenate(torques) if torques else np.zeros((0, 0))


# ---------------------------------------------------------------- what no effect explains
def clue(search: EffectSearch, joint: int) -> str:
    """Return what is known of a joint that no effect explains: what its residual follows, and whether it repeats."""
    regression = with_selected(search.problem.regression(), with_columns(search.selected))
    rows, e, noise = regression.joints[joint], regression.fit.e[joint], search.problem.noise
    e = e * noise.count[joint] ** 0.5
    signals = {"t": np.concatenate([s.t for s in regression.segments])[rows.index]}
    near = [k for k in (joint, joint - 1, joint + 1) if 0 <= k < len(regression.joints)]
    for k in near:
        for name in ("q", "qd", "tau"):
            signals[f"{name}{k + 1}"] = np.concatenate(
                [getattr(s, name)[:, k] for s in regression.segments]
            )[rows.index]
    block = rows.index // max(1, round(regression.segments[0].rate))
    shares = {name: _followed(values, e, block) for name, values in signals.items()}
    best = max(shares, key=lambda name: shares[name])
    follows = f"it depends most on {best} ({100 * shares[best]:.0f} % of its power)"
    follows = follows if shares[best] > FOLLOWED else "it depends on no single signal"
    power = max(float(np.mean(e**2)), 1e-30)
    repeats = f"{100 * max(0.0, 1 - 1 / power):.0f} % of the rest repeats with the motion; "
    name = search.problem.base.robot.joint_names[joint]
    return f"{name}: {repeats if noise.repeats else ''}{follows}"


def _followed(signal: Floats, e: Floats, block: np.ndarray) -> float:
    """Return the share of a residual's power that its mean over parts of a signal's range explains elsewhere."""
    part = np.searchsorted(np.quantile(signal, np.linspace(0, 1, PARTS + 1)[1:-1]), signal)
    left = 0.0
    even = (np.unique(block, return_inverse=True)[1] // 4) % 2 == 0
    for fitted in (even, ~even):
        count = np.maximum(np.bincount(part[fitted], minlength=PARTS), 1)
        mean = np.bincount(part[fitted], e[fitted], PARTS) / count
        left += float(np.sum((e[~fitted] - mean[part[~fitted]]) ** 2))
    return 1 - left / max(float(np.sum(e**2)), 1e-30)
