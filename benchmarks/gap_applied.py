"""What ``dynid gap --apply`` is worth on real recordings that neither the model nor the search has seen.

PYTHONPATH=src python benchmarks/gap_applied.py ../shared/data [LWR4+ ...]

Model and search on some recordings, or the first part of one; errors on the others, before and after what is named is
applied. Prints the rows of the table in docs/explanation/gap-search.md. The recordings are not part of the project.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np

from dynid import IdentifyOptions, find_gap, identify, validate
from dynid.workflows.validate import ValidateOptions
from real_arms import Pair, pairs

ALONE = ValidateOptions(residual_model=False)


def lines(pair: Pair) -> list[str]:
    """Return the rows of one pair."""
    before = identify(pair.robot, pair.fitted, IdentifyOptions(holdout=None))
    gap = find_gap(before, list(pair.fitted))
    if not gap.named:
        return [f"| {pair.name} | nothing: {gap.verdict_text} |"]
    after, found = gap.apply(), []
    joints = {j for one in gap.named for j in one.indices[:1]}
    for name, log in pair.unseen:
        seen, alone = (
            [validate(r, log, o) for r in (before, after)] for o in (ValidateOptions(), ALONE)
        )
        ratio = np.divide(*([joint.rms for joint in v.joints] for v in reversed(seen)))
        others = [r for j, r in enumerate(ratio) if j not in joints]
        own = ", ".join(f"{100 * (ratio[j] - 1):+.0f} %" for j in sorted(joints))
        totals = [
            " -> ".join(f"{v.relative_error_percent:.2f}" for v in both) for both in (seen, alone)
        ]
        named = ", ".join(f"{one.effect}, {one.where}" for one in gap.named)
        found.append(
            f"| {pair.name} | {named} | {name} | {' | '.join(totals)} | {own} | {100 * (max(others) - 1):+.0f} % |"
        )
    return found


def main() -> None:
    """Print the rows."""
    for pair in pairs(Path(sys.argv[1])):
        if not sys.argv[2:] or any(pair.name.startswith(word) for word in sys.argv[2:]):
            print("\n".join(lines(pair)), flush=True)


if __name__ == "__main__":
    main()
