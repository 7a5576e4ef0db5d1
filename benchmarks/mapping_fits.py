"""What a fit shows of a mistake in the robot file: when must ``identify`` ask whether the file is wrong?

Usage: python benchmarks/mapping_fits.py [--every N] [--pairs N] [--only NAME] [--seed N]; the table is in mapping.md.
"""

import argparse
from statistics import median

import numpy as np

import mapping
from dynid.diagnose.diagnosis import diagnose
from dynid.diagnose.fit import judge_of
from dynid.diagnose.mistakes import Edit, with_edits
from dynid.errors import DynidError
from dynid.workflows import logs
from dynid.workflows.identify import identify
from dynid.workflows.logs import checked_log

SHARES = (0.025, 0.05, 0.1, 0.2)


def facts(robot, log):
    """Return whether a log accuses its robot file, what a fit leaves of a joint at most, and whether no arm is so."""
    checked = checked_log(log, robot)
    try:
        accused = diagnose(checked, robot, anyway=True) != ()
    except DynidError:
        accused = True
    found = identify(robot, checked)
    left = np.linalg.norm(found.factors @ np.append(found.plain, -1.0), axis=1)
    impossible = bool({"W404", "W405"} & {finding.code for finding in found.findings})
    size = np.maximum(np.linalg.norm(found.factors[:, :, -1], axis=1), 1e-300)
    return accused, float(np.max(left / size)), impossible


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument(
        "--every", type=int, default=5, help="every how manyth single mistake is tried"
    )
    parser.add_argument("--pairs", type=int, default=2)
    parser.add_argument("--seed", type=int, default=7, help="of simulated arms and motions")
    parser.add_argument("--only", default="", help="part of a robot's or recording's name")
    given = parser.parse_args()
    logs.poor = lambda *_: False  # so that a fit is made of every mistake
    rows = []
    for k, (name, shown, source) in enumerate(mapping.recordings(given.seed)):
        if given.only not in name + shown:
            continue
        robot, log = mapping.loaded(name, source)
        robot = with_edits(robot, [Edit("sign", (0.0,))] * 2)
        judge = judge_of(mapping.driver_columns(log, robot)[0], robot)
        for edits in [(), *mapping.mistakes(judge, robot.log_names, given.every, given.pairs, k)]:
            try:
                rows.append(
                    (
                        "right file" if not edits else "pair" if len(edits) > 1 else edits[0].kind,
                        *facts(with_edits(robot, edits), log),
                    )
                )
            except (
                DynidError
            ):  # degrees, torques of another unit, joints that stand still: found while reading
                continue
    columns = (
        "at least %",
        "median %",
        "no arm is so",
        *(f"not asked at {100 * share:g} %" for share in SHARES),
    )
    print("| mistake | cases |", " | ".join(columns), "|\n" + "| --- " * (len(columns) + 2) + "|")
    for kind in sorted({row[0] for row in rows}):
        of_kind = [row for row in rows if row[0] == kind]
        line(kind, [row for row in of_kind if row[1]])
        line(f"{kind}, not accused", [row for row in of_kind if not row[1]])


def line(kind, rows):
    """Print one row of the table."""
    if rows:
        left = [row[2] for row in rows]
        missed = [
            sum(each <= share and not impossible for _, _, each, impossible in rows)
            for share in SHARES
        ]
        print(
            f"| {kind} | {len(rows)} | {100 * min(left):.1f} | {100 * median(left):.0f} |",
            sum(row[3] for row in rows),
            "|",
            " | ".join(map(str, missed)),
            "|",
        )


if __name__ == "__main__":
    main()
