"""Exciting motions in one table: every family and every cost, random search and the paper's recipe, for two arms.

Run: python benchmarks/excitation.py            the cells that benchmarks/excitation.json lacks, then excitation.md
     python benchmarks/excitation.py --fresh    all of them, about 20 minutes of one core
Budgets are processor time of one process, so a busy machine changes the waiting, not the table. 10 s from rest to rest
inside 95 % of the position range and the whole of the speed and acceleration limits; no floor, so that figures compare
with others. Viscous and Coulomb friction, no offset: 62 base columns, of which 43 are the rigid ones (no friction, no
rotor). Error: expected rms torque error on 6 other motions after 1,000 samples with 0.1 N m of white noise. Limits are
judged on positions at 10 kHz and their differences, by no code of the planner.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")

import itertools
import sys
import time
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

import study
from dynid.model.base_model import BaseModel
from dynid.model.regressor_gradient import RegressorGradient
from dynid.trajectory.basis import Quintic
from dynid.trajectory.cost import Cost, figures
from dynid.trajectory.feasible import Bounds, Shaping, bounds, coefficients, random_variables
from dynid.trajectory.objective import ExcitationObjective, PlanProblem
from dynid.trajectory.optimise import descend
from dynid.trajectory.plan import Trajectory, through_waypoints
from dynid.trajectory.predict import held_out, predict
from models import with_plain_friction

HERE = Path(__file__).parent
STORE, TABLE = HERE / "excitation.json", HERE / "excitation.md"
ARMS = {"kuka_lwr4plus": "KUKA LWR4+", "kinova_gen2": "Kinova Gen2"}
DURATION, NOISE = 10.0, 0.1
#: Processor seconds of a cell that only stands in the grid, and of the long comparison, arm by arm.
SHORT, LONG = 8.0, {"kuka_lwr4plus": 45.0, "kinova_gen2": 30.0}
FAMILIES = {
    "quintic, 6 waypoints": Quintic.even(DURATION, 5),
    "quintic, 11 waypoints": Quintic.even(DURATION, 10),
    "spline, 14 control points": Quintic.even(DURATION, 9, smooth=True),
}
#: The figure by which a cost is compared with random search.
FIGURE = {
    "I-optimal": "error",
    "D-optimal": "error",
    "cond": "cond",
    "cond, normalised": "scaled",
    "cond, rigid columns": "rigid",
    "Eq. 14 along the path": "cond",
}
LONG_COSTS = ("I-optimal", "D-optimal", "cond", "cond, normalised", "cond, rigid columns")
HEADER = (
    "motion | cond 62 | cond 43 | normalised 62 | error mN m | limits broken | length s | starts"
)


@dataclass(frozen=True)
class Bench:
    """One arm with its columns, its limits and the motions it is judged on."""

    base: BaseModel
    rigid: np.ndarray
    limits: Bounds
    other: np.ndarray
    costs: dict[str, tuple[np.ndarray, Cost]]

    def row(self, trajectory, starts):
        """Return the figures of one motion, judged on 1,000 samples."""
        motion = trajectory.motion(np.linspace(0, trajectory.duration, 1000))
        noise = np.full(self.base.robot.n, NOISE)
        found = predict(self.base, motion, noise, self.other)
        W = self.base.model.observer(self.rigid).dense(motion.q, motion.qd, motion.qdd)
        W = W.reshape(-1, len(self.rigid))
        return {
            "cond": found.figures.condition,
            "rigid": figures(W.T @ W).condition,
            "scaled": found.figures.condition_scaled,
            "error": 1e3 * found.torque_error,
            "broken": broken(trajectory, self.limits),
            "length": trajectory.duration,
            "starts": starts,
        }


def broken(trajectory, limits, rate=1e4):
    """Count the broken limits of positions at 10 kHz and their differences.

    Differences are averages of the true rates over a step, so a motion inside its limits passes without any tolerance
    but rounding (a second difference of 3 rad at 10 kHz: 1e-7 of the limit).
    """
    t = np.arange(0.0, trajectory.duration, 1 / rate)
    q = trajectory.motion(t).q
    qd, qdd = np.diff(q, axis=0) * rate, np.diff(q, 2, axis=0) * rate**2
    over = [
        (q < limits.lower - 1e-9) | (q > limits.upper + 1e-9),
        np.abs(qd) > limits.velocity * (1 + 1e-6),
        np.abs(qdd) > limits.acceleration * (1 + 1e-6),
    ]
    return int(sum(part.any(axis=0).sum() for part in over))


def bench(name):
    """Prepare an arm."""
    base = with_plain_friction(name)
    robot, columns, names = base.robot, base.reduction.base, base.model.parameter_names
    rigid = np.array([k for k in columns if not names[k].startswith(("fv", "fc", "Im"))])
    narrow = bounds(robot, 0.05)
    limits = replace(bounds(robot), lower=narrow.lower, upper=narrow.upper)
    costs = {
        "I-optimal": (columns, Cost("i", V=held_out(base, limits, seed=0))),
        "D-optimal": (columns, Cost("d")),
        "cond": (columns, Cost("condition")),
        "cond, normalised": (columns, Cost("condition", normalised=True)),
        "cond, rigid columns": (rigid, Cost("condition")),
        "Eq. 14 along the path": (columns, Cost("paper")),
    }
    return Bench(base, rigid, limits, held_out(base, limits, seed=77, motions=6), costs)


class _Over(Exception):
    """The processor time is spent."""


class Best:
    """The best variables that were met until the processor time is spent."""

    def __init__(self, seconds):
        self.end, self.value, self.kept = time.process_time() + seconds, np.inf, None

    def note(self, value, x):
        """Keep what is better.

        Raises:
            _Over: the time is spent.
        """
        if value < self.value:
            self.value, self.kept = value, x.copy()
        if time.process_time() > self.end and self.kept is not None:
            raise _Over


def search_motions(b, basis, cost, seconds):
    """Search as ``dynid trajectory`` does, in one process, and judge the best."""
    columns, function = b.costs[cost]
    objective = ExcitationObjective(PlanProblem(b.base.model, columns, basis, b.limits, function))
    best, start = Best(seconds), 0
    try:
        while True:
            x = random_variables(basis, b.limits, np.random.default_rng((0, start)))
            descend(objective, x, lambda met: best.note(*met))
            start += 1
    except _Over:
        return b.row(Trajectory(basis, coefficients(basis, b.limits, best.kept)), start + 1)


def random_search(b, basis, costs, seconds):
    """Take the best of random motions for each cost, each motion scaled to its limits as in the search."""
    end, count = time.process_time() + seconds, 0
    t = DURATION * (np.arange(200) + 0.5) / 200
    shaping, observer, rng = (
        Shaping(basis, b.limits, t),
        b.base.observer,
        np.random.default_rng(0),
    )
    among = np.searchsorted(b.base.reduction.base, b.rigid)
    best = dict.fromkeys(costs, (np.inf, None))
    while time.process_time() < end:
        x, count = random_variables(basis, b.limits, rng), count + 1
        W = observer.dense(*shaping.motion(x)).reshape(-1, b.base.rank)
        G = W.T @ W
        for cost in costs:
            value = b.costs[cost][1].value(G[np.ix_(among, among)] if "rigid" in cost else G)[0]
            if value < best[cost][0]:
                best[cost] = (value, x)
    return {
        c: b.row(Trajectory(basis, coefficients(basis, b.limits, x)), count)
        for c, (_, x) in best.items()
    }


def papers_recipe(b, points, seconds):
    """Choose free measurement points for Eq. 14, then join them by quintics as the paper does."""
    from scipy.optimize import minimize

    best, count, n = Best(seconds), 0, b.base.robot.n
    regressor, cost, rng = (
        RegressorGradient(b.base.model, b.base.reduction.base, points),
        Cost("paper"),
        np.random.default_rng(0),
    )
    half, middle = (b.limits.upper - b.limits.lower) / 2, (b.limits.upper + b.limits.lower) / 2
    scale = (half, b.limits.velocity, b.limits.acceleration)

    def objective(x, power):
        u = np.tanh(x.reshape(3, points, n))
        W = regressor.dense(middle + half * u[0], scale[1] * u[1], scale[2] * u[2])
        rows = W.reshape(-1, b.base.rank)
        value, slope = cost.value(rows.T @ rows, power)
        best.note(value if np.isinf(power) else np.inf, x)
        g = regressor.gradient(2 * (rows @ slope).reshape(W.shape))
        pulled = np.stack([part * s for part, s in zip(g, scale, strict=True)])
        return value, (pulled * (1 - u**2)).ravel()

    try:
        while True:
            x, count = rng.standard_normal(3 * points * n), count + 1
            for power in (2.0, 8.0, np.inf):
                options = {"maxiter": 60}
                x = minimize(
                    objective, x, args=(power,), jac=True, method="L-BFGS-B", options=options
                ).x
    except _Over:
        pass
    u = np.tanh(best.kept.reshape(3, points, n))
    rates = [middle + half * u[0], scale[1] * u[1], scale[2] * u[2]]
    W = b.base.observer.dense(*rates).reshape(-1, b.base.rank)
    for rate in rates[1:]:
        rate[[0, -1]] = 0.0
    knots = np.linspace(0, 2.0 * (points - 1), points)
    basis = Quintic(tuple(knots.tolist()))
    phi = np.vstack([basis.matrix(knots, order) for order in range(3)])
    return (
        Trajectory(basis, np.linalg.lstsq(phi, np.vstack(rates), rcond=None)[0]),
        figures(W.T @ W).condition,
        count,
    )


def cell(answers, arm, part, label, make):
    """Return a cell, made now when it is not there yet."""
    name = f"{arm}; {part}; {label}"
    if name not in answers:
        answers.keep(name, make())
        print(name, *shown(answers[name]), flush=True)
    return answers[name]


def shown(f):
    """Return the figures of one row of the table."""
    figures_ = f"{f['cond']:.1f}", f"{f['rigid']:.1f}", f"{f['scaled']:.2f}", f"{f['error']:.1f}"
    return *figures_, f["broken"], f"{f['length']:.0f}", f["starts"]


def grid(b, answers, arm):
    """Fill the grid; return the best family of each cost by the figure it is after."""
    best = {}
    for cost in b.costs:
        found = {
            family: cell(
                *(answers, arm, "grid", f"{family}; {cost}"),
                partial(search_motions, b, basis, cost, SHORT),
            )
            for family, basis in FAMILIES.items()
        }
        best[cost] = min(found, key=lambda family: found[family][FIGURE[cost]])
    return best


def long(b, answers, arm, families):
    """Compare search, random search and the paper's recipe on the same budget."""
    seconds, there, add = LONG[arm], set(answers), partial(cell, answers, arm, "long")
    for cost in LONG_COSTS:
        family = families[cost]
        add(f"{family}; {cost}", partial(search_motions, b, FAMILIES[family], cost, seconds))
    family = families["cond"]
    label = f"random search, {family}; "
    if f"{arm}; long; {label}{LONG_COSTS[0]}" not in there:
        for cost, row in random_search(b, FAMILIES[family], LONG_COSTS, seconds).items():
            add(label + cost, lambda row=row: row)
    if not any("paper" in name and name.startswith(f"{arm}; long") for name in there):
        joined, at_them, count = papers_recipe(b, 24, seconds)
        label = f"the paper's recipe, 24 points (cond {at_them:.1f} at them), joined"
        add(label, lambda: b.row(joined, count))
        safe = through_waypoints(joined.motion(np.array(joined.basis.knots)).q, b.limits)
        label = "the same points of the paper's, intervals stretched to the limits"
        add(label, lambda: b.row(safe, count))


def table(answers):
    """Return the page."""
    made = f"Made by `python benchmarks/excitation.py`; {study.MACHINE}, NumPy {np.__version__}."
    text = ["# Exciting motions", "", made, "", *__doc__.splitlines()[4:]]
    parts = {
        "grid": "every family and cost, {:.0f} s of processor time each",
        "long": "search, random search and the paper's recipe, {:.0f} s of processor time each",
    }
    for (arm, title), (part, words) in itertools.product(ARMS.items(), parts.items()):
        head, seconds = f"{arm}; {part}; ", LONG[arm] if part == "long" else SHORT
        rows = [
            (name.removeprefix(head), *shown(row))
            for name, row in answers.items()
            if name.startswith(head)
        ]
        if rows:
            text += ["", f"## {title}: {words.format(seconds)}", "", study.markdown(HEADER, rows)]
    return "\n".join(text) + "\n"


def main():
    """Fill the store and write the table."""
    answers = study.Answers(STORE, fresh="--fresh" in sys.argv)
    for arm in ARMS:
        b = bench(arm)
        long(b, answers, arm, grid(b, answers, arm))
    TABLE.write_text(table(answers))


if __name__ == "__main__":
    main()
