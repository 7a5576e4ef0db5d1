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
    """Print the answer, why, the lights, and what is behind those that are not green; with -v behind all."""
    terminal = common.terminal
    show_answer(common, judged)
    for light in judged.lights:
        if light.state not in ("good", "open") or (common.verbose and light.state == "good"):
            terminal.fact(light.shown, ": ".join(filter(None, (light.title, light.text))))
    for state, word in (("good", "good"), ("open", "untested")):
        found = [light.title for light in judged.lights if light.state == state]
        if found and not (common.verbose and state == "good"):
            terminal.fact(word, ", ".join(found))
    terminal.answer()


def show_next(common: Common, judged: Judgement) -> None:
    """Say the most urgent things to do, each with its reason."""
    for step in judged.steps if common.verbose else judged.steps[:SHOWN]:
        common.terminal.next(step.command, step.why)
