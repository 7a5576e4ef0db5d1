"""How much an identification depends on choices about the signals: the table of ``dynid identify --explain``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.cli.log_options import reading_of, stacked_again
from dynid.cli.options import Common

if TYPE_CHECKING:
    from dynid.estimation.result import Identification
    from dynid.model.store import BaseModel

#: Cut-offs that are tried, times the chosen one.
CUTOFFS = (0.5, 2.0)
#: A change by more standard errors than this is more than noise explains.
BEYOND = 2.0


def variants(cutoff: float, header: dict[str, Any]) -> list[tuple[str, float, float]]:
    """Return what is tried: its name, cut-off [Hz], delay [s]."""
    applied = float(header.get("delay_applied_s") or 0.0)
    other = 0.0 if applied else float(header.get("delay_s") or 0.0)
    tried = [(f"cut-off {factor * cutoff:.3g} Hz", factor * cutoff, applied) for factor in CUTOFFS]
    return tried if other == applied else [*tried, (f"delay {1e3 * other:.1f} ms", cutoff, other)]


def explain(
    common: Common,
    base: BaseModel,
    logs: Sequence[Path],
    options: dict[str, Any],
    found: Identification,
    header: dict[str, Any],
) -> list[dict[str, Any]]:
    """Identify again with other cut-offs and another delay, print what changes, and return it for JSON."""
    import numpy as np

    from dynid.errors import DynidError
    from dynid.estimation.estimate import estimate, last_share

    answer: list[dict[str, Any]] = []
    sure = np.isfinite(found.std_error) & (found.std_error > 0)
    for name, cutoff, delay in variants(float(header["cutoff_hz"]), header):
        reading = reading_of({**options, "cutoff": repr(cutoff), "delay": repr(delay)})
        try:
            stack = stacked_again(base, logs, reading)
            other = estimate(stack, base, method=found.method, holdout=last_share(stack, 0.2), drop_weak=True)
        except DynidError as error:
            common.terminal.detail("explain", f"{name}: {error}")
            continue
        change = np.zeros(len(found.names))
        change[sure] = (other.plain - found.plain)[sure] / found.std_error[sure]
        worst = int(np.argmax(np.abs(change)))
        answer.append(
            {
                "variant": name,
                "cutoff_hz": cutoff,
                "delay_s": delay,
                "relative_error_percent": other.relative_error_percent,
                "heldout_relative_error_percent": other.heldout_relative_error_percent,
                "beyond_two_std_errors": int(np.sum(np.abs(change) > BEYOND)),
                "most_changed": found.names[worst],
                "before": float(found.plain[worst]),
                "after": float(other.plain[worst]),
                "std_errors": float(change[worst]),
            }
        )
    rows = [
        [
            row["variant"],
            f"{row['relative_error_percent']:.2f} %",
            f"{row['heldout_relative_error_percent']:.2f} %",
            f"{row['beyond_two_std_errors']} of {len(found.names)}",
            f"{row['most_changed']} {row['before']:.3g} -> {row['after']:.3g} ({row['std_errors']:+.1f} std errors)",
        ]
        for row in answer
    ]
    common.terminal.answer()
    common.terminal.table(["instead", "unexplained", "held out", "beyond 2 std errors", "most changed"], rows)
    return answer
