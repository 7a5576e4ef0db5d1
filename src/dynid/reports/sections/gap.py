"""The gap between arm and model: where it is, what ``dynid gap`` named, held-out error before and after."""

from __future__ import annotations

from typing import Any

from dynid.gap.held_out import HeldOutEffect
from dynid.gap.record import GapEffect, GapRecord
from dynid.model.effects.catalogue import CATALOGUE
from dynid.reports.gap_figures import (
    effect_figure,
    improvement_figure,
    residual_figure,
    simulator_figure,
)
from dynid.reports.gathered import Gathered
from dynid.reports.svg import Picture, drawn
from dynid.text import shell

VERDICTS = {
    "named": "a missing effect was found and named",
    "nothing_changed": "nothing has changed since the model was identified",
    "nothing_missing": "nothing is missing: every joint is at its noise",
    "unexplained": "something is missing, and no effect of the catalogue explains it",
    "ambiguous": "several effects explain it equally well",
}


def gap(gathered: Gathered) -> dict[str, Any]:
    """Return what gap.npz says, nothing when the search was not run."""
    record = gathered.gap
    if record is None:
        return {"gap": None, "search": f"{shell('dynid', 'gap', gathered.result.path)} LOG"}
    return {
        "gap": record,
        "verdict": VERDICTS.get(record.verdict, record.verdict),
        "rows": [_row(one) for one in (*record.named, *record.closest)],
        "alternatives": [" or ".join(group) for group in record.alternatives],
        "pictures": [*_pictures(record), *_driven(gathered)],
    }


def _driven(gathered: Gathered) -> list[Picture]:
    found = gathered.driven
    if found is None:
        return []
    said = f"{found.engine}: simulated less measured position of each joint, {' and '.join(found.models)}"
    return [
        Picture(
            drawn(lambda: simulator_figure(found), said),
            f"{found.sentence()} The exported files are driven by the measured torques and one soft controller.",
            "A line after that is no nearer to zero: what was added does not move the arm like that.",
        )
    ]


def _row(one: GapEffect) -> dict[str, Any]:
    """Return one candidate as the words of a row."""
    before, after = one.rms_before, one.rms_after
    change = f"{before:.3g} {one.unit}"
    if before and after is not None:
        change = f"{before:.3g} → {after:.3g} {one.unit}, {100 * (after / before - 1):+.0f} %"
    return {
        "effect": CATALOGUE[one.effect].title if one.effect in CATALOGUE else one.effect,
        "joints": ", ".join(one.joints),
        "change": change.replace("-", "\N{MINUS SIGN}"),
        "chance": "< 0.1 %" if one.p_value < 1e-3 else f"{100 * one.p_value:.1f} %",
        "numbers": ", ".join(text.replace("+-", "±") for text in one.texts()),
        "message": one.message,
    }


def _pictures(record: GapRecord) -> list[Picture]:
    effects = [_effect(one, curve) for one, curve in record.drawn()]
    return [
        *effects,
        Picture(
            drawn(
                lambda: improvement_figure(
                    record.improvement, record.joint_names, record.torque_units, ""
                ),
                "held-out error of each joint before and after the missing effects, with the noise",
            ),
            "Each joint's error on torque that was not fitted, without and with the named effects; line: the noise.",
            "A bar after that is still far right of the noise: something else is missing there.",
        ),
        Picture(
            drawn(
                lambda: residual_figure(record.joints, record.joint_names, ""),
                "residual power over noise power of each joint, by speed, position, load, time and reversal",
            ),
            "Residual power over noise power in each part of the motion before anything was added; 1 is the noise.",
            "Above 1.25 something is missing; 10 and more, and the joint is badly modelled there.",
        ),
    ]


def _effect(one: GapEffect, curve: HeldOutEffect) -> Picture:
    """Return the picture of a named effect."""
    return Picture(
        drawn(
            lambda: effect_figure(one, curve, ""),
            f"unseen data without and with {one.effect} on {one.where}, and its curve",
        ),
        f"{CATALOGUE[one.effect].title} on {one.where}. Above: the error on unseen data "
        "without and with the effect. Below: the torque that is left for it, and its curve.",
        "A curve that misses the dots: the effect may be right, but its shape is not.",
    )
