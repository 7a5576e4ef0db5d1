"""The search: delays are taken out of the logs, and what is left is searched for names."""

from __future__ import annotations

from collections.abc import Callable, Sequence, Set
from dataclasses import dataclass, replace
from functools import cache, cached_property

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.special import chdtrc

from dynid.arrays import Floats
from dynid.estimation.result import Identification
from dynid.gap.candidates import SelectionOptions
from dynid.gap.evidence import Rest
from dynid.gap.problem import GapProblem, make_problem
from dynid.gap.search import Search, State
from dynid.gap.selected_effects import Key, SelectedEffect
from dynid.gap.strays import find_strays
from dynid.judgement.gap import Event
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import DELAY
from dynid.options import LONGEST_DELAY
from dynid.signals.conditioned_log import ConditionedLog, torques_moved_back

#: Most shifts: three for a delay, because each makes the next one exact to second order, and one for what names leave.
MOST_SHIFTS = 4


@dataclass(frozen=True)
class EffectSearch:
    """A finished search.

    Attributes:
        logs: the conditioned logs.
        options: what was searched for.
        first: what was searched, before anything was found.
        problem: the same with delays taken out.
        selected: effects that were found, a delay included.
        visibility: largest visible share of each effect by the joint that it acts on.
        state: all names that were found, with what is beside them.
    """

    logs: tuple[ConditionedLog, ...]
    options: SelectionOptions
    first: GapProblem
    problem: GapProblem
    selected: list[SelectedEffect]
    visibility: dict[Key, float]
    state: State

    @cached_property
    def rest(self) -> Rest:
        """What is missing without a name."""
        return self.state.evidence.rest()

    @cached_property
    def events(self) -> tuple[Event, ...]:
        """Short disturbances that do not repeat, the loudest first."""
        return find_strays(self.state, self.problem.base.robot)

    def without(self, keys: Set[Key]) -> EffectSearch:
        """Return the search without some of its effects, the rest sized again: it holds what they explained."""
        state = self.state
        for k, one in enumerate(state.named):
            if one.place.key in keys and not one.place.always:
                state = replace(state, evidence=state.evidence.without(state.columns(k)))
        sized = state.evidence.sized()
        selected = [one for one in self.selected if one.key not in keys]
        return replace(self, selected=selected, state=replace(state, evidence=sized))


def searches(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: Identification | None,
    earlier: Sequence[ConditionedLog] = (),
) -> Callable[[float], Search]:
    """Return what searches logs with torques moved back by a delay [s], each delay once.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        earlier: conditioned logs that a kept model was identified from.
    """

    @cache
    def at(delay: float) -> Search:
        shifted = [replace(torques_moved_back(s, base.model, delay), delay=s.delay) for s in logs]
        return Search(make_problem(shifted, base, kept, earlier))

    return at


def search_effects(
    logs: Sequence[ConditionedLog], at: Callable[[float], Search], options: SelectionOptions
) -> EffectSearch:
    """Search logs for what the model lacks.

    Args:
        logs: the logs.
        at: returns their search with torques moved back by a delay [s] (``searches``).
        options: what is searched.
    """
    first = at(0.0).problem
    wanted = DELAY in (options.effects or (DELAY,)) and (DELAY, ()) not in options.barred
    # Why not otherwise: a model that is fitted to late torques alone bends to them, and another delay does as well.
    delay = late_torques(first) if first.since and wanted else 0.0
    late: SelectedEffect | None = None
    # Why first: a delay is in all joints, and everything else is searched once, on torques in their place.
    asked = replace(options, effects=(DELAY,)) if wanted else options
    shifts, total = 0, delay
    while True:
        search = at(delay)
        more = wanted and abs(delay) < LONGEST_DELAY and shifts < MOST_SHIFTS
        state, rest, is_name = search.run(asked, delay=more)
        if rest is not None and (is_name or delay):
            late, total = rest, delay + rest.values["delay"]
        if is_name:
            delay, shifts = total, shifts + 1
        elif asked is options:
            break
        else:
            asked = options
    selected = search.with_numbers(state)
    if late is not None:
        # Why of the last one: the first one is that of a slope of torques which are in another place.
        error, share = late.std_errors["delay"], abs(total / late.values["delay"])
        p_value, visible = float(chdtrc(1, (total / error) ** 2)), share * late.visible
        values = {"delay": total}
        selected.append(replace(late, values=values, visible=visible, p_value=p_value))
    return EffectSearch(
        logs=tuple(logs),
        options=options,
        first=first,
        problem=search.problem,
        selected=selected,
        visibility=search.visibility,
        state=state,
    )


# ---------------------------------------------------------------- tenths of a second
# The slope of the torque of a model stands for a short delay alone, and a model fitted to late torques has another
# slope. Torques that are moved back know of neither.
#: Delays that are tried [s]: closer than half a period of what moves an arm, and further than the slope reaches.
TRIED = np.linspace(-LONGEST_DELAY, LONGEST_DELAY, 21)
#: Drop of twice the log likelihood from which a delay begins the search, and by which no joint may be worse with it:
#: all torques are late, or it is something else.
SURE = 24.0


def late_torques(problem: GapProblem) -> float:
    """Return the delay of all new torques that explains most [s]; 0 where none is sure.

    Args:
        problem: what is searched.
    """
    rows, moved = problem.every, np.zeros((*problem.every.tau.T.shape, len(TRIED)))
    inside = ~rows.is_new
    for part, new in zip(rows.parts, rows.new, strict=True):
        t = rows.t[part]
        inside[part] |= (t >= t[0] + LONGEST_DELAY) & (t <= t[-1] - LONGEST_DELAY)
        wanted = np.clip(t[:, None] + TRIED * new, t[0], t[-1])
        moved[:, part] = CubicSpline(t, rows.tau[part], axis=0)(wanted).transpose(2, 0, 1)
    bare = replace(problem, rows=rows.only(inside)).regression()
    late = [bare.noise.whiten(bare.rows, j, x.T) for j, x in enumerate(moved)]
    pairs = list(zip(bare.X, late, strict=True))
    theta = bare.root @ (bare.root.T @ (bare.known[:-1, -1:] + sum(X.T @ y.T for X, y in pairs)))
    left = np.array([np.sum((y.T - X @ theta) ** 2, axis=0) for X, y in pairs])
    total = left.sum(axis=0)
    best, still = int(np.argmin(total)), len(TRIED) // 2
    # Why over what is left: a model that lacks something leaves more than noise, whatever the delay.
    noise = max(float(total[best]) / max(sum(y.shape[1] for y in late), 1), 1.0)
    gain: Floats = (left[:, still] - left[:, best]) / noise
    if gain.sum() < SURE or gain.min() < -SURE / 2:
        return 0.0
    near = slice(max(best - 1, 0), best + 2)
    bend, slope, _ = np.polyfit(TRIED[near] - TRIED[best], total[near], 2)
    step = -slope / (2 * bend) if bend > 0 else 0.0
    return float(np.clip(TRIED[best] + step, -LONGEST_DELAY, LONGEST_DELAY))
