"""The one function that makes statements: lights, first sentence, reasons, warnings and next steps from evidence."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from dynid.judgement.evidence import Evidence
from dynid.judgement.lights import OPEN, Light, lights, worst
from dynid.judgement.sentences import first_sentence, reasons, warnings
from dynid.judgement.steps import Step, next_steps


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
    def state(self) -> str:
        """``"bad"`` or ``"fair"`` as the worst light, ``"good"`` when proved on unseen motion, else ``"open"``.

        Torques that are proved on unseen motion are no worse for masses that no arm has: that is fair.
        """
        states = {light.name: light.state for light in self.lights}
        if states["unseen motion"] == "good" and states["physics"] == "bad":
            states["physics"] = "fair"
        found = worst(state for state in states.values() if state != OPEN)
        return OPEN if found == "good" and states["unseen motion"] == OPEN else found

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
        steps = [
            line
            for step in self.steps[:2]
            for line in (f"next: {step.command}", f"      {step.why}")
        ]
        return "\n".join([self.sentence, *self.reasons, *self.warnings, *steps])


def judge(evidence: Evidence) -> Judgement:
    """Return what is said of a model.

    Args:
        evidence: what is known of it.
    """
    found = lights(evidence)
    sentence = first_sentence(evidence, found)
    return Judgement(
        sentence,
        reasons(evidence, sentence),
        found,
        warnings(evidence, found),
        next_steps(evidence, found),
    )
