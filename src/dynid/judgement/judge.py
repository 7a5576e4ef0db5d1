"""The one function that makes statements: lights, first sentence, reasons, warnings and next steps from evidence."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any

from dynid.judgement.evidence import OPEN, Evidence, Light, worst
from dynid.judgement.rules import Step, answer, reasons, steps, warnings


@dataclass(frozen=True)
class Judgement:
    """What is said of a model.

    Attributes:
        sentence: the answer.
        reasons: why, in numbers beside what they are compared with.
        lights: how good each side of it is.
        warnings: what several facts together warn of.
        steps: what to do next, most urgent first.
    """

    sentence: str
    reasons: tuple[str, ...]
    lights: tuple[Light, ...]
    warnings: tuple[str, ...]
    steps: tuple[Step, ...]

    @property
    def sentences(self) -> tuple[str, ...]:
        """The answer, why, and what to beware of."""
        return (self.sentence, *self.reasons, *self.warnings)

    @property
    def state(self) -> str:
        """``"bad"`` or ``"fair"`` as the worst light, ``"good"`` when proved on unseen motion, else ``"open"``.

        Torques that are proved on unseen motion are no worse for masses that no arm has: that is fair.
        """
        states = {light.name: light.state for light in self.lights}
        if states["unseen motion"] == "good" and states["physics"] == "bad":
            states["physics"] = "fair"
        overall = worst(state for state in states.values() if state != OPEN)
        return OPEN if overall == "good" and states["unseen motion"] == OPEN else overall

    def light(self, name: str) -> Light:
        """Return the light of one side: ``fit``, ``unseen motion``, ``knowledge``, ``physics`` or ``complete``."""
        return next(light for light in self.lights if light.name == name)

    def facts(self) -> dict[str, Any]:
        """Return the judgement for JSON."""
        return {
            "state": self.state,
            "sentence": self.sentence,
            "reasons": list(self.reasons),
            "lights": [light.facts() for light in self.lights],
            "warnings": list(self.warnings),
            "next": [{"why": step.why, "command": step.command} for step in self.steps],
        }

    def __repr__(self) -> str:
        """Return the answer, why, and what to do next."""
        next_steps = (f"next: {step.command}\n      {step.why}" for step in self.steps[:2])
        return "\n".join([*self.sentences, *next_steps])


def judge(evidence: Evidence) -> Judgement:
    """Return what is said of a model.

    Args:
        evidence: what is known of it.
    """
    sentence = answer(evidence)
    return Judgement(
        sentence,
        tuple(reasons(evidence, sentence)),
        evidence.lights,
        tuple(warnings(evidence)),
        merged(steps(evidence)),
    )


def merged(every: Iterable[Step]) -> tuple[Step, ...]:
    """Return steps with each command once, without those for lights that earlier ones may turn green.

    What a first step may turn green needs no second one, which often only makes sense without the first.
    """
    kept: dict[str, Step] = {}
    covered: set[str] = set()
    for step in every:
        if not step.lights or not covered.issuperset(step.lights):
            covered.update(step.lights)
            first = kept.get(step.command, step)
            names = tuple(dict.fromkeys((*first.lights, *step.lights)))
            kept[step.command] = Step(first.why, step.command, names)
    return tuple(kept.values())
