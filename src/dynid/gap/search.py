"""The search: delays are taken out of the logs, and what is left is searched for names."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scipy.special import chdtrc

from dynid.gap.candidates import SelectionOptions
from dynid.gap.evidence import Rest
from dynid.gap.known_errors import KnownErrors
from dynid.gap.late_torques import late_torques
from dynid.gap.problem import GapProblem, KeptModel, make_problem
from dynid.gap.selected_effects import Key, SelectedEffect
from dynid.gap.selection import Search
from dynid.gap.strays import Stray, find_strays
from dynid.model.base_model import BaseModel
from dynid.options import LONGEST_DELAY
from dynid.signals.conditioned_log import ConditionedLog, segment_without_delay

#: Most selections: three for a delay, because each shift makes the next one exact to second order, one after what is
#: left of it, and one more.
MOST_SELECTIONS = 5


@dataclass(frozen=True)
class EffectSearch:
    """A finished search.

    Attributes:
        problem: what was searched, delays taken out.
        selected: effects that were found, a delay included.
        visibility: largest visible share of each candidate.
        errors: what recorder, filter and reversals do.
        rest: what is missing without a name.
        strays: short disturbances that do not repeat.
    """

    problem: GapProblem
    selected: list[SelectedEffect]
    visibility: dict[Key, float]
    errors: KnownErrors
    rest: Rest
    strays: tuple[Stray, ...] = ()


def search_effects(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    kept: KeptModel | None,
    options: SelectionOptions,
    *,
    first: GapProblem | None = None,
    earlier: Sequence[ConditionedLog] = (),
) -> EffectSearch:
    """Search logs for what the model lacks.

    Args:
        logs: conditioned logs, all with the same filter.
        base: model and base parameters.
        kept: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        first: the problem of these logs, when it is there already.
        earlier: conditioned logs that a kept model was identified from.
    """
    problem = first or make_problem(logs, base, kept, earlier)
    # Why not otherwise: a model that is fitted to late torques alone bends to them, and another delay does as well.
    wanted = not options.effects or "torque_delay" in options.effects
    shift = delay = late_torques(problem) if problem.since and wanted else 0.0
    late: SelectedEffect | None = None
    refined = False
    for k in range(MOST_SELECTIONS):
        if shift:
            shifted = [
                replace(s, segments=[segment_without_delay(x, delay) for x in s.segments])
                for s in logs
            ]
            problem = make_problem(shifted, base, kept, earlier)
        more = abs(delay) < LONGEST_DELAY and k < MOST_SELECTIONS - 1
        search = Search(problem, options, delay=more)
        state, delay_effect, first_of_all = search.run()
        # Why once more although it is no name any more: the rest is small beside the noise, not beside its own error.
        if delay_effect is None or refined or not (first_of_all or delay):
            break
        refined = not first_of_all
        late, shift = delay_effect, delay_effect.values["delay"]
        delay += shift
    selected = [] if first_of_all else search.with_numbers(state)
    if late is not None:
        # Why of the last one: the first one is that of a slope of torques which are in another place.
        error, share = late.std_errors["delay"], abs(delay / late.values["delay"])
        p_value, visible = float(chdtrc(1, (delay / error) ** 2)), share * late.visible
        values = {"delay": delay}
        selected.append(replace(late, values=values, visible=visible, p_value=p_value))
    evidence, strays = state.evidence, find_strays(state, problem.noise.unrepeatable)
    return EffectSearch(
        problem, selected, search.visibility, evidence.known_errors, evidence.rest(), tuple(strays)
    )
