"""Blind benchmark of ``dynid gap``: hide one thing, two things or nothing, and see what is named.

    python benchmarks/gap_blind.py --out gap_blind.json [--minutes 20] [--table docs/explanation/gap-benchmark.md]

Cases are drawn from seeds, in an order that mixes the sets, so that a run that is cut short is still a fair sample;
finished cases are kept in the JSON file and skipped when it is run again.
"""

import argparse
import json
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np

import hidden_effects as hidden
from dynid.files.robotfile import load_robot
from dynid.gap.final import fit_picks, shrink
from dynid.gap.search import Options, search
from dynid.gap.setting import Known, make_setting
from dynid.gap.verdict import judge
from dynid.identify.estimate import estimate
from dynid.identify.stack import Source, stack
from dynid.log import Log
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model
from dynid.model.store import BaseModel
from dynid.quality.condition import choose_filter, condition
from dynid.robot import Coulomb

CUTOFF = 10.0
#: Where each effect can be seen: joints (0-based) that carry it well on these arms.
JOINTS = (1, 2, 3, 4)
_MODELS = {}


def model_of(name):
    if name not in _MODELS:
        robot = load_robot(hidden.ROBOT[name])
        bare = tuple(replace(j, friction=("viscous", "coulomb"), motor_inertia=False) for j in robot.joints)
        # Why: the truth is tanh(v / 0.003); 0.005 leaves a difference that the search must not take for an effect.
        model = build_model(replace(robot, joints=bare, coulomb=Coulomb("smooth", (0.005,) * robot.n)))
        _MODELS[name] = BaseModel(model, reduce(model))
    return _MODELS[name]


def sources_of(logs, robot):
    start = logs[0][0][0]
    found = []
    for k, (t, q, tau) in enumerate(logs):
        log = Log(t, q, tau, robot.joint_names)
        chosen = choose_filter(log, robot, CUTOFF)
        segments = [replace(s, since=s.since + t[0] - start) for s in condition(log, chosen)]
        found.append(Source(segments, chosen, f"log {k + 1}"))
    return found


def draw(set_name, k):
    """Return what is hidden in the k-th case of a set: [(effect, joint)], size, arm."""
    rng = np.random.default_rng([k, zlib.crc32(set_name.encode())])
    arm = "lwr4plus" if rng.random() < 0.6 else "kinova_gen2"
    size = float(np.exp(rng.uniform(np.log(0.7), np.log(5))))
    joint = int(rng.choice(JOINTS))
    if set_name == "clean":
        return [("torque_offset", joint)], 0.0, arm
    if set_name == "outside":
        return [(hidden.OUTSIDE[k % len(hidden.OUTSIDE)], joint)], max(size, 2.0), arm
    if set_name == "changed":
        effects = (*hidden.CHANGES, "none")
        name = effects[k % len(effects)]
        return [(name if name != "none" else "torque_offset", joint)], 0.0 if name == "none" else max(size, 1.5), arm
    names = [n for n in hidden.CATALOGUE if n != "torque_delay"] if set_name == "double" else list(hidden.CATALOGUE)
    first = names[k % len(names)] if set_name == "single" else str(rng.choice(names[:11]))
    if first == "motor_inertia":
        joint = max(joint, 2)
    if first == "joint_elasticity":
        joint = int(rng.choice([1, 3]))
    if set_name == "single":
        return [(first, joint)], size, arm
    second = str(rng.choice([n for n in names[:11] if n != first]))
    return [(first, joint), (second, int(rng.choice(JOINTS)))], max(size, 1.2), arm


def logs_of(effects, size, arm, seed, **options):
    """Return logs with one effect, or with the torques of two added to the same motion and noise."""
    cases = [hidden.Case(arm, name, joint, size, seed) for name, joint in effects]
    logs = hidden.simulate(cases[0], **options)
    if len(cases) == 2:
        other = hidden.simulate(cases[1], **options)
        bare = hidden.simulate(cases[1], hide=False, **options)
        logs = [(t, q, tau + a - b) for (t, q, tau), (_, _, a), (_, _, b) in zip(logs, other, bare, strict=True)]
    return logs, cases


def known_of(base, arm, seed):
    """Identify the arm from an earlier session without the change."""
    case = hidden.Case(arm, "torque_offset", 2, 0.0, seed + 77)
    sources = sources_of(hidden.simulate(case, trajectories=2, plan_seed=seed + 5000), base.robot)
    reduction = base.reduction
    stacked = stack(sources, base.model.observer(reduction.base), reduction.base_names, base.robot.joint_names)
    found = estimate(stacked, base, method="wls", holdout=None)
    return Known(found.theta, found.covariance)


def truth_of(cases, n):
    places = []
    for case in cases:
        if case.size == 0 or case.effect in hidden.OUTSIDE:
            continue
        if case.effect in hidden.WHOLE_ARM:
            places.append((case.effect, ()))
        elif case.effect in ("joint_coupling", "torque_crosstalk"):
            places.append((case.effect, (case.joint, hidden.partner(case, n))))
        else:
            places.append((case.effect, (case.joint,)))
    return places


def run(set_name, k):
    effects, size, arm = draw(set_name, k)
    seed = 10_000 + 97 * k + zlib.crc32(set_name.encode()) % 9973
    base = model_of(arm)
    known = known_of(base, arm, seed) if set_name == "changed" else None
    logs, cases = logs_of(effects, size, arm, seed)
    start = time.process_time()
    sources = sources_of(logs, base.robot)
    found = search(sources, base, known, Options())
    fitted, _ = fit_picks(found)
    first = make_setting(sources, base, known)
    proof = shrink(first, found, fitted)
    verdict = judge(found, fitted, proof, base.robot.joint_names)
    seconds = time.process_time() - start
    visible = np.sqrt(np.maximum(found.before - 1, 0))
    joint = int(np.argmax(visible))
    return {
        "set": set_name, "k": k, "arm": arm, "size": size, "truth": truth_of(cases, base.robot.n),
        "hidden": [[c.effect, c.joint] for c in cases], "verdict": verdict.word,
        "named": [[f.pick.effect.name, list(f.pick.place)] for f in verdict.named],
        "closest": [[f.pick.effect.name, list(f.pick.place), why] for f, why in verdict.closest],
        "alternatives": [list(group) for group in verdict.alternatives],
        "visible": float(visible.max()), "closed": float(proof.closed[joint]), "seconds": seconds,
        "unrepeatable": [found.setting.noise.burst.max(), found.setting.noise.wander.max()],
        "held": [proof.before.round(4).tolist(), proof.after.round(4).tolist(), proof.floor.round(4).tolist()],
        "chi": [found.before.round(2).tolist(), found.after.round(2).tolist()],
    }  # fmt: skip


def outcome(row):
    """Return exact, partly, missed or wrong."""
    truth = {(name, tuple(place)) for name, place in row["truth"]}
    named = {(name, tuple(place)) for name, place in row["named"]}
    if named - truth:
        return "wrong" if not named & truth else "right and a wrong one"
    if named == truth:
        return "exact"
    return "part of it" if named else "nothing named"


def table(rows):
    lines = ["| set | visible size over noise | cases | exact | part of it | nothing named | right and a wrong one | wrong |",
             "|---|---|---|---|---|---|---|---|"]  # fmt: skip
    bands = {"clean": [(-1, 1e9)], "outside": [(-1, 1e9)], "changed": [(-1, 1e9)]}
    for name in ("clean", "single", "double", "changed", "outside"):
        for low, high in bands.get(name, [(1, 1e9), (0.5, 1), (-1, 0.5)]):
            some = [r for r in rows if r["set"] == name and low <= r["visible"] < high]
            if not some:
                continue
            band = "all" if high > 1e8 and low < 0 else f"{low:g} and more" if high > 1e8 else f"{max(low, 0):g} to {high:g}"
            counts = [sum(outcome(r) == word for r in some) for word in ("exact", "part of it", "nothing named", "right and a wrong one", "wrong")]
            lines.append(f"| {name} | {band} | {len(some)} | {' | '.join(map(str, counts))} |")
    named = [r for r in rows if r["truth"] and outcome(r) == "exact"]
    closed = np.array([r["closed"] for r in named]) if named else np.zeros(1)
    seconds = np.array([r["seconds"] for r in rows])
    lines += ["", f"Closed share of what noise does not explain, on held-out rows of the exact cases: median {np.median(closed):.2f}, "
              f"tenth percentile {np.quantile(closed, 0.1):.2f}. Processor time a case (7 joints, 120 s at 200 Hz): median "
              f"{np.median(seconds):.1f} s, longest {seconds.max():.1f} s.", ""]  # fmt: skip
    lines += ["Cases that were not exact:", "", "| set | hidden | visible | named | verdict |", "|---|---|---|---|---|"]
    for r in rows:
        if outcome(r) != "exact":
            text = ", ".join(f"{n} on joint {j + 1}" for n, j in r["hidden"])
            said = ", ".join(f"{n} {'-'.join(str(j + 1) for j in p)}" for n, p in r["named"]) or "-"
            lines.append(f"| {r['set']} | {text} | {r['visible']:.2f} | {said} | {r['verdict']} |")
    return "\n".join(lines)


def order():
    """Mix the sets: of every eight cases four single, one each of the others."""
    count = dict.fromkeys(("clean", "single", "double", "changed", "outside"), 0)
    while True:
        for name in ("single", "clean", "single", "double", "single", "changed", "single", "outside"):
            yield name, count[name]
            count[name] += 1


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path("gap_blind.json"))
    parser.add_argument("--minutes", type=float, default=20.0)
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    rows = json.loads(args.out.read_text()) if args.out.exists() else []
    done = {(r["set"], r["k"]) for r in rows}
    end = time.monotonic() + 60 * args.minutes
    for name, k in order():
        if time.monotonic() > end:
            break
        if (name, k) in done:
            continue
        row = run(name, k)
        rows.append(row)
        args.out.write_text(json.dumps(rows, indent=1))
        print(f"{name:8} {row['hidden']} visible {row['visible']:.2f} -> {row['named']} {row['verdict']} "
              f"[{outcome(row)}] {row['closest']} {row['seconds']:.1f} s", flush=True)  # fmt: skip
    print(table(rows))
    if args.table:
        args.table.write_text(table(rows) + "\n")


if __name__ == "__main__":
    main()
