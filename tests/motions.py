"""Motions with their exact derivatives: q, qd and qdd, (N, n) each."""

import numpy as np

from dynid import Motion


def tones(t, size, w, phase=0.0):
    """Return sums of size sin(w t + phase); each is (k, n) or broadcasts to it."""
    angle = w * np.asarray(t)[:, None, None] + phase
    sin, cos = np.sin(angle), np.cos(angle)
    return tuple(
        (shape * wave).sum(1) for shape, wave in ((size, sin), (size * w, cos), (-size * w**2, sin))
    )


def harmonics(t, a, b, base=0.1):
    """Return sums of a sin(k w t) + b cos(k w t), w that of ``base`` [Hz]; ``a`` and ``b`` are (orders, n)."""
    w = 2 * np.pi * base * np.arange(1, len(a) + 1)
    sin, cos = np.sin(np.outer(t, w)), np.cos(np.outer(t, w))
    return sin @ a + cos @ b, (cos * w) @ a - (sin * w) @ b, -(sin * w**2) @ a - (cos * w**2) @ b


def inside(q, qd, qdd, *limits):
    """Return a motion about its middle, each joint scaled to the tightest of its limits: reach, speed, acceleration."""
    q = q - (q.max(axis=0) + q.min(axis=0)) / 2
    ratios = [limit / np.abs(x).max(axis=0) for limit, x in zip(limits, (q, qd, qdd), strict=False)]
    scale = np.min(ratios, axis=0)
    return scale * q, scale * qd, scale * qdd


def there_and_back(t, far, middle=0.0):
    """Return the motion from rest to rest that is ``far`` from the middle pose, (n,), half way."""
    w = np.pi / t[-1]
    s, c = np.sin(w * t), np.cos(w * t)
    shapes = s**4, 4 * w * s**3 * c, 4 * w**2 * (3 * s**2 * c**2 - s**4)
    q, qd, qdd = (np.outer(shape, far) for shape in shapes)
    return Motion(t, middle + q, qd, qdd)


def standing(q):
    """Return a second of rest at a pose, (n,)."""
    still = np.zeros((2, len(q)))
    return Motion(np.array([0.0, 1.0]), still + q, still, still)


def pose_to_pose(goals, rate=100.0):
    """Return t, q, qd, qdd through poses (k, n): a second on the way to the next one, and a second of rest in it."""
    t = np.arange(0, 2.0 * (len(goals) - 1), 1 / rate)
    part, way = np.divmod(t, 2.0)
    here, x = goals[part.astype(int)], np.clip(way, 0, 1)[:, None]
    step = goals[part.astype(int) + 1] - here
    q = here + step * (10 * x**3 - 15 * x**4 + 6 * x**5)
    qd = step * (30 * x**2 - 60 * x**3 + 30 * x**4)
    return t, q, qd, step * (60 * x - 180 * x**2 + 120 * x**3)
