"""The next experiment of ``dynid gap``: does one recording of the planned motion tell apart what the first logs could not?

    python benchmarks/gap_next.py --out gap_next.json [--seed 1] [--minutes 30] [--table benchmarks/gap_next.md]

One effect is hidden and two poor logs are searched: one motion, small and driven twice. Where two explanations fit
equally well, ``dynid trajectory --for-gap`` plans a motion of 20 s at full speed, the hidden arm drives it once, and all
logs are searched again; beside it, for comparison, another motion of the generator of the same length.
"""

import time
from itertools import count

import numpy as np

import gap_blind as blind
import hidden_effects as hidden
from dynid.gap.analysis import analyse_gap
from dynid.gap.record import record_of
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.trajectory.options import PlanOptions
from dynid.workflows.trajectory import plan_trajectory
from resumable import parser_of, run_cases

#: What is mistaken for something else when a motion is poor: drag of a neighbour when both neighbours move in step, and
#: a function of place when the travel is small.
KINDS = ("joint_coupling", "spring", "joint_coupling", "end_stop")
SECONDS = 20.0


def draw(k, seed):
    """Return a case, how small its first motion is, and a joint whose neighbours move in step, if any do."""
    rng = np.random.default_rng([k, 99, seed])
    arm = "lwr4plus" if rng.random() < 0.6 else "kinova_gen2"
    case = hidden.Case(
        arm,
        KINDS[k % len(KINDS)],
        int(rng.choice(blind.JOINTS)),
        float(np.exp(rng.uniform(0.3, 1.3))),
        70_000 + 17 * k + 1_000_003 * seed,
    )
    dragged = case.effect == "joint_coupling"
    return case, 1.0 if dragged else float(rng.uniform(0.08, 0.2)), case.joint if dragged else None


def look(case, base, **options):
    logs = hidden.simulate(case, trajectories=1, repeats=2, seconds=SECONDS, **options)
    return analyse_gap(
        blind.sources_of(logs, base.model), base, None, SelectionOptions(), simulate=False
    )


def said(seen):
    return {
        "verdict": seen.verdict.word,
        "named": [[f.name, list(f.joints)] for f in seen.verdict.named],
        "equals": [[[name, list(place)] for name, place in f.rivals] for f in seen.verdict.named],
    }


def run(_, k, seed):
    case, shrink, between = draw(k, seed)
    poor = {"shrink": shrink, "in_step": between}
    base = blind.model_of(case.arm)
    first = look(case, base, **poor)
    row = {
        "k": k,
        "seed": seed,
        "arm": case.arm,
        "truth": blind.truth_of([case], base.robot.n),
        "size": case.size,
        "first": said(first),
    }
    if first.verdict.word != "ambiguous":
        return row
    start = time.process_time()
    options = PlanOptions(
        alpha=1.0, duration=SECONDS, segments=6, seed=seed, restarts=3, seconds=120.0, floor=None
    )
    plan = plan_trajectory(
        base.robot, options, base=base, for_gap=record_of(first, base.robot, "numbers", "", "")
    )
    row |= {"outlook": list(plan.outlook), "seconds": time.process_time() - start}
    arm = hidden.load_arm(case.arm)
    sines = hidden.sines(arm, SECONDS, np.random.default_rng(case.seed + 5))

    def planned(t):
        found = plan.trajectory.motion(t)
        return found.q, found.qd, found.qdd

    def usual(t):
        return hidden.motion(arm, sines, t, np.random.default_rng(0), 0.0)

    for name, motion in (("second", planned), ("usual", usual)):
        row[name] = said(look(case, base, **poor, further=(SECONDS, motion)))
    return row


def outcome(row, which):
    """Return whether a search named the truth alone, the truth among equals, something else, or nothing."""
    found = row[which]
    truth, named = (
        [(name, tuple(place)) for name, place in some] for some in (row["truth"], found["named"])
    )
    if found["verdict"] == "ambiguous":
        groups = [[one, *more] for one, more in zip(found["named"], found["equals"], strict=True)]
        right = any((name, tuple(place)) in truth for group in groups for name, place in group)
        return "still alike" if right else "wrong"
    return "resolved" if named == truth else "nothing named" if not named else "wrong"


def table(rows):
    open_ = [r for r in rows if "second" in r]
    fair = [r for r in open_ if outcome(r, "first") == "still alike"]
    lines = [
        f"{len(rows)} cases; {len(open_)} ambiguous after the first logs, the truth among the equals in {len(fair)} of them.",
        "",
    ]
    lines += [
        "| second recording | resolved | still alike | nothing named | wrong |",
        "|---" * 5 + "|",
    ]
    for which, name in (
        ("second", "planned with `--for-gap`"),
        ("usual", "another motion as the first, full size"),
    ):
        counts = [
            sum(outcome(r, which) == word for r in fair)
            for word in ("resolved", "still alike", "nothing named", "wrong")
        ]
        lines.append(f"| {name} | {' | '.join(map(str, counts))} |")
    if open_:
        lines += [
            "",
            f"Processor time to plan: median {np.median([r['seconds'] for r in open_]):.0f} s.",
            "",
        ]
    lines += ["| hidden | first | planned | usual | outlook |", "|---|---|---|---|---|"]
    for r in open_:
        texts = [
            ", ".join(f"{n} {'-'.join(str(j + 1) for j in p)}" for n, p in r[w]["named"]) or "-"
            for w in ("first", "second", "usual")
        ]
        name, place = r["truth"][0]
        words = [
            f"{text} ({outcome(r, w)})"
            for text, w in zip(texts, ("first", "second", "usual"), strict=True)
        ]
        lines.append(
            f"| {name} {'-'.join(str(j + 1) for j in place)} | {' | '.join(words)} | {'; '.join(r['outlook'])} |"
        )
    return "\n".join(lines)


def line(row):
    told = {w: (row[w]["named"], outcome(row, w)) for w in ("first", "second", "usual") if w in row}
    return f"{row['k']} {row['truth']} {row['size']:.1f} {told} {row.get('outlook', '')}"


def main():
    parser = parser_of(__doc__, "gap_next.json", 30.0, 200)
    parser.add_argument("--ambiguous", type=int, default=20, help="end when so many were ambiguous")
    args = parser.parse_args()
    run_cases(
        args,
        (("", k) for k in count()),
        run,
        line,
        table,
        lambda rows: sum("second" in r for r in rows) >= args.ambiguous,
    )


if __name__ == "__main__":
    main()
