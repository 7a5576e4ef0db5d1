"""One investigation from conditioned logs to a verdict: where, what, how sure, and how far the gap shrinks."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from dynid.errors import PackageMissing
from dynid.estimation.stack import Source
from dynid.gap.forward_simulation import forward
from dynid.gap.localisation import JointGap, where
from dynid.gap.problem import Known, Setting, make_setting
from dynid.gap.refit import Fitted, Shrink, fit_picks, shrink
from dynid.gap.search import Search, search, without
from dynid.gap.stepwise_selection import Options
from dynid.gap.verdict import NOT_SMALLER, Verdict, judge, refusal
from dynid.gap.whitened_regression import Board
from dynid.model.effects.interface import Floats
from dynid.model.store import BaseModel
from dynid.progress import SILENT, Progress

#: Visible share below which these logs cannot show an effect, so that its absence means nothing.
HIDDEN = 0.01


@dataclass(frozen=True)
class Investigation:
    """All that ``dynid gap`` says.

    Attributes:
        first: the setting before anything was found.
        found: the search.
        fitted: accepted effects with numbers, named or not.
        where: the disagreement of each joint before.
        proof: the held-out torque gap before and after.
        simulation: position error of the forward simulation before and after, (n,) each; None where it cannot be run.
        verdict: the verdict.
        unseen: effects and joints that these logs cannot show.
    """

    first: Setting
    found: Search
    fitted: tuple[Fitted, ...]
    where: tuple[JointGap, ...]
    proof: Shrink
    simulation: tuple[Floats, Floats] | None
    verdict: Verdict
    unseen: dict[str, list[int]]


def investigate(
    sources: Sequence[Source],
    base: BaseModel,
    known: Known | None,
    options: Options,
    progress: Progress = SILENT,
    *,
    simulate: bool = True,
    earlier: Sequence[Source] = (),
) -> Investigation:
    """Search conditioned logs for what a model lacks, and prove it on the rows that are held out.

    Args:
        sources: conditioned logs, all with the same filter.
        base: model and base parameters.
        known: the model that is kept, to find what has changed; None to find what no re-identification can absorb.
        options: what is searched.
        progress: told how far the work is.
        simulate: whether the forward simulation is run too.
        earlier: conditioned logs that a kept model was identified from, where they are at hand.
    """
    sources = on_one_clock(sources)
    earlier = on_one_clock(earlier) if earlier else ()
    first = make_setting(sources, base, known, earlier)
    found = search(sources, base, known, options, progress, first=first, earlier=earlier)
    found, fitted, withdrawn, proof, board = proved(first, found)
    verdict = judge(found, fitted, proof, base.robot.joint_names, withdrawn)
    regions = where(replace(first, noise=found.setting.noise).board())
    simulation = None
    if simulate:
        picks = [f.pick for f in fitted if f.pick.effect.name != "torque_delay"]
        try:
            before = forward(first, first.board(nuisance=False), [])
            after = forward(found.setting, board, picks) if fitted else before
        except PackageMissing:
            before = after = None
        simulation = (before.rms, after.rms) if before is not None and after is not None else None
    unseen: dict[str, list[int]] = {}
    for (name, place), share in found.visibility.items():
        if share < HIDDEN:
            unseen.setdefault(name, []).extend(place[:1])
    return Investigation(first, found, tuple(fitted), tuple(regions), proof, simulation, verdict, unseen)


def proved(first: Setting, found: Search) -> tuple[Search, list[Fitted], list[Fitted], Shrink, Board]:
    """Fit what was found and prove it on held-out rows, without what does not shrink the gap there.

    What fails is withdrawn and the rest proved again: a wrong effect spoils the prediction that others are judged by.

    Returns:
        Search, effects with numbers and withdrawn ones, the held-out gap, and the fitted board.
    """
    withdrawn: list[Fitted] = []
    while True:
        fitted, board = fit_picks(found)
        proof = shrink(first, found, fitted)
        failing = [f for f in fitted if refusal(found, fitted, f, proof) == NOT_SMALLER]
        if not failing or len(fitted) == 1:
            return found, fitted, withdrawn, proof, board
        worst = min(failing, key=lambda f: f.pick.net)
        withdrawn.append(worst)
        found = without(found, worst.pick)


def on_one_clock(sources: Sequence[Source]) -> list[Source]:
    """Let time run through several logs when their stamps do: what warms up or drifts does not start anew with each."""
    begin = [s.segments[0].t[0] - s.segments[0].elapsed[0] for s in sources]
    ends = [s.segments[-1].t[-1] for s in sources]
    if any(later < end for later, end in zip(begin[1:], ends[:-1], strict=True)):
        return list(sources)
    return [replace(s, segments=[replace(x, elapsed=x.t - begin[0]) for x in s.segments]) for s in sources]
