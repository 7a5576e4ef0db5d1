"""What an effect says on rows that were never fitted, and what is left of joints that no effect explains."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from dynid.gap.improvement import fitted_with
from dynid.gap.problem import GapProblem
from dynid.gap.regression import Regression
from dynid.gap.search import EffectSearch
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
    rows, robot = problem.rows, problem.base.robot
    use = rows.use[:, joint] & rows.held
    residual = _left_by(problem, others)[0][use, joint]
    left, regression = _left_by(problem, [*others, one])
    own = regression.amplitudes[-len(one.amplitudes) :]
    torque = torque_in_rows(regression.rows, [one], own)[use, joint]
    quantities = {"time [s]": rows.t}
    for j in dict.fromkeys((joint, *one.joints)):
        unit, name = "rad" if robot.joints[j].revolute else "m", robot.joints[j].name
        quantities[f"position of {name} [{unit}]"] = rows.q[:, j]
        quantities[f"speed of {name} [{unit}/s]"] = rows.qd[:, j]
        quantities[f"torque of {name} [{robot.joints[j].torque_unit}]"] = rows.tau[:, j]
    shares = {name: _follows(x[use], torque) for name, x in quantities.items()}
    # Why: on seconds of a smooth motion every torque is also one of time.
    shares["time [s]"] -= TIME_LEAD
    follows = max(shares, key=lambda name: shares[name])
    against = quantities[follows][use]
    return HeldOutEffect(rows.t[use], residual, torque, left[use, joint], against, follows)


def _follows(x: Floats, y: Floats) -> float:
    """Return the share of the variance of y, (M,), that lies between bins of equal count over x, (M,)."""
    if not len(y):
        return 0.0
    parts = [z for z in np.array_split(y[np.argsort(x, kind="stable")], BINS) if len(z)]
    means = np.array([z.mean() for z in parts])
    between = np.average((means - y.mean()) ** 2, weights=[len(z) for z in parts])
    return float(between / max(float(y.var()), 1e-30))


def _left_by(problem: GapProblem, selected: Sequence[SelectedEffect]) -> tuple[Floats, Regression]:
    """Return what effects, fitted with the model to the training rows, leave of all rows, (M, n), and that fit."""
    fit = fitted_with(problem, selected)
    left = problem.rows.tau - problem.rows.W @ fit.theta[: fit.base]
    return left - torque_in_rows(fit.rows, selected, fit.amplitudes), fit


# ---------------------------------------------------------------- what no effect explains
def clue(search: EffectSearch, joint: int) -> str:
    """Return what is known of a joint that no effect explains: what its residual follows, and whether it repeats."""
    regression = with_selected(search.problem.regression(), with_columns(search.selected))
    noise, rows = regression.noise, regression.rows
    e, use = regression.e[joint] * noise.count[joint] ** 0.5, noise.counting(rows, joint)
    signals = {"t": rows.t[use]}
    for k in (joint, joint - 1, joint + 1):
        if 0 <= k < len(regression.y):
            signals |= {
                f"{name}{k + 1}": getattr(rows, name)[use, k] for name in ("q", "qd", "tau")
            }
    block = np.flatnonzero(use) // max(1, round(rows.rate))
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
