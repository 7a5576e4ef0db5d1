"""The self-test: hide one thing after the other, and nothing, in simulated logs, and count what is named."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from dynid.estimation.conditioned_log import ConditionedLog, condition_logs
from dynid.gap.analysis import CUTOFF, analyse_gap
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.model.reduce import reduce
from dynid.model.regressor import Model
from dynid.sim.hidden import CASES, OUTSIDE, Hidden, hidden_logs
from dynid.sim.plant import Plant


@dataclass(frozen=True)
class SelfTestCase:
    """One case and what was said.

    Attributes:
        hidden: what was hidden.
        verdict: the verdict.
        named: identifiers and 0-based joints that were named.
        right: whether that is right.
    """

    hidden: Hidden
    verdict: str
    named: tuple[tuple[str, tuple[int, ...]], ...]
    right: bool


def self_test(model: Model, plant: Plant, seed: int, cases: tuple[Hidden, ...] = CASES) -> Iterator[SelfTestCase]:
    """Yield one case after the other.

    Args:
        model: the arm's model.
        plant: its truth.
        seed: of motions and noise.
        cases: what is hidden.
    """
    base = BaseModel(model, reduce(model))
    for k, hidden in enumerate(cases):
        logs = hidden_logs(model.robot, plant, hidden, np.random.default_rng([seed, k]))
        seen = analyse_gap(sources_of(logs, model), base, None, SelectionOptions(), simulate=False)
        named = tuple((f.name, f.joints) for f in seen.verdict.named)
        yield SelfTestCase(hidden, seen.verdict.word, named, right(hidden, seen.verdict.word, named))


def sources_of(logs: list[Log], model: Model) -> list[ConditionedLog]:
    """Condition logs in memory, whose columns are DH quantities already."""
    return condition_logs(logs, model, cutoff=CUTOFF)


def right(hidden: Hidden, verdict: str, named: tuple[tuple[str, tuple[int, ...]], ...]) -> bool:
    """Return whether a verdict is right."""
    if hidden.name == "nothing":
        return verdict == "nothing_missing"
    if hidden.name in OUTSIDE:
        return verdict == "unexplained" and not named
    return len(named) == 1 and named[0][0] == hidden.name and named[0][1][:1] in ((), (hidden.joint,))
