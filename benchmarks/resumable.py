"""The loop that blind benchmarks share: case by case, kept in a JSON file, skipped when they are there already."""

import argparse
import json
import subprocess
import time
from pathlib import Path


def parser_of(description, out, minutes, cases):
    """Return a parser of what all of them take."""
    parser = argparse.ArgumentParser(
        description=description, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--out", type=Path, default=Path(out), help="where finished cases are kept")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--minutes", type=float, default=minutes)
    parser.add_argument(
        "--cases", type=int, default=cases, help="largest number of cases in the file"
    )
    parser.add_argument("--table", type=Path, help="where the table is written")
    return parser


def key_of(row):
    """Return what tells a case from the others of a benchmark."""
    return row.get("set", ""), row["k"], row["seed"]


def commit():
    """Return which code runs: its commit, with a plus where it was changed since."""
    asked = [
        "git",
        "-C",
        str(Path(__file__).parent),
        "describe",
        "--always",
        "--dirty=+",
        "--exclude=*",
    ]
    found = subprocess.run(asked, capture_output=True, text=True, check=False)
    return found.stdout.strip() or "unknown"


def run_cases(args, cases, run, line, table, enough=lambda rows: False):
    """Run cases until time, number or purpose are reached, and show the table of all that are there.

    Args:
        args: of ``parser_of``.
        cases: (set, number) one after the other; "" for the only set.
        run: a case to its row: set, number, seed.
        line: a row to what is shown while it runs.
        table: rows to text.
        enough: whether the rows that are there are enough.
    """
    rows = json.loads(args.out.read_text()) if args.out.exists() else []
    done = {key_of(row) for row in rows}
    end, code = time.monotonic() + 60 * args.minutes, commit()
    for name, k in cases:
        if time.monotonic() > end or len(rows) >= args.cases or enough(rows):
            break
        if (name, k, args.seed) not in done:
            rows.append(run(name, k, args.seed) | {"code": code})
            args.out.write_text(json.dumps(rows))
            print(line(rows[-1]), flush=True)
    print(table(rows))
    if args.table:
        args.table.write_text(table(rows) + "\n")
