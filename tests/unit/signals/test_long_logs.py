"""A log gives the same whether it is worked on whole or piece by piece, in memory or in a file."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from dynid import scratch
from dynid.errors import DynidError
from dynid.log import Log
from dynid.model import build_model
from dynid.signals.checks import prepare
from dynid.signals.conditioned_log import condition_log
from dynid.signals.describe import describe
from dynid.signals.motion import check_amount
from makelogs import gen2, gen2_log, lwr, lwr_log


def spoilt(log: Log, kind: str) -> Log:
    """A log with one fault that is found, or mended, from all of its samples."""
    random = np.random.default_rng(5)
    q, tau, t = log.q.copy(), log.tau.copy(), log.t.copy()
    if kind == "spikes":
        tau[random.integers(0, len(t), 20), 2] += 80.0
    elif kind == "clipped":
        tau[:, 1] = np.clip(tau[:, 1], -np.inf, np.percentile(tau[:, 1], 97))
    elif kind == "turns":
        q[1300:, 0] += 2 * np.pi
        q[2900:, 0] -= 2 * np.pi
    elif kind == "held":
        q[1::2], tau[1::2] = q[:-1:2], tau[:-1:2]
    elif kind == "stray":
        t = t + 1e-3 * random.random(len(t))
    elif kind == "twice":
        t[2000] = t[1999]
    elif kind == "degrees":
        q = np.degrees(q)
    elif kind == "pause":
        t[1700:] += 2.0
    return replace(log, t=t, q=q, tau=tau)


def answer(log, robot, model):
    """Everything that is made of a log before its rows are evaluated."""
    try:
        checked = prepare(log, robot, identify=False)
        check_amount([checked], robot)
        segments = condition_log(checked, model, delay=0.003).segments
        summary = describe(checked, robot)
    except DynidError as error:
        return [str(error)], [], None
    arrays = [value for segment in segments for value in vars(segment).values()]
    return (
        [f"{each.code} {each.text}" for each in checked.findings],
        [checked.t, checked.q, checked.tau, checked.extra["clipped"], *arrays],
        summary,
    )


@pytest.fixture(scope="module")
def models():
    return {robot.name: build_model(robot) for robot in (lwr(), gen2())}


@pytest.mark.parametrize(("robot", "log"), [(lwr, lwr_log), (gen2, gen2_log)], ids=["lwr", "gen2"])
@pytest.mark.parametrize(
    "kind",
    ["", "spikes", "clipped", "turns", "held", "stray", "twice", "degrees", "pause"],
    ids=lambda kind: kind or "as it is",
)
def test_a_log_in_parts_gives_what_the_whole_one_gives(monkeypatch, models, robot, log, kind):
    model, given = models[robot().name], spoilt(log(), kind)
    findings, arrays, summary = answer(given, robot(), model)
    monkeypatch.setattr(scratch, "PIECE", 700)
    monkeypatch.setattr(scratch, "IN_MEMORY", 1000)
    again, pieced, said = answer(given, robot(), model)
    assert again == findings
    assert len(pieced) == len(arrays)
    for one, other in zip(pieced, arrays, strict=True):
        np.testing.assert_allclose(
            one, other, rtol=1e-9, atol=1e-12 * max(1.0, np.abs(other).max(initial=0.0))
        )
    for key, value in (vars(summary) if summary else {}).items():
        number = isinstance(value, float) or (
            isinstance(value, tuple) and all(isinstance(v, float) for v in value)
        )
        assert getattr(said, key) == (pytest.approx(value, rel=1e-9) if number else value)
