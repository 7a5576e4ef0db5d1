"""Why something that the evidence found is not called by its name: one ordered table.

Probability is no gate of its own kind: what is below it is told as likely, with its size.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from dynid.gap import tuning
from dynid.gap.refit import HeldOutImprovement, possible
from dynid.gap.search import EffectSearch
from dynid.gap.selected_effects import SelectedEffect
from dynid.gap.verdict import LIKELY, SAMPLING, SMALL_DELAY


@dataclass(frozen=True)
class Case:
    """One effect beside all others.

    Attributes:
        search: the search.
        effects: all effects with numbers.
        one: the one that is judged.
        improvement: the held-out gap before and after.
        rms: held-out error of all joints together with all effects and without this one, in units of the noise.
    """

    search: EffectSearch
    effects: list[SelectedEffect]
    one: SelectedEffect
    improvement: HeldOutImprovement
    rms: tuple[float, float]


@dataclass(frozen=True)
class Refusal:
    """One reason.

    Attributes:
        value: what is compared.
        limit: with what; the effect is refused on the wrong side of it.
        least: whether the limit is the least that is enough, and not the most that is allowed.
        sentence: what is said, with the value and limit in it.
        evidence: what the limit rests on.
    """

    value: Callable[[Case], float]
    limit: float
    least: bool
    sentence: str
    evidence: str

    def of(self, case: Case) -> str:
        """Return the sentence where an effect is refused, or nothing."""
        value = self.value(case)
        refused = value < self.limit if self.least else value > self.limit
        return (
            self.sentence.format(value=value, limit=self.limit, percent=np.floor(100 * value))
            if refused
            else ""
        )


def _periods(case: Case) -> float:
    late = case.one.name == "torque_delay"
    return (
        abs(case.search.delay) * case.search.problem.segments[0].log.filter.rate if late else np.inf
    )


def _stray(case: Case) -> float:
    own = (
        case.one.test.joint in case.search.problem.noise.unrepeatable
        and case.one.name != "torque_delay"
    )
    return case.one.test.visible_rms if own else np.inf


def _against_rest(case: Case) -> float:
    odds = case.one.score / 2.0
    return (
        float(1.0 / (1.0 + np.exp(-min(odds, 500.0)))) if case.one.name != "torque_delay" else 1.0
    )


def _left(case: Case) -> float:
    """Return how large what is left of the effect's joint is, over the effect: what no kind of the rest holds, too."""
    rest, noise, j = case.search.rest, case.search.problem.noise, case.one.test.joint
    assert rest is not None
    louder = np.exp(-rest.level[j]) - (tuning.LOUDER if noise.repeats else tuning.LOUDER_UNSURE)
    left = float(np.hypot(rest.rms[j].get("all", 0.0), np.sqrt(max(louder, 0.0))))
    return left / max(case.one.test.visible_rms, 1e-12) if case.one.name != "torque_delay" else 0.0


#: In this order; the first that holds is said.
TABLE = (
    Refusal(
        _periods,
        SAMPLING,
        True,
        SMALL_DELAY,
        "recorders of five public arms skew by up to 0.3 periods",
    ),
    Refusal(
        _against_rest,
        tuning.SURE,
        True,
        LIKELY + " {percent:.0f} %, and 99 % are needed",
        "of names given with 90 to 99 % as many are right",
    ),
    Refusal(
        lambda case: case.one.test.visible_rms,
        tuning.MATERIAL,
        True,
        "its torque is only {value:.2g} times the noise, limit {limit:g}",
        "evidence grows with the length of a log: 7 of 56 cases had a name at 0.06 to 0.2 of the noise",
    ),
    Refusal(
        _stray,
        1.0,
        True,
        "the disturbance of this joint does not repeat",
        "contacts and drifting sensors",
    ),
    Refusal(
        _left,
        1.0,
        False,
        "what is left of this joint is {value:.1f} times as large: it may stand in for something else",
        "a dead band is half a gain: 0.75 of the noise left beside 0.4; a spring beside |qd2| qd1",
    ),
    Refusal(
        lambda case: float(possible(case.one)),
        0.5,
        True,
        "no physical body has these parameters",
        "a law",
    ),
    Refusal(
        lambda case: case.rms[0] / max(case.rms[1], 1e-12),
        1.0,
        False,
        "it does not reduce the error on unseen data ({value:.3f} times as large with it)",
        "all joints together, in units of their noise: parameters of all joints move with an effect",
    ),
)


def refusal(case: Case) -> str:
    """Return why an effect is not called by its name, or nothing."""
    return next((text for row in TABLE if (text := row.of(case))), "")
