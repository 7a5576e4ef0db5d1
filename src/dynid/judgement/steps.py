"""What to do next: every light that is not green has a step, with a command that works when pasted."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import PurePath

from dynid.judgement.evidence import Evidence
from dynid.judgement.lights import Light, unsearched
from dynid.text import shell


@dataclass(frozen=True)
class Step:
    """One thing to do.

    Attributes:
        why: the reason, one sentence.
        command: the command line; LOG stands for a recording that only the user can name.
        lights: names of the lights that it may turn green.
    """

    why: str
    command: str
    lights: tuple[str, ...] = ()


def next_steps(evidence: Evidence, lights: Sequence[Light]) -> tuple[Step, ...]:
    """Return what to do next, most urgent first, each command once."""
    states = {light.name: light.state for light in lights}
    found = [
        *_change(evidence),
        *_robot(evidence, states),
        *_gap(evidence, states),
        *_physics(evidence, states),
    ]
    found += [
        *_unseen(evidence, states),
        *_motion(evidence, states),
        *_search(evidence, states),
        *_use(evidence, states),
    ]
    merged: dict[str, Step] = {}
    covered: set[str] = set()
    for step in found:
        # Why: what a first step may turn green needs no second one, which often only makes sense without the first.
        if step.lights and covered.issuperset(step.lights):
            continue
        covered.update(step.lights)
        earlier = merged.get(step.command, step)
        merged[step.command] = Step(
            earlier.why, step.command, tuple(dict.fromkeys((*earlier.lights, *step.lights)))
        )
    return tuple(merged.values())


def run_of(evidence: Evidence) -> str:
    """Return the word for the result in a command."""
    return folder_of(evidence.result) or "RESULT"


def folder_of(result: str) -> str:
    """Return the word for a result in a command: its folder, or its file where that has another name."""
    path = PurePath(result)
    return str(path.parent) if path.name == "parameters.npz" else result


def _change(evidence: Evidence) -> list[Step]:
    if evidence.asked != "change" or not evidence.changes or not evidence.earlier_result:
        return []
    why = "Ask what has changed, such as a load, friction or a sensor."
    logs = evidence.logs or ("LOG",)
    return [
        Step(
            why, f"{shell('dynid', 'gap', folder_of(evidence.earlier_result), *logs)} --ask changed"
        )
    ]


def _logs(evidence: Evidence) -> tuple[str, ...]:
    """Return the logs to search: replays that went wrong, else those of the search before, else the fitted ones."""
    odd = tuple(each.log for each in unsearched(evidence))
    if not odd and evidence.gap is not None and evidence.gap.logs:
        return evidence.gap.logs
    return odd or evidence.logs or ("LOG",)


def _robot(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    log, everything = next(iter(evidence.logs), "LOG"), tuple(states)
    if evidence.other is not None:
        why = f"Check whether the log is of {evidence.other.name}, and use the robot file of the arm that made it."
        return [Step(why, shell("dynid", "check", log, "--robot", evidence.other.name), everything)]
    if evidence.alarms:
        why = "The robot file and the log do not belong together: see which edit of the file explains the torques."
        return [Step(why, shell("dynid", "check", log, "--robot", evidence.robot), everything)]
    return []


def _gap(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    gap = evidence.gap
    if gap is None or states["complete"] == "good" or (unsearched(evidence) and not gap.named):
        return []
    found = []
    run, logs = run_of(evidence), gap.logs or ("LOG",)
    if gap.missing and not gap.ambiguous:
        why = "Add what was found to a copy of the robot file, and identify the arm with it."
        command = f"{shell('dynid', 'gap', run, *logs)} --apply best"
        return [Step(why, command, ("complete", "fit", "unseen motion", "physics"))]
    for event in gap.events:
        times = f"{max(0.0, event.start):.1f}-{event.end:.1f}"
        command = shell("dynid", "identify", evidence.robot, event.log, "--exclude", times)
        why = f"Leave out what happened once on {event.joint}, at {event.start:.1f} s."
        found.append(Step(why, command, ("complete",)))
    if gap.unrepeatable and not gap.events:
        why = f"Look for contacts, cables or a drifting sensor on {', '.join(gap.unrepeatable)}, then record again."
        found.append(
            Step(why, shell("dynid", "check", logs[0], "--robot", evidence.robot), ("complete",))
        )
    elif gap.effects and gap.effects[0].effect == "counterbalance" and not gap.ambiguous:
        # Why no motion: links of another mass make the same torques in every one.
        link = gap.joints.index(gap.effects[0].joint) + 1
        why = f"Give the mass of link {link} and a box around its centre of mass, from its drawing, and identify again."
        command = f"{shell('dynid', 'identify', evidence.robot, *_logs(evidence))} --link-mass {link}=LOW:HIGH"
        found.append(
            Step(why, f"{command} --com-box {link}=X,Y,Z:X,Y,Z", ("complete", "physics", "fit"))
        )
    else:
        file = str(PurePath(evidence.result).parent / "gap.npz") if evidence.result else "GAP.npz"
        why = "Record the motion that decides, each run twice: repeats tell noise from effect."
        found.append(
            Step(
                why, shell("dynid", "trajectory", evidence.robot, "--for-gap", file), ("complete",)
            )
        )
    return found


def _physics(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    if states["physics"] in ("good", "open") and states["fit"] in ("good", "open"):
        return []
    lights = tuple(name for name in ("physics", "fit") if states[name] not in ("good", "open"))
    if evidence.gap is None or unsearched(evidence):
        why = "Search for the effect that the model lacks."
        return [
            Step(
                why,
                shell("dynid", "gap", run_of(evidence), *_logs(evidence)),
                (*lights, "complete"),
            )
        ]
    why = "Give what is known of the arm, such as the mass of link 2 from its data sheet, and identify again."
    logs = evidence.logs or ("LOG",)
    return [
        Step(
            why,
            f"{shell('dynid', 'identify', evidence.robot, *logs)} --link-mass 2=LOW:HIGH",
            lights,
        )
    ]


def _unseen(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    if states["unseen motion"] == "open":
        why = "The model was not tested on another motion: replay a recording of one."
        return [
            Step(why, f"{shell('dynid', 'validate', run_of(evidence))} LOG", ("unseen motion",))
        ]
    if states["unseen motion"] == "good":
        return []
    if evidence.gap is None or unsearched(evidence):
        why = "Ask what is missing, or has changed, on the motion that the model does not predict."
        return [
            Step(
                why,
                shell("dynid", "gap", run_of(evidence), *_logs(evidence)),
                ("unseen motion", "complete"),
            )
        ]
    why = "Add a recording of another motion to the fitted ones, so that the model need not guess there."
    logs = [each.log for each in evidence.unseen if each.log] or ["LOG"]
    command = shell("dynid", "identify", evidence.robot, logs[0], "--update", run_of(evidence))
    return [Step(why, command, ("unseen motion",))]


def _motion(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    if states["knowledge"] == "good":
        return []
    left = f"{evidence.open} parameters are not determined: plan" if evidence.open else "Plan"
    why = f"{left} a longer motion that shows more."
    return [Step(why, shell("dynid", "trajectory", evidence.robot), ("knowledge",))]


def _search(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    found = []
    if states["complete"] == "open":
        why = "Ask whether an effect is missing; recordings of the same motion twice tell it best."
        found.append(
            Step(why, shell("dynid", "gap", run_of(evidence), *_logs(evidence)), ("complete",))
        )
    if states["fit"] == "open":
        found.append(
            Step("Identify the arm.", shell("dynid", "identify", evidence.robot, "LOG"), ("fit",))
        )
    if states["physics"] == "open":
        why = "Ask whether an arm with such parameters can exist."
        logs = evidence.logs or ("LOG",)
        found.append(
            Step(
                why, f"{shell('dynid', 'identify', evidence.robot, *logs)} --feasible", ("physics",)
            )
        )
    return found


def _use(evidence: Evidence, states: dict[str, str]) -> list[Step]:
    """Return that the model can be used, where nothing speaks against it."""
    if any(state == "bad" for state in states.values()) or states["unseen motion"] != "good":
        return []
    command = f"{shell('dynid', 'export', run_of(evidence))} --format urdf"
    return [Step("Use the model in a simulator or a controller.", command)]
