"""Exciting motions in one table: every family and every cost, random search and the paper's recipe on the same budget.

Run: python benchmarks/excitation.py [kuka_lwr4plus|kinova_gen2] [seconds]. 10 s from rest to rest inside 95 % of the
position range and the whole of the speed and acceleration limits; no floor, so that figures compare with others.
Columns: viscous and Coulomb friction, no offset: 62 base columns (48 of the links and rotors, 14 of friction); "43" are
the rigid ones. Torque error: expected rms on 6 other motions after 1,000 samples with 0.1 N m of white noise.
"""

import sys
import time
from dataclasses import dataclass, replace

import numpy as np

from dynid.files.robotfile import load_robot
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model
from dynid.trajectory.basis import Fourier, Quintic
from dynid.trajectory.cost import Cost, figures
from dynid.trajectory.feasible import Bounds, Shaping, bounds
from dynid.trajectory.limits import check
from dynid.trajectory.objective import Problem
from dynid.trajectory.optimise import Search, optimise
from dynid.trajectory.plan import Trajectory, through
from dynid.trajectory.predict import held_out, predict

DURATION = 10.0
NOISE = 0.1
FAMILIES = {
    "quintic, 6 waypoints": Quintic.even(DURATION, 5),
    "quintic, 11 waypoints": Quintic.even(DURATION, 10),
    "spline, 14 control points": Quintic.even(DURATION, 9, smooth=True),
    "Fourier, 5 harmonics": Fourier(DURATION, 5),
    "Fourier, 8 harmonics": Fourier(DURATION, 8),
}


@dataclass(frozen=True)
class Bench:
    """One arm with its columns and the motions it is judged on."""

    name: str
    model: object
    base: np.ndarray
    rigid: np.ndarray
    limits: Bounds
    other: np.ndarray
    seconds: float

    def row(self, label: str, trajectory: Trajectory, spent: float) -> str:
        """Return one line of the table, judged on 1,000 samples."""
        motion = trajectory.motion(np.linspace(0, trajectory.duration, 1000))
        found = predict(self.model, self.base, motion, np.full(self.model.robot.n, NOISE), self.other)
        W = self.model.observer(self.rigid).dense(motion.q, motion.qd, motion.qdd).reshape(-1, len(self.rigid))
        rigid = figures(W.T @ W).condition
        broken = len(check(trajectory, self.model.robot, self.limits).violations)
        f = found.figures
        error = 1e3 * found.torque_error
        cells = (f"{f.condition:8.1f}", f"{rigid:8.1f}", f"{f.condition_scaled:8.2f}", f"{error:8.1f}")
        return f"| {label:<52} | {' | '.join(cells)} | {broken:3d} | {trajectory.duration:5.0f} | {spent:4.0f} |"


def bench(name: str, seconds: float) -> Bench:
    """Prepare an arm."""
    robot = load_robot(name)
    robot = replace(robot, joints=tuple(replace(j, friction=("viscous", "coulomb")) for j in robot.joints))
    model = build_model(robot)
    base = reduce(model).base
    names = model.parameter_names
    rigid = np.array([k for k in base if not names[k].startswith(("fv", "fc", "Im"))])
    limits = bounds(robot, 0.05, 0.0)
    return Bench(name, model, base, rigid, limits, held_out(model, base, limits, seed=77, motions=6), seconds)


def searched(b: Bench, basis: object, columns: np.ndarray, cost: Cost) -> tuple[Trajectory, float]:
    """Search for a motion."""
    begin = time.perf_counter()
    found = optimise(Problem(b.model, columns, basis, b.limits, cost), Search(10_000, b.seconds, seed=0))
    return Trajectory(basis, found[0].coefficients), time.perf_counter() - begin


def random_search(b: Bench, basis: object, cost: Cost) -> tuple[Trajectory, float]:
    """Take the best of random motions, each scaled to its limits in the same way."""
    begin = time.perf_counter()
    t = DURATION * (np.arange(200) + 0.5) / 200
    shaping, observer, rng = Shaping(basis, b.limits, t), b.model.observer(b.base), np.random.default_rng(0)
    best, kept = np.inf, None
    while time.perf_counter() - begin < b.seconds:
        x = shaping.random(rng)
        W = observer.dense(*shaping.motion(x)).reshape(-1, len(b.base))
        value = cost.value(W.T @ W)[0]
        if value < best:
            best, kept = value, x
    return Trajectory(basis, shaping.coefficients(kept)), time.perf_counter() - begin


def papers_recipe(b: Bench, points: int) -> tuple[Trajectory, float, float]:
    """Choose free measurement points for Eq. 14, then join them by quintics and stretch the intervals to the limits."""
    from scipy.optimize import minimize

    from dynid.model.adjoint import Adjoint

    begin = time.perf_counter()
    n = b.model.robot.n
    adjoint, cost, rng = Adjoint(b.model, b.base, points), Cost("paper"), np.random.default_rng(0)
    half, middle = (b.limits.upper - b.limits.lower) / 2, (b.limits.upper + b.limits.lower) / 2
    scale = (half, b.limits.velocity, b.limits.acceleration)

    def objective(x: np.ndarray, power: float = np.inf) -> tuple[float, np.ndarray]:
        u = np.tanh(x.reshape(3, points, n))
        W = adjoint.dense(middle + half * u[0], scale[1] * u[1], scale[2] * u[2])
        rows = W.reshape(-1, len(b.base))
        value, slope = cost.value(rows.T @ rows, power)
        g = adjoint.pull(2 * (rows @ slope).reshape(W.shape))
        pulled = np.stack([part * s for part, s in zip((g.q, g.qd, g.qdd), scale, strict=True)])
        return value, (pulled * (1 - u**2)).ravel()

    best, kept = np.inf, None
    while time.perf_counter() - begin < b.seconds:
        x = rng.standard_normal(3 * points * n)
        for power in (2.0, 8.0, np.inf):
            x = minimize(lambda x, p=power: objective(x, p), x, jac=True, method="L-BFGS-B", options={"maxiter": 60}).x
        value = objective(x)[0]
        if value < best:
            best, kept = value, x
    u = np.tanh(kept.reshape(3, points, n))
    W = b.model.observer(b.base).dense(middle + half * u[0], scale[1] * u[1], scale[2] * u[2]).reshape(-1, len(b.base))
    knots = np.linspace(0, 2.0 * (points - 1), points)
    basis = Quintic(tuple(knots.tolist()))
    phi = np.vstack([basis.matrix(knots, order) for order in range(3)])
    rates = [middle + half * u[0], scale[1] * u[1], scale[2] * u[2]]
    for rate in rates[1:]:
        rate[[0, -1]] = 0.0
    joined = Trajectory(basis, np.linalg.lstsq(phi, np.vstack(rates), rcond=None)[0])
    return joined, figures(W.T @ W).condition, time.perf_counter() - begin


def main() -> None:
    """Print the table."""
    name = sys.argv[1] if len(sys.argv) > 1 else "kuka_lwr4plus"
    seconds = float(sys.argv[2]) if len(sys.argv) > 2 else 60.0
    b = bench(name, seconds)
    V = held_out(b.model, b.base, b.limits, seed=0)
    costs = {
        "I-optimal": (b.base, Cost("i", V=V)),
        "D-optimal": (b.base, Cost("d")),
        "condition number": (b.base, Cost("condition")),
        "condition, columns normalised": (b.base, Cost("condition", normalised=True)),
        "condition of the rigid columns": (b.rigid, Cost("condition")),
        "Eq. 14 along the path": (b.base, Cost("paper")),
    }
    print(f"{name}, {seconds:.0f} s for each row, {len(b.base)} columns, {len(b.rigid)} rigid", flush=True)
    print("| motion | cond 62 | cond 43 | scaled 62 | error mN m | limits broken | s | search s |", flush=True)
    print("|---|---|---|---|---|---|---|---|", flush=True)
    for cost_name, (columns, cost) in costs.items():
        for family, basis in FAMILIES.items():
            print(b.row(f"{family}; {cost_name}", *searched(b, basis, columns, cost)), flush=True)
    for cost_name in ("I-optimal", "condition number"):
        found, spent = random_search(b, FAMILIES["quintic, 6 waypoints"], costs[cost_name][1])
        print(b.row(f"random search, quintic, 6 waypoints; {cost_name}", found, spent), flush=True)
    for points in (16, 24, 40):
        joined, at_points, spent = papers_recipe(b, points)
        print(b.row(f"paper's recipe, {points} points, cond {at_points:.1f} there", joined, spent), flush=True)
        safe = through(joined.motion(np.array(joined.basis.knots)).q, b.limits)
        print(b.row("  the same points at stretched intervals, least jerk", safe, spent), flush=True)


if __name__ == "__main__":
    main()
