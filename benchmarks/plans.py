"""A plan for every robot file: what keeping clear of itself and the floor costs each arm.

Run: python benchmarks/plans.py            the arms that benchmarks/plans.json lacks, then plans.md
     python benchmarks/plans.py ur10 ...   these arms anew
Each arm gets what ``dynid trajectory ARM --alpha 1 --preview picture`` gives, checks included; it makes five
starts. 60 s of two cores are 120 s of processor time, which depends little on what else the machine does. Then one start searches for
the same arm without floor, with links that may pass through each other, in its whole range. Compared is the expected rms
torque error on other motions, the same motions and noise for both.
"""

import os

os.environ.update(OPENBLAS_NUM_THREADS="1", OMP_NUM_THREADS="1", MKL_NUM_THREADS="1")

import resource
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import study
from dynid.errors import DynidError
from dynid.files.robotfile import known_robots, load_robot
from dynid.trajectory.optimise import optimise
from dynid.trajectory.options import PlanOptions
from dynid.trajectory.planning import plan_problem, planning_context, proposals
from dynid.trajectory.predict import predict
from dynid.trajectory.preview import Drawing
from dynid.workflows.model import base_model
from dynid.workflows.trajectory import plan_trajectory

HERE = Path(__file__).parent
STORE, TABLE = HERE / "plans.json", HERE / "plans.md"
#: No limit that a busy machine would meet, and processes for each search.
SECONDS, PROCESSES, STARTS = 3600.0, 1, 5
#: Processor time of 60 s of two cores [s].
BUDGET = 120.0
#: Times the error without obstacles that a plan may have.
WANTED = 1.5
HEADER = "arm | processor s | error N m | without obstacles | ratio | condition | nearest | always near | assumed"


def processor():
    """Return the processor time of this process and of its children that have ended [s]."""
    used = [resource.getrusage(who) for who in (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN)]
    return sum(one.ru_utime + one.ru_stime for one in used)


def unhindered(robot, options):
    """Return the expected torque error of a plan for an arm that nothing can collide with [N m]."""
    base = base_model(robot)
    context = planning_context(base, options)
    free = replace(plan_problem(context), capsules=None, narrow=None)
    # Why: torque limits hold for both; where the penalty on torques was not quite obeyed the motion is drawn in a little.
    free = replace(free, limits=context.limits)
    for one in proposals(context, optimise(free, options, options.seconds)):
        if not context.check(one.trajectory).violations:
            motion = one.trajectory.sampled(options.rate)
            found = predict(base, motion, context.noise, context.other)
            return found.torque_error
    return float("nan")


def measure(name):
    """Return the row of one arm."""
    robot = load_robot(name)
    options = PlanOptions(alpha=1.0, seconds=SECONDS, processes=PROCESSES, restarts=STARTS)
    base_model(robot)
    before = processor()
    row = {}
    with tempfile.TemporaryDirectory() as folder:
        drawing = Drawing(Path(folder) / "preview.png")
        try:
            plan = plan_trajectory(robot, options, drawing=drawing)
            answer = plan.facts()
            row |= {
                "error": answer["expected_torque_error_nm"],
                "condition": answer["condition_number_scaled"],
                "closest_m": answer["closest_m"],
                "closest": answer["closest"][0]["pair"] if answer["closest"] else "",
                "left_out": answer["left_out_pairs"],
                "assumed": answer["assumed_limits"],
            }
        except DynidError as error:
            row["refused"] = f"{error.code} {error.what}"
    row["processor"] = processor() - before
    row["unhindered"] = unhindered(robot, replace(options, restarts=1))
    return row


def cells(name, row):
    """Return the row of the table for one arm."""
    unhindered, spent = f"{row['unhindered']:.3g}", f"{row['processor']:.0f}"
    if "refused" in row:
        return [name, spent, f"none: {row['refused']}", unhindered, *[""] * 5]
    return [
        *(name, spent, f"{row['error']:.3g}", unhindered),
        f"{row['error'] / row['unhindered']:.2f}",
        f"{row['condition']:.0f}",
        f"{1000 * row['closest_m']:.0f} mm, {row['closest']}",
        ", ".join(row["left_out"]) or "none",
        ", ".join(sorted({text.split()[0] for text in row["assumed"]})) or "none",
    ]


def table(rows):
    """Return the page of all arms."""
    slow = [name for name, row in rows.items() if row["processor"] > BUDGET]
    held = [row for row in rows.values() if row.get("error", 1e9) <= WANTED * row["unhindered"]]
    missing = ", ".join(name for name in known_robots() if name not in rows)
    return f"""# Plans for all robot files

{__doc__.split(chr(10))[0]}

{len(held)} of {len(rows)} within {WANTED:g} times the error without obstacles; more than {BUDGET:g} s of processor: \
{", ".join(slow) or "none"}. {f"Not measured yet: {missing}. " if missing else ""}{study.MACHINE}.

{study.markdown(HEADER, [cells(name, row) for name, row in sorted(rows.items())])}
"""


def main():
    """Measure what is missing or named and write the table."""
    rows = study.Answers(STORE)
    for name in sys.argv[1:] or [name for name in known_robots() if name not in rows]:
        rows.keep(name, measure(name))
        print(*cells(name, rows[name]), flush=True)
        TABLE.write_text(table(rows))


if __name__ == "__main__":
    main()
