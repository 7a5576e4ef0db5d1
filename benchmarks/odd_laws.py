"""Odd torques of drives, as those who build and repair robots would write them down, for ``gap_formulas.py``.

Each is a mechanism with numbers at random: hoses and cables, differentials, gears that run out of true, oil, magnets that
saturate, currents that heat, flywheels and belts, dead zones. Nothing of dynid is used, and nothing is asked of what its
search for formulas holds: which laws that could write at all is looked at after they are drawn.
"""

import numpy as np

#: How softly friction changes its sign [rad/s].
SHARP = 0.003


def sgn(v):
    """The sign of friction."""
    return np.tanh(v / SHARP)


def draw(rng, j):
    """Return a law (of t, q, qd, qdd and the rigid-body torques to a torque of joint j, (N,)) and how it reads."""
    k = j + int(rng.choice([-1, 1]))
    table = mechanisms(rng, j, k)
    text = str(rng.choice(sorted(table)))
    shape = table[text]

    def law(t, q, qd, qdd, rigid):
        return shape(
            t / 60,
            q[:, j],
            q[:, k],
            qd[:, j],
            qd[:, k],
            qdd[:, j],
            qdd[:, k],
            rigid[:, j],
            rigid[:, k],
        )

    return law, f"{text}, {k + 1} beside {j + 1}"


def mechanisms(rng, j, k):
    """Return laws of minutes, own and neighbour's place x y, speed v w, acceleration a b and load L K, with their texts."""
    x0, y0 = rng.uniform(-1.0, 1.0, 2)
    p, v0 = rng.uniform(0, 2 * np.pi), rng.uniform(0.15, 0.5)
    few, minutes, side = int(rng.integers(1, 4)), rng.uniform(0.4, 1.5), int(rng.choice([-1, 1]))
    share, fine = rng.uniform(0.2, 0.5), int(rng.integers(15, 40))

    limits = []

    def top(load):
        # Why the first: the drive's limit is the same in all logs.
        limits.append(share * np.abs(load).max())
        return limits[0]

    laws = {
        # hoses, cables and their guides
        "(y - y0)": lambda t, x, y, v, w, a, b, L, K: y - y0,
        "(x - x0) (y - y0)": lambda t, x, y, v, w, a, b, L, K: (x - x0) * (y - y0),
        "|y - y0| sgn v": lambda t, x, y, v, w, a, b, L, K: np.abs(y - y0) * sgn(v),
        "(y - y0) |v|": lambda t, x, y, v, w, a, b, L, K: (y - y0) * np.abs(v),
        "w^2 sin(x + p)": lambda t, x, y, v, w, a, b, L, K: w**2 * np.sin(x + p),
        "t cos(x + p)": lambda t, x, y, v, w, a, b, L, K: t * np.cos(x + p),
        "t sin y": lambda t, x, y, v, w, a, b, L, K: t * np.sin(y),
        # two drives in one housing
        "sgn(v + w)": lambda t, x, y, v, w, a, b, L, K: sgn(v + side * w),
        "(v + w) |v + w|": lambda t, x, y, v, w, a, b, L, K: (v + side * w) * np.abs(v + side * w),
        "cos(n (x + y) + p)": lambda t, x, y, v, w, a, b, L, K: np.cos(
            (few + 1) * (x + side * y) + p
        ),
        "|w| v": lambda t, x, y, v, w, a, b, L, K: np.abs(w) * v,
        "sgn v / (1 + |w| / v0)": lambda t, x, y, v, w, a, b, L, K: sgn(v) / (1 + np.abs(w) / v0),
        "cos(n y + p) sgn v": lambda t, x, y, v, w, a, b, L, K: np.cos(few * y + p) * sgn(v),
        # bearings and gears under load
        "|K| sgn v": lambda t, x, y, v, w, a, b, L, K: np.abs(K) * sgn(v),
        "|L| v": lambda t, x, y, v, w, a, b, L, K: np.abs(L) * v,
        "L^2 sgn v": lambda t, x, y, v, w, a, b, L, K: L**2 * sgn(v),
        "K v": lambda t, x, y, v, w, a, b, L, K: K * v,
        "|L| sgn v exp(-|v| / v0)": lambda t, x, y, v, w, a, b, L, K: (
            np.abs(L) * sgn(v) * np.exp(-np.abs(v) / v0)
        ),
        "cos(2 x + p) |v|": lambda t, x, y, v, w, a, b, L, K: np.cos(2 * x + p) * np.abs(v),
        "cos(2 x + p) L": lambda t, x, y, v, w, a, b, L, K: np.cos(2 * x + p) * L,
        "cos(n x + p) v": lambda t, x, y, v, w, a, b, L, K: np.cos(few * x + p) * v,
        "cos(x + p) v |v|": lambda t, x, y, v, w, a, b, L, K: np.cos(x + p) * v * np.abs(v),
        "cos(N x + p) v": lambda t, x, y, v, w, a, b, L, K: np.cos(fine * x + p) * v,
        "cos(2 x + p) L sgn v": lambda t, x, y, v, w, a, b, L, K: (
            np.cos(2 * x + p) * np.abs(L) * sgn(v)
        ),
        # motors and their amplifiers
        "L |L|": lambda t, x, y, v, w, a, b, L, K: L * np.abs(L),
        "L |v|": lambda t, x, y, v, w, a, b, L, K: L * np.abs(v),
        "L v^2": lambda t, x, y, v, w, a, b, L, K: L * v**2,
        "L t": lambda t, x, y, v, w, a, b, L, K: L * t,
        "L (1 - exp(-t / T))": lambda t, x, y, v, w, a, b, L, K: L * (1 - np.exp(-t / minutes)),
        "L beyond a dead zone": lambda t, x, y, v, w, a, b, L, K: L - np.clip(L, -top(L), top(L)),
        "L up to a limit, |v|": lambda t, x, y, v, w, a, b, L, K: (
            np.clip(L, -top(L), top(L)) * np.abs(v)
        ),
        "K |w|": lambda t, x, y, v, w, a, b, L, K: K * np.abs(w),
        # oil, flywheels and belts
        "v |v| exp(-t / T)": lambda t, x, y, v, w, a, b, L, K: v * np.abs(v) * np.exp(-t / minutes),
        "v t": lambda t, x, y, v, w, a, b, L, K: v * t,
        "v |v| t": lambda t, x, y, v, w, a, b, L, K: v * np.abs(v) * t,
        "v beyond a dead zone": lambda t, x, y, v, w, a, b, L, K: v - np.clip(v, -v0, v0),
        "v up to a limit": lambda t, x, y, v, w, a, b, L, K: np.clip(v, -v0, v0),
        "v w": lambda t, x, y, v, w, a, b, L, K: v * w,
        "v w sin(x + p)": lambda t, x, y, v, w, a, b, L, K: v * w * np.sin(x + p),
        "w^2 sgn v": lambda t, x, y, v, w, a, b, L, K: w**2 * sgn(v),
        "b": lambda t, x, y, v, w, a, b, L, K: b,
        "b cos(n y + p)": lambda t, x, y, v, w, a, b, L, K: b * np.cos((few + 1) * y + p),
        "b |v|": lambda t, x, y, v, w, a, b, L, K: b * np.abs(v),
        "a sgn v": lambda t, x, y, v, w, a, b, L, K: a * sgn(v),
    }
    return laws
