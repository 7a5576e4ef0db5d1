"""Do the statements of identify, validate, gap and report agree with each other, and are the lights right?

    python benchmarks/judgement.py --out judgement.json [--cases 200] [--seed 1] [--minutes 60]
    python benchmarks/judgement.py --kind lights --out lights.json --cases 600         without gap, for the lights

Random situations: an arm, lengths and noise of its logs, something hidden in them or a mistake, a motion again or another.
Each goes through identify, validate, gap and report; ``contradictions`` reads their JSON. The lights are compared with
the error on one more motion that nothing has seen, and with the noise that was put in.
"""

import math
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.stats import beta

import study
from dynid.cli.session import plain
from dynid.errors import DynidError
from dynid.estimation.stack import stack_logs
from dynid.loading import load_robot, load_run
from dynid.model.parameters import prior_bodies
from dynid.options import LogOptions
from dynid.robot import Prior
from dynid.signals.conditioned_log import condition_logs
from dynid.sim.sines import SineSpec, sines
from dynid.workflows.gap import find_gap
from dynid.workflows.identify import identify, save_result
from dynid.workflows.model import base_model
from dynid.workflows.report import report
from dynid.workflows.simulate import simulate
from dynid.workflows.validate import validate

#: Arms, and what may be hidden at a joint: an effect of the catalogue with its numbers by the torque of the joint.
ARMS = ("scara", "ur5e", "kuka_lwr4plus")
HIDDEN = (
    "nothing",
    "nothing",
    "spring",
    "asymmetric_viscous",
    "payload",
    "wrong_sign",
    "wrong_arm",
    "drift",
)
STEP = 0.005
#: Effects that gap tries here: the others would only take time.
TRIED = "spring,asymmetric_viscous,payload,torque_offset,stribeck"
_BASES = {}


def arm_of(name):
    """Return an arm with cylinders as its true bodies, and its base model."""
    if name not in _BASES:
        robot = load_robot(name)
        robot = replace(robot, prior=Prior(links=tuple(prior_bodies(robot))), tool=None)
        _BASES[name] = robot, base_model(robot)
    return _BASES[name]


def case_of(seed):
    """Return a random situation."""
    rng = np.random.default_rng([seed, 29])
    return {
        "seed": seed,
        "arm": str(rng.choice(ARMS, p=(0.5, 0.25, 0.25))),
        "seconds": float(rng.choice((3.0, 8.0, 15.0, 30.0))),
        "noise": float(10 ** rng.uniform(-3, -1.3)),
        "hidden": str(rng.choice(HIDDEN)),
        "always": bool(rng.random() < 0.5),
        "same": bool(rng.random() < 0.4),
        "motions": int(rng.choice((1, 2))),
        "repeats": int(rng.choice((1, 2))),
        "joint": int(rng.integers(1, 4)),
        "size": float(10 ** rng.uniform(-1.5, 0)),
    }


def light_case_of(seed):
    """Return a situation for the lights: of four one as it comes, one well recorded, two with a large mistake.

    Why: good and bad are said of few situations as they come, and their rates need 59 cases each. What is true is drawn
    and measured as in the others: a well recorded arm may be worse than its noise, a mistake may be harmless.
    """
    case, rng = case_of(seed), np.random.default_rng([seed, 30])
    case |= {
        "same": False,
        "repeats": 2,
        "seconds": float(rng.choice((8.0, 15.0, 30.0))),
        "drawn": "as it comes",
    }
    if seed % 4 == 1:
        case |= {"hidden": "nothing", "motions": 2, "drawn": "well recorded"}
    elif seed % 4 >= 2:
        hidden = str(
            rng.choice(("wrong_sign", "wrong_arm", "payload", "spring", "asymmetric_viscous"))
        )
        case |= {
            "hidden": hidden,
            "size": float(10 ** rng.uniform(-0.5, 0.5)),
            "drawn": "large mistake",
        }
    return case


def logs_of(case):
    """Return an arm as the user's file has it, logs to identify from, a replay, and one more motion."""
    robot, _ = arm_of(case["arm"])
    spec = SineSpec(case["seconds"], max(5.0, case["seconds"] / 2), 0.7, 0.5, 0.5, -math.inf)
    motions = [
        sines(robot, spec, STEP, np.random.default_rng([case["seed"], 2, k]))
        for k in range(case["motions"] + 2)
    ]
    count = iter(range(100))

    def log(motion, changed):
        found = simulate(robot, motion, noise=case["noise"], seed=case["seed"] + next(count))
        tau, j = found.log.tau.copy(), case["joint"]
        size = case["size"] * np.sqrt(np.mean(found.torque[:, j] ** 2))
        if changed and case["hidden"] == "spring":
            tau[:, j] += size * motion.q[:, j]
        elif changed and case["hidden"] == "asymmetric_viscous":
            tau[:, j] += size * np.abs(motion.qd[:, j]) / max(np.abs(motion.qd[:, j]).max(), 1e-6)
        elif changed and case["hidden"] == "drift":
            tau[:, j] += size * np.linspace(0, 1, len(tau)) ** 2
        elif changed and case["hidden"] == "payload":
            loaded = simulate(robot, motion, noise=0.0, payload=2.0 * case["size"])
            tau += loaded.torque - found.torque
        elif case["hidden"] == "wrong_sign":
            tau[:, j] *= -1.0
        return replace(found.log, tau=tau, sha256=f"{case['seed']}-{next(count)}")

    always = case["always"] or case["hidden"] in ("wrong_sign", "wrong_arm")
    fitted = [log(m, always) for m in motions[: case["motions"]] for _ in range(case["repeats"])]
    replay = log(motions[0] if case["same"] else motions[-2], True)
    # The arm as it is in the end: the lights are about that.
    unseen = log(motions[-1], True)
    own = robot
    if case["hidden"] == "wrong_arm":
        joints = tuple(replace(j, a=1.4 * j.a, d=1.4 * j.d) for j in robot.joints)
        own = replace(robot, joints=joints)
    return own, fitted, replay, unseen


def states_of(answer):
    """Return the state of each light of an answer."""
    return {light["name"]: light["state"] for light in answer["judgement"]["lights"]}


def contradictions(answers):
    """Return pairs of statements of the answers of one situation that cannot both be true."""
    found = []
    for name, answer in answers.items():
        judged = answer["judgement"]
        states, said = states_of(answer), judged["sentence"]
        bad = "bad" in states.values()
        rules = {
            "a warning without a red light": said.startswith("Do not use") and not bad,
            "praise beside a red light": said.startswith("The model predicts held-out motions")
            and bad,
            "praised for repeats that there are not": "repeat" in said
            and said.startswith(("The model predicts", "No missing effect", "No change since"))
            and any("lower bound" in each for each in judged["warnings"]),
            "good beside a light that is not": judged["state"] == "good"
            and bool({"fair", "bad"} & set(states.values())),
            "good without another motion": judged["state"] == "good"
            and states["unseen motion"] != "good",
            "nothing missing beside a light": said.startswith("No ")
            and states["complete"] != "good",
            "not tested, and tested": "Not yet validated" in said
            and states["unseen motion"] != "open",
            "to be used, and bad": bad
            and any("export" in step["command"] for step in judged["next"]),
            "no next step": any(state != "good" for state in states.values())
            and not judged["next"],
            "praise of unseen motion beside a light": said.startswith(
                "The model predicts held-out motions"
            )
            and states["unseen motion"] != "good",
            "a step that is no command": not all(
                step["command"].startswith("dynid ") for step in judged["next"]
            ),
        }
        found += [f"{name}: {rule}" for rule, broken in rules.items() if broken]
    if "gap" in answers:
        gap = answers["gap"]
        nothing = gap["verdict"].startswith("nothing")
        states = states_of(gap)
        said = gap["judgement"]["sentence"]
        early = said.startswith("The robot file does not")
        corrected = said.endswith("No other effect is missing.")
        if (nothing or corrected) != (states["complete"] == "good"):
            found.append("gap: its verdict and its light")
        if nothing and not early and not said.startswith("No "):
            found.append("gap: its verdict and its sentence")
        if gap["verdict"] == "named" and not gap["named"]:
            found.append("gap: named, and no name")
    for one, other in (("validate", "after_validate"), ("gap", "report")):
        if one in answers and other in answers:
            lights = [states_of(answers[key]) for key in (one, other)]
            if lights[0] != lights[1]:
                found.append(f"{one} and the report: {lights[0]} and {lights[1]}")
    if "validate" in answers and "gap" in answers:
        replayed = answers["validate"]
        states = states_of(replayed)
        expected = replayed["expected_relative_error_percent"]
        far = (
            expected
            and replayed["relative_error_percent"] > 3 * expected
            and states["unseen motion"] == "bad"
        )
        if far and answers["gap"]["verdict"].startswith("nothing"):
            found.append("validate misses far more than expected, and gap finds nothing")
    return found


def run(case, searched=True):
    """Return what all commands say in one situation, what contradicts, and whether the lights are right."""
    try:
        return said_of(case, searched)
    except DynidError as error:
        return case | {"refused": error.code, "contradictions": []}


def said_of(case, searched):
    """Return the row of a situation.

    Raises:
        DynidError: identify or validate refuse its logs.
    """
    robot, fitted, replay, unseen = logs_of(case)
    base = base_model(robot)
    answers, row = {}, dict(case)
    with tempfile.TemporaryDirectory() as folder:
        result = identify(robot, fitted, base=base, anyway=True, drop_weak=True)
        save_result(Path(folder), result)
        stored = load_run(Path(folder))
        answers["identify"] = plain(stored.facts())
        found = validate(stored, replay)
        found = replace(found, log=str(Path(folder) / "replay.npz"))
        answers["validate"] = plain(found.facts())
        found.save(found.folder(Path(folder) / "validation"))
        if searched:
            answers["after_validate"] = plain(report(load_run(Path(folder))).facts())
            try:
                gap = find_gap(load_run(Path(folder)), [replay], earlier=fitted, effects=TRIED)
                gap.save(Path(folder) / "gap.npz")
                answers["gap"] = plain(gap.facts())
                answers["report"] = plain(report(load_run(Path(folder))).facts())
            except DynidError as error:
                row["gap_refused"] = error.code
        truth = validate(stored, unseen)
    floor = true_floor(case, result, unseen)
    error = np.array([joint.rms for joint in truth.joints])
    torque = np.array([joint.torque_rms for joint in truth.joints])
    return row | {
        "contradictions": contradictions(answers),
        "states": {name: answer["judgement"]["state"] for name, answer in answers.items()},
        "unseen_over_noise": float((error / np.maximum(floor, 0.005 * torque)).max()),
    }


def true_floor(case, result, unseen):
    """Return the rms that the noise put in has after the filter of a result, (n,) [N m]."""
    rng = np.random.default_rng([case["seed"], 5])
    arm, base = arm_of(case["arm"])
    sigma = case["noise"] * np.array([joint.limits.torque for joint in arm.joints])
    white = replace(unseen, tau=sigma * rng.standard_normal(unseen.tau.shape), sha256="white")
    logs = condition_logs([white], base.model, LogOptions(cutoff=result.cutoff))
    stack = stack_logs(logs, base)
    return np.sqrt(np.sum(stack.factors[:, :, -1] ** 2, axis=1) / np.maximum(1, stack.counts))


# ---------------------------------------------------------------- rates
def calibration(rows, stage=None):
    """Return how often good and bad are right: "good" promises each joint within twice its noise.

    Args:
        rows: situations.
        stage: after which command; None for the last one.
    """
    good = bad = right = wrong = 0
    for row in rows:
        states = row.get("states", {})
        if not states or stage not in (None, *states):
            continue
        state = states[stage or list(states)[-1]]
        within = row["unseen_over_noise"] <= 2.0
        good, right = good + (state == "good"), right + (state == "good" and within)
        bad, wrong = bad + (state == "bad"), wrong + (state == "bad" and within)
    return good, right, bad, wrong


def proved(right, count):
    """Return the share that is exceeded with a confidence of 95 % (Clopper and Pearson)."""
    return float(beta.ppf(0.05, right, count - right + 1)) if right else 0.0


def table(rows):
    """Return rates of good and bad, and contradictions, after each command."""
    lines, count = [], sum(bool(row["contradictions"]) for row in rows)
    for stage in ("identify", "validate", "report", None):
        good, right, bad, wrong = calibration(rows, stage)
        least, most = proved(right, good), 1 - proved(bad - wrong, bad)
        counts = f"{right} of {good}", f"{100 * least:.0f} %", f"{wrong} of {bad}"
        title = f"after {stage or 'the last command'}"
        lines.append([title, len(rows), count, *counts, f"{100 * most:.0f} %"])
    head = "evidence | cases | contradict | good: right | proved | bad: wrong | at most"
    return study.markdown(head, lines)


# ---------------------------------------------------------------- command
def main():
    options = {"kind": "situations", "cases": 200, "seed": 1, "minutes": 60.0}
    given = study.arguments(__doc__, out=Path("judgement.json"), **options)
    answers, end = study.Answers(given.out), time.time() + 60 * given.minutes
    searched = given.kind == "situations"
    make, first = case_of if searched else light_case_of, 1000 * given.seed
    for seed in range(first, first + given.cases):
        if str(seed) not in answers and time.time() < end:
            row = run(make(seed), searched)
            answers.keep(str(seed), row)
            state = list(row["states"].values())[-1] if "states" in row else row["refused"]
            print(seed, row["arm"], row["hidden"], state, row["contradictions"], flush=True)
    print(table(answers.values()))


if __name__ == "__main__":
    main()
