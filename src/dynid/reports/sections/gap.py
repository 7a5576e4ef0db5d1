"""The gap between arm and model: where it is, what ``dynid gap`` named, held-out error before and after."""

from __future__ import annotations

from typing import Any

from dynid.model.effects.catalogue import CATALOGUE
from dynid.reports.evidence import Evidence
from dynid.reports.gap_figures import improvement_figure, where_figure
from dynid.reports.gap_record import GapRecord
from dynid.reports.sections.interface import Picture
from dynid.reports.svg import drawn
from dynid.text import shell

VERDICTS = {
    "named": "a missing effect was found and named",
    "nothing_missing": "nothing is missing: what is left is noise",
    "unexplained": "something is missing that no effect of the catalogue explains",
    "ambiguous": "several effects explain it equally well",
}


def gap(evidence: Evidence) -> dict[str, Any]:
    """Return what gap.npz says, nothing when the search was not run."""
    record = evidence.gap
    if record is None:
        return {"gap": None, "search": f"{shell('dynid', 'gap', evidence.stored.path)} LOG"}
    units = {joint.name: joint.torque_unit for joint in evidence.robot.joints}
    answer = record.answer
    named = [(one, "named") for one in answer.get("named", ())]
    others = [(one, one.get("why_not", "")) for one in answer.get("closest", ())]
    return {
        "gap": record,
        "verdict": VERDICTS.get(answer["verdict"], answer["verdict"]),
        "rows": [_row(one, said, units) for one, said in (*named, *others)],
        "alternatives": [" or ".join(group) for group in answer.get("alternatives", ())],
        "pictures": _pictures(record, units),
    }


def _row(one: dict[str, Any], said: str, units: dict[str, str]) -> dict[str, Any]:
    """Return one candidate as the words of a row."""
    before, after = one["heldout_rms_before_nm"], one["heldout_rms_after_nm"]
    unit = units.get(one["joints"][0], "")
    change = f"{before:.3g} → {after:.3g} {unit}, {100 * (after / before - 1):+.0f} %" if before else "-"
    chance = one["p_value"]
    return {
        "effect": CATALOGUE[one["effect"]].title if one["effect"] in CATALOGUE else one["effect"],
        "joints": ", ".join(one["joints"]),
        "change": change.replace("-", "\N{MINUS SIGN}"),
        "chance": "< 0.1 %" if chance < 1e-3 else f"{100 * chance:.1f} %",
        "numbers": ", ".join(_number(name, value) for name, value in one["parameters"].items()),
        "said": said or "-",
    }


def _number(name: str, value: dict[str, Any]) -> str:
    error = "" if value["std_error"] is None else f" ± {value['std_error']:.2g}"
    return f"{name} = {value['value']:.4g}{error} {value['unit']}".strip()


def _pictures(record: GapRecord, units: dict[str, str]) -> list[Picture]:
    joints = list(units)
    return [
        Picture(
            drawn(
                "gap-shrink",
                lambda: improvement_figure(record.improvement, joints, list(units.values()), ""),
                "held-out error of each joint before and after the missing effects, with the noise",
            ),
            "Each joint's error on torque that was not fitted, without and with the named effects; line: the noise.",
            "A bar after that is still far right of the noise: something else is missing there.",
        ),
        Picture(
            drawn(
                "gap-where",
                lambda: where_figure(record.where, joints, ""),
                "residual power over noise power of each joint, by speed, position, load, time, direction and reversal",
            ),
            "Residual power over noise power in each part of the motion before anything was added; 1 is the noise.",
            "Above 1.25 something is missing; 10 and more, and the joint is badly modelled there.",
        ),
    ]
