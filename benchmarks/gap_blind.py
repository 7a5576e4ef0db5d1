"""Blind benchmark of ``dynid gap``: hide one thing, two things or nothing, and see what is named.

    python benchmarks/gap_blind.py --out gap_blind.json [--seed 1] [--minutes 90] [--table benchmarks/gap_blind.md]

Cases are drawn from seeds, in an order that mixes the sets, so that a run that is cut short is still a fair sample;
finished cases are kept in the JSON file and skipped when it is run again. The search was developed with seed 0; the
table that is shown comes from another one.
"""

import tempfile
import time
import zlib
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

import heavy_arms as heavy
import hidden_effects as hidden
from dynid.estimation.estimate import estimate
from dynid.estimation.least_squares import relative_error
from dynid.estimation.stack import stack_logs
from dynid.files.robotfile import load_robot
from dynid.gap.analysis import analyse_gap, on_one_clock, replays
from dynid.gap.problem import kept_model, make_problem
from dynid.gap.refit import held_out_improvement, refit
from dynid.gap.search import EffectSearch
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.log import Log
from dynid.model.base_model import BaseModel
from dynid.model.reduce import reduce
from dynid.model.regressor import build_model
from dynid.robot import Body, Coulomb, Known, Prior
from dynid.signals.conditioned_log import condition_log
from dynid.signals.stamps import with_even_clock
from dynid.workflows.gap import find_gap
from dynid.workflows.identify import identify
from resumable import parser_of, run_cases

CUTOFF = 10.0
#: Where each effect can be seen: joints (0-based) that carry it well on these arms.
JOINTS = (1, 2, 3, 4)
#: What the arm has anyway and the model is left without.
LACKING = ("viscous", "coulomb")
#: Effects that are hidden as a part, beside a rest on the same joint that is in no catalogue.
PARTS = (
    "asymmetric_viscous",
    "load_friction",
    "position_friction",
    "torque_ripple",
    "nonlinear_viscous",
    "joint_coupling",
    "torque_crosstalk",
)
RESTS = ("odd_cross", "load_viscous", "sum_angle", "dead_band", "ringing")
#: What old and new logs alike hold where nothing has changed: what goes on from one session to the next as it was.
ALWAYS = tuple(
    name
    for name in (*hidden.CATALOGUE, *hidden.OUTSIDE)
    if name not in ("warmup_friction", "torque_drift", "contacts", "wandering")
)
_MODELS = {}


def model_of(name, lacks=None):
    """Return the model of an arm; without viscous or Coulomb friction of one joint when it lacks it."""
    if (name, lacks) not in _MODELS:
        robot = load_robot(hidden.ROBOT[name])
        bare = [
            replace(j, friction=("viscous", "coulomb"), motor_inertia=False) for j in robot.joints
        ]
        if lacks:
            bare[lacks[1]] = replace(
                bare[lacks[1]], friction=tuple(f for f in ("viscous", "coulomb") if f != lacks[0])
            )
        # Why: the truth is tanh(v / 0.003); 0.005 leaves a difference that the search must not take for an effect.
        model = build_model(
            replace(robot, joints=tuple(bare), coulomb=Coulomb("smooth", (0.005,) * robot.n))
        )
        _MODELS[name, lacks] = BaseModel(model, reduce(model))
    return _MODELS[name, lacks]


def sources_of(logs, model):
    start = logs[0][0][0]
    found = []
    for k, (t, q, tau) in enumerate(logs):
        log = with_even_clock(Log(t, q, tau, model.robot.joint_names))
        one = replace(condition_log(log, model, cutoff=CUTOFF), name=f"log {k + 1}")
        found.append(
            replace(
                one, segments=[replace(s, elapsed=s.elapsed + t[0] - start) for s in one.segments]
            )
        )
    return found


def crude(robot, arm, rng):
    """Return a robot whose prior bodies are wrong by 30 to 50 % in mass, place and inertia."""
    truth = hidden.truth_of(arm)
    return replace(robot, prior=Prior(links=tuple(wrong_body(*body, rng) for body in truth)))


def wrong_body(mass, com, inertia, rng):
    """Return a body of which mass and size are wrong by 30 to 50 %."""
    heavier, wider = np.exp(rng.choice([-1, 1], 2) * rng.uniform(0.3, 0.5, 2))
    turn = rng.normal(size=3)
    com = com + 0.4 * np.linalg.norm(com) * turn / np.linalg.norm(turn)
    tensor = (inertia * heavier * wider)[np.triu_indices(3)]
    return Body(float(mass * heavier), tuple(map(float, com)), tuple(map(float, tensor)))


def draw(set_name, k, seed=0):
    """Return what is hidden in the k-th case of a set: [(effect, joint)], size, arm, what else is odd about the logs."""
    rng = np.random.default_rng([k, zlib.crc32(set_name.encode()), seed])
    arm = "lwr4plus" if rng.random() < 0.6 else "kinova_gen2"
    size = float(np.exp(rng.uniform(np.log(0.7), np.log(5))))
    joint = int(rng.choice(JOINTS))
    if set_name == "clean":
        return [("torque_offset", joint)], 0.0, arm, hidden.DECOYS[k % len(hidden.DECOYS)]
    if set_name == "crude":
        nothing = k % 3 == 2
        name = "torque_offset" if nothing else str(rng.choice(hidden.CATALOGUE[:18]))
        joint = (
            max(joint, 2)
            if name == "motor_inertia"
            else int(rng.choice([1, 3]))
            if name == "joint_elasticity"
            else joint
        )
        return [(name, joint)], 0.0 if nothing else max(size, 1.2), arm, "plain"
    if set_name == "partial":
        return (
            [(PARTS[k % len(PARTS)], joint), (str(rng.choice(RESTS)), joint)],
            max(size, 2.0),
            arm,
            "plain",
        )
    if set_name == "outside":
        return [(hidden.OUTSIDE[k % len(hidden.OUTSIDE)], joint)], max(size, 2.0), arm, "plain"
    if set_name == "changed":
        effects = (*hidden.CHANGES, "none")
        name = effects[k % len(effects)]
        changed = [(name if name != "none" else "torque_offset", joint)]
        return changed, 0.0 if name == "none" else max(size, 1.5), arm, "plain"
    if set_name == "unchanged":
        nothing = k % 2 == 0
        name = "torque_offset" if nothing else ALWAYS[(k // 2) % len(ALWAYS)]
        return [(name, joint)], 0.0 if nothing else max(size, 1.0), arm, "plain"
    names = [
        n for n in (*hidden.CATALOGUE, *LACKING) if set_name == "single" or n != "torque_delay"
    ]
    first = names[k % len(names)] if set_name == "single" else str(rng.choice(names[:18]))
    if first == "motor_inertia":
        joint = max(joint, 2)
    if first == "joint_elasticity":
        joint = int(rng.choice([1, 3]))
    if set_name == "single":
        return [(first, joint)], size, arm, "plain"
    if set_name == "messy":
        return [(first, joint)], max(size, 1.5), arm, hidden.MESSES[k % len(hidden.MESSES)]
    # Why not more: the torques of the second are added to logs of the first, whose positions must not depend on it.
    second = str(rng.choice([n for n in names[:15] if n != first]))
    return [(first, joint), (second, int(rng.choice(JOINTS)))], max(size, 1.2), arm, "plain"


def logs_of(effects, size, arm, seed, extra="plain", **options):
    """Return logs with one effect, or with the torques of two added to the same motion and noise."""
    cases = [hidden.Case(arm, name, joint, size, seed, extra) for name, joint in effects]
    if len(cases) == 2 and cases[1].effect in RESTS:
        share = np.random.default_rng([seed, 15]).uniform(0.15, 0.5)
        cases[1].size *= np.sqrt((1 - share) / share)
    logs = hidden.simulate(cases[0], **options)
    if len(cases) == 2:
        other = hidden.simulate(cases[1], **options)
        bare = hidden.simulate(cases[1], hide=False, **options)
        logs = [
            (t, q, tau + a - b)
            for (t, q, tau), (_, _, a), (_, _, b) in zip(logs, other, bare, strict=True)
        ]
    return logs, cases


def known_of(base, arm, seed):
    """Identify the arm from an earlier session of other motion without the change; return its logs too."""
    case = hidden.Case(arm, "torque_offset", 2, 0.0, seed + 77)
    return identified(hidden.simulate(case, trajectories=2, plan_seed=seed + 5000), base)


def identified(logs, base):
    """Return the model that logs give, to be kept, and these as they are compared with later ones."""
    sources = sources_of(logs, base.model)
    return kept_model(
        estimate(stack_logs(sources, base), base, method="wls", holdout=None)
    ), sources


def visible_cases(cases):
    """Return the cases that have a name."""
    return [case for case in cases if case.size and case.effect not in hidden.OUTSIDE]


def truth_of(cases, n):
    places = []
    for case in visible_cases(cases):
        if case.effect in hidden.WHOLE_ARM:
            places.append((case.effect, ()))
        elif case.effect in ("joint_coupling", "torque_crosstalk"):
            places.append((case.effect, (case.joint, hidden.partner(case, n))))
        else:
            places.append((case.effect, (case.joint,)))
    return places


def run(set_name, k, seed=0):
    if set_name == "counterbalance":
        return run_heavy(k, seed)
    effects, size, arm, extra = draw(set_name, k, seed)
    number = 10_000 + 97 * k + zlib.crc32(set_name.encode()) % 9973 + 1_000_003 * seed
    base = model_of(arm, effects[0] if effects[0][0] in LACKING else None)
    known, earlier = known_of(base, arm, number) if set_name == "changed" else (None, ())
    longer = {"trajectories": 5} if set_name == "unchanged" else {}
    logs, cases = logs_of(effects, size, arm, number, extra, **longer)
    if set_name == "unchanged":
        # Why one session: what is hidden is then the same before and after, only the motion is another.
        (known, earlier), logs = identified(logs[:4], base), logs[4:]
    if set_name == "crude":
        # Why the whole: which set is in force, and which questions are asked, is decided there.
        robot = crude(base.robot, arm, np.random.default_rng([number, 3]))
        recorded = [Log(*one, robot.joint_names) for one in logs]
        result = identify(robot, recorded)
        start = time.process_time()
        seen = find_gap(result, recorded).analysis
    else:
        start = time.process_time()
        sources = sources_of(logs, base.model)
        seen = analyse_gap(
            sources, base, known, SelectionOptions(), simulate=False, earlier=earlier
        )
    seconds = time.process_time() - start
    visible = np.sqrt(np.maximum(seen.search.before - 1, 0))
    joint = int(np.argmax(visible))
    size_seen = (
        visible.max()
        if len(cases) == 1 or set_name == "partial"
        else min(visible_alone(base, e, size, arm, number) for e in effects)
    )
    changed = [] if set_name == "unchanged" else cases
    row = {
        "set": set_name,
        "k": k,
        "seed": seed,
        "arm": arm,
        "size": size,
        "extra": extra,
        "truth": truth_of(changed, base.robot.n),
        "hidden": [[c.effect, c.joint] for c in cases],
        "verdict": seen.verdict.word,
        "named": [[f.name, list(f.joints)] for f in seen.verdict.named],
        "closest": [[f.name, list(f.joints), why] for f, why in seen.verdict.closest],
        "alternatives": [list(group) for group in seen.verdict.alternatives],
        "equals": [[[name, list(place)] for name, place in f.rivals] for f in seen.verdict.named],
        "sizes": [[f.name, list(f.joints), f.values, f.std_errors] for f in seen.verdict.named],
        "true": [
            [*place, size]
            for place, size in zip(
                truth_of(changed, base.robot.n),
                map(hidden.sizes_of, visible_cases(changed)),
                strict=True,
            )
        ],
        "visible": float(size_seen),
        "joint": joint,
        "seconds": seconds,
        "unrepeatable": [
            seen.search.problem.noise.burst.tolist(),
            seen.search.problem.noise.drift.tolist(),
        ],
        "held": [
            x.tolist()
            for x in (seen.improvement.before, seen.improvement.after, seen.improvement.floor)
        ],
        "chi": [
            seen.search.before.round(2).tolist(),
            seen.search.after.round(2).tolist(),
            seen.search.between_reversals.round(2).tolist(),
        ],
    }
    if set_name == "partial":
        row["part"] = float(visible_alone(base, effects[0], size, arm, number))
    if (
        row["truth"]
        and outcome(row) == "exact"
        and set_name in ("single", "double", "changed", "messy")
        and k % 10 == 3
    ):
        row["oracle"] = oracle_of(effects, size, arm, number, extra, known).tolist()
        row["simulated"] = simulated(seen)
    return row


def run_heavy(k, seed):
    """Look at a heavy arm with a counterbalance, or without, from the recordings to what is said."""
    number, carries, prior = 1000 * seed + k // 2, k % 2 == 0, heavy.PRIORS[(k // 2) % 3]
    drawn = heavy.draw(number, carries)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "heavy.yaml"
        path.write_text(yaml.safe_dump(heavy.robot_table(drawn)))
        robot = load_robot(path)
    rng = np.random.default_rng([number, 6])
    if prior == "crude":
        robot = replace(
            robot, prior=Prior(links=tuple(wrong_body(*body, rng) for body in drawn.bodies))
        )
    if prior == "masses":
        masses = tuple((i + 1, (0.9 * m, 1.1 * m)) for i, (m, _, _) in enumerate(drawn.bodies))
        robot = replace(robot, known=Known(link_mass=masses))
    logs = [Log(*one, robot.joint_names) for one in heavy.simulate(drawn, number, trajectories=2)]
    result = identify(robot, logs)
    theta = [result.reduction.K @ result.physical.x, result.plain]
    start = time.process_time()
    seen = find_gap(result, logs)
    return {
        "set": "counterbalance",
        "k": k,
        "seed": seed,
        "arm": f"{drawn.facts['kind']} {drawn.facts['mass']:.0f} kg",
        "extra": prior,
        "truth": [["counterbalance", [1]]] if carries else [],
        "size": drawn.carries,
        "hidden": [["counterbalance" if carries else "nothing", 1]],
        "counterweight": drawn.facts["counterweight"],
        "misfit": float(np.divide(*(relative_error(result.factors, one) for one in theta))),
        "verdict": seen.verdict,
        "named": [[f.effect, list(f.indices)] for f in seen.named],
        "closest": [[f.effect, list(f.indices), f.message] for f in seen.closest],
        "equals": [[] for f in seen.named],
        "asked": seen.asked,
        "visible": 1.0,
        "joint": 1,
        "told": "give the mass" in seen.asked,
        "sizes": [[f.effect, list(f.indices), f.values, f.std_errors] for f in seen.named],
        "true": [["counterbalance", [1], drawn.sizes()]] if carries else [],
        "seconds": time.process_time() - start,
    }


def visible_alone(base, effect, size, arm, seed):
    """Return the visible size of one of two effects, without the other."""
    logs, _ = logs_of([effect], size, arm, seed)
    problem = make_problem(on_one_clock(sources_of(logs, base.model)), base, None)
    chi = problem.regression().reduced_chi_square()
    return float(np.sqrt(np.maximum(chi - 1, 0)).max())


def oracle_of(effects, size, arm, number, extra, known):
    """Return the held-out error of the same logs without what is hidden, fitted by a model that lacks nothing."""
    name, joint = effects[0]
    bare = hidden.Case(
        arm, "torque_offset" if name in LACKING else name, joint, size, number, extra
    )
    base = model_of(arm)
    first = make_problem(
        on_one_clock(sources_of(hidden.simulate(bare, hide=False), base.model)), base, known
    )
    return held_out_improvement(first, search_nothing(first), []).before


def search_nothing(problem):
    """Return a search that found nothing."""
    chi = problem.regression().reduced_chi_square()
    return EffectSearch(problem, [], 0.0, None, chi, chi, chi, {})


def simulated(seen):
    """Return the position error of the replay in PyBullet before and after, at the joint of the gap [rad]."""
    both = replays(seen.problem, seen.search, seen.effects, refit(seen.search)[1])
    return None if both is None else [one.rms.tolist() for one in both]


def outcome(row):
    """Return what was said of a case, in one word."""
    truth = {(name, tuple(place)) for name, place in row["truth"]}
    named = {(name, tuple(place)) for name, place in row["named"]}
    if row["verdict"] == "ambiguous" and named != truth:
        each = [[one, *equal] for one, equal in zip(row["named"], row["equals"], strict=True)]
        options = [{(name, tuple(place)) for name, place in group} for group in each]
        if all(truth & group for group in options):
            return "ambiguous"
    if named - truth:
        return "wrong" if not named & truth else "right and a wrong one"
    if not named and row.get("told"):
        return "not told apart"
    if named == truth:
        if row["set"] == "outside":
            return (
                "exact" if row["verdict"] == "unexplained" or row["visible"] < SEEN else "not seen"
            )
        clear = row["verdict"] in ("nothing_missing", "nothing_changed")
        return "exact" if named or clear else "exact, with doubt"
    return "part of it" if named else "nothing named"


WORDS = (
    "exact",
    "exact, with doubt",
    "ambiguous",
    "part of it",
    "nothing named",
    "not told apart",
    "not seen",
    "right and a wrong one",
    "wrong",
)
SETS = {
    "clean": ((-1, 1e9),),
    "single": ((1, 1e9), (0.5, 1), (-1, 0.5)),
    "double": ((1, 1e9), (-1, 1)),
    "changed": ((0.5, 1e9), (-1, 0.5)),
    "unchanged": ((-1, 1e9),),
    "outside": ((-1, 1e9),),
    "messy": ((0.5, 1e9), (-1, 0.5)),
    "crude": ((1, 1e9), (0.5, 1), (-1, 0.5)),
    "partial": ((-1, 1e9),),
    "counterbalance": ((-1, 1e9),),
}
#: Visible sizes over noise of an effect that is a part, without the rest: a cap on sizes leaves some that none can see.
PART_BANDS = (("1 and more", 1, 1e9), ("0.5 to 1", 0.5, 1), ("less than 0.5", -1, 0.5))
#: Visible size from which something outside the catalogue should be seen: twice the power of a clean joint's limit.
SEEN = 0.5


def table(rows):
    lines = [
        f"| set | visible size over noise | cases | {' | '.join(WORDS)} |",
        "|---" * (3 + len(WORDS)) + "|",
    ]
    for name, bands in SETS.items():
        for low, high in bands:
            some = [r for r in rows if r["set"] == name and low <= r["visible"] < high]
            if not some:
                continue
            band = (
                "all"
                if high > 1e8 and low < 0
                else f"{low:g} and more"
                if high > 1e8
                else f"{max(low, 0):g} to {high:g}"
            )
            counts = [sum(outcome(r) == word for r in some) for word in WORDS]
            lines.append(f"| {name} | {band} | {len(some)} | {' | '.join(map(str, counts))} |")
    return "\n".join([*lines, "", *carried(rows), *figures(rows), "", *misses(rows)])


def carried(rows):
    """Return what was said of heavy arms, by what is known of their links."""
    rows = [r for r in rows if r["set"] == "counterbalance"]
    if not rows:
        return []
    lines = [
        "| heavy arms | known of the links | possible links miss | arms | named | not told apart | nothing said |"
    ]
    lines += ["|---" * 7 + "|"]
    for there, what in ((True, "with a counterbalance"), (False, "without")):
        for prior in heavy.PRIORS:
            for low, high, ratio in (
                (0, 3, "less than 3 times as much"),
                (3, 1e9, "3 times as much and more"),
            ):
                some = [
                    r
                    for r in rows
                    if bool(r["truth"]) == there
                    and r["extra"] == prior
                    and low <= r["misfit"] < high
                ]
                named = sum(["counterbalance", [1]] in r["named"] for r in some)
                told = sum(r["told"] for r in some)
                if some:
                    lines.append(
                        f"| {what} | {prior} | {ratio} | {len(some)} | {named} | {told} | {len(some) - named - told} |"
                    )
    return [*lines, ""]


def intervals(rows):
    """Return (error, standard error) of each true size that was named at its place."""
    found = []
    for r in rows:
        said = {
            (name, tuple(place)): (values, errors)
            for name, place, values, errors in r.get("sizes", [])
        }
        for name, place, true in r.get("true", []):
            values, errors = said.get((name, tuple(place)), ({}, {}))
            pairs = [
                (values[x] - true[x], errors[x])
                for x in true
                if x in values and np.isfinite(errors.get(x, np.inf))
            ]
            found += [(r["set"], *pair) for pair in pairs]
    return found


def figures(rows):
    """Return what was reached, in sentences."""
    exact = [r for r in rows if r.get("oracle")]
    closed = []
    for r in exact:
        before, after, oracle = (
            r["held"][0][r["joint"]],
            r["held"][1][r["joint"]],
            r["oracle"][r["joint"]],
        )
        closed.append((before**2 - after**2) / max(before**2 - oracle**2, 1e-12))
    seconds = np.array([r["seconds"] for r in rows])
    replays = [
        (r["simulated"][0][r["joint"]], r["simulated"][1][r["joint"]])
        for r in exact
        if r.get("simulated")
    ]
    lines = [
        f"Processor time a case (7 joints, 120 s at 200 Hz): median {np.median(seconds):.1f} s, longest {seconds.max():.1f} s."
    ]
    if closed:
        lines.append(
            f"Closed held-out gap over what an oracle closes that knows the truth, {len(closed)} exact cases: median "
            f"{np.median(closed):.3f}, tenth percentile {np.quantile(closed, 0.1):.3f}."
        )
    pairs = intervals(rows)
    if pairs:
        inside = np.mean([abs(error) < 1.96 * sigma for _, error, sigma in pairs])
        lines.append(
            f"True sizes inside their 95 % intervals: {100 * inside:.0f} % of {len(pairs)}."
        )
    for what, low, high in PART_BANDS:
        partial = [r for r in rows if r["set"] == "partial" and low <= r["part"] < high]
        if not partial:
            continue
        truth = [[(name, tuple(place)) for name, place in r["truth"]] for r in partial]
        named = [[(name, tuple(place)) for name, place in r["named"]] for r in partial]
        right = [true[0] in said for true, said in zip(truth, named, strict=True)]
        near = [all(abs(error) < 2 * sigma for _, error, sigma in intervals([r])) for r in partial]
        other = [
            any(one not in true for one in said) for true, said in zip(truth, named, strict=True)
        ]
        lines.append(
            f"Effects drawn as 15 to 50 % of their joint's gap, visible alone at {what}: named in {sum(right)} of {len(partial)}, with the size within two "
            f"standard errors in {sum(a and b for a, b in zip(right, near, strict=True))}; a stand-in in {sum(other)}."
        )
    if replays:
        ratio = np.array([after / before for before, after in replays])
        lines.append(
            f"Position error of the replay in PyBullet, after over before, {len(ratio)} of them: median {np.median(ratio):.2f}; "
            f"it shrinks in {np.sum(ratio < 1)}."
        )
    return lines


def misses(rows):
    lines = [
        "Cases that were not exact:",
        "",
        "| set | hidden | visible | named | verdict |",
        "|---|---|---|---|---|",
    ]
    for r in rows:
        if outcome(r) != "exact":
            text = (
                ", ".join(f"{n} on joint {j + 1}" for n, j in r["hidden"])
                if r["size"]
                else "nothing"
            )
            text += f" ({r['extra']})" if r["extra"] != "plain" else ""
            said = ", ".join(f"{n} {'-'.join(str(j + 1) for j in p)}" for n, p in r["named"]) or "-"
            lines.append(f"| {r['set']} | {text} | {r['visible']:.2f} | {said} | {r['verdict']} |")
    return lines


def order():
    """Mix the sets: of every 20 cases six single, three with crude priors, two of most others, one messy."""
    count = dict.fromkeys(SETS, 0)
    mix = (
        "single clean crude double single changed outside counterbalance single crude "
        "single clean single double crude changed outside counterbalance single messy"
    )
    while True:
        for name in mix.split():
            yield name, count[name]
            count[name] += 1


def line(row):
    return (
        f"{row['set']:8} {row['k']:3} {row['hidden']} {row['extra']} visible {row['visible']:.2f} -> {row['named']} {row['verdict']} "
        f"[{outcome(row)}] {row['closest']} {row['seconds']:.1f} s"
    )


def main():
    parser = parser_of(__doc__, "gap_blind.json", 90.0, 500)
    parser.add_argument("--only", choices=SETS)
    args = parser.parse_args()
    cases = ((args.only, k) for k in range(args.cases)) if args.only else order()
    run_cases(args, cases, run, line, table)


if __name__ == "__main__":
    main()
