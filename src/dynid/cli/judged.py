"""How every command says what it found: the answer, why, and what to do next."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from dynid.cli.options import Common
    from dynid.judgement.judge import Judgement

#: Steps that are shown without -v.
SHOWN = 2


def show_answer(common: Common, judged: Judgement) -> None:
    """Print the answer, why, and what to beware of."""
    common.terminal.answer(judged.sentence, style="bold", indent=2)
    for text in (*judged.reasons, *judged.warnings):
        common.terminal.sentence(text)
    common.terminal.answer()


def show_judgement(common: Common, judged: Judgement) -> None:
    """Print the answer, why, the lights, and what is behind those that are not green."""
    terminal = common.terminal
    show_answer(common, judged)
    for light in judged.lights:
        if light.state != "open":
            terminal.fact(light.shown, f"{light.title}: {light.text}")
    untested = [light.title for light in judged.lights if light.state == "open"]
    if untested:
        terminal.fact("not tested", ", ".join(untested))
    terminal.answer()


def show_next(common: Common, judged: Judgement) -> None:
    """Say the most urgent things to do, each with its reason."""
    for step in judged.steps if common.verbose else judged.steps[:SHOWN]:
        common.terminal.next(step.command, step.why)
