"""``dynid gap --self-test``: the confusion table of the search on a simulated arm."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from dynid.cli.options import Common
from dynid.errors import ExitStatus

if TYPE_CHECKING:
    from dynid.workflows.demo import SelfTestCase


def run_self_test(common: Common) -> ExitStatus:
    """Hide effects in a simulated arm one by one and print what is named."""
    from dynid.workflows.demo import ROBOT, self_test_gap

    with common.terminal.progress() as progress:
        cases = list(self_test_gap(common.seed, common.folder(ROBOT), progress))
    rows = [
        [
            f"{c.hidden.name} on joint {c.hidden.joint + 1}" if c.hidden.size else "nothing",
            said(c),
            c.verdict,
            "yes" if c.right else "NO",
        ]
        for c in cases
    ]
    common.terminal.table(["hidden", "named", "verdict", "right"], rows, numbers=False)
    correct = sum(c.right for c in cases)
    common.terminal.answer(f"{correct} of {len(cases)} right")
    common.terminal.emit_json(
        {
            "schema": "dynid/gap-self-test/1",
            "seed": common.seed,
            "cases": [case_answer(c) for c in cases],
            "right": correct,
        }
    )
    false_names = [c for c in cases if c.hidden.name == "nothing" and c.named]
    return ExitStatus.LIMIT_NOT_MET if false_names else ExitStatus.DONE


def case_answer(case: SelfTestCase) -> dict[str, Any]:
    """Return one case for the JSON answer."""
    return {
        "hidden": case.hidden.name,
        "joint": case.hidden.joint + 1,
        "size": case.hidden.size,
        "verdict": case.verdict,
        "named": [{"effect": name, "joints": [j + 1 for j in place]} for name, place in case.named],
        "right": case.right,
    }


def said(case: SelfTestCase) -> str:
    """Return what was named, in words."""
    return (
        ", ".join(
            f"{name} on {'joint ' + str(place[0] + 1) if place else 'the arm'}"
            for name, place in case.named
        )
        or "-"
    )
