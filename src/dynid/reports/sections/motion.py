"""What the motion could teach, measured beside predicted torque, and where the residual is."""

from __future__ import annotations

from typing import Any

from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.residual_model import GROUP_NAMES
from dynid.reports.figures import TORQUE, motion_figure
from dynid.reports.gathered import Gathered
from dynid.reports.section_figures import (
    AGAINST,
    coverage_figure,
    residual_figure,
    residual_model_figure,
    spectrum_figure,
)
from dynid.reports.svg import Picture, drawn
from dynid.text import shell


def excitation(gathered: Gathered) -> dict[str, Any]:
    """Return singular values of the stack, and how far each joint moved."""
    values, motion = gathered.singular_values, gathered.motion
    pictures = []
    if values is not None:
        pictures.append(
            Picture(
                drawn(
                    lambda: spectrum_figure(values),
                    "singular values of the stack with normalised columns",
                ),
                "Each dot is a combination of parameters; the further right, the less the motion shows it.",
                "Dots below the dashed line (1/1000): noise in those directions is amplified a thousandfold.",
            )
        )
    if motion is not None:
        pictures.append(
            Picture(
                drawn(
                    lambda: coverage_figure(motion, gathered.robot),
                    "range of positions and velocities of each joint, and its limits",
                ),
                "Blue is what the joint did, grey what its limits allow.",
                "A joint whose blue bar is short taught little: its inertia and friction come from few, small signals.",
            )
        )
    return {"pictures": pictures, "found": gathered.result, "size": len(gathered.result.names)}


def torque(gathered: Gathered) -> dict[str, Any]:
    """Return torques of the logs that were fitted, with the table of joints."""
    motion = gathered.motion
    pictures = [] if motion is None else [_torques(gathered, motion, "fitted logs")]
    units = [joint.torque_unit for joint in gathered.robot.joints]
    return {"pictures": pictures, "joints": list(zip(gathered.result.joints, units, strict=True))}


def unseen(gathered: Gathered) -> dict[str, Any]:
    """Return validations beside the result, else the rows that were held out."""
    shown = [
        (each, _torques(gathered, each.motion, f"unseen: {each.name}")) for each in gathered.unseen
    ]
    validate = f"{shell('dynid', 'validate', gathered.result.path)} LOG"
    return {
        "unseen": shown,
        "found": gathered.result,
        "joints": gathered.robot.joint_names,
        "validate": validate,
    }


def _torques(gathered: Gathered, motion: EstimatedMotion, title: str) -> Picture:
    return Picture(
        drawn(
            lambda: motion_figure(motion, gathered.robot, TORQUE, ""),
            f"measured and estimated torque of each joint, {title}",
        ),
        "Grey is measured, blue estimated, orange what is left, all on one scale per joint.",
        "Orange that follows a pattern (steps at reversals, waves) is an effect that the model misses, not noise.",
    )


def residual_model(gathered: Gathered) -> dict[str, Any]:
    """Return what the residual model holds of each joint's torque, table and picture; nothing where there is none."""
    found = gathered.result
    if found.model_error is None:
        return {"held": [], "holding": []}
    picture = Picture(
        drawn(
            lambda: residual_model_figure(found), "torque that the residual model holds, by joint"
        ),
        "Torque that position, friction of position and speed, and friction of the load add to the parameters' in "
        "predictions; the last bar is what is still left. URDF and the like hold the parameters alone.",
        "A joint whose residual model holds more than is left lacks an effect: dynid gap may name it.",
    )
    rows = []
    for joint, held in zip(found.joints, found.residual_table(), strict=True):
        parts = [f"{held[group]:.3g}" for group in (*GROUP_NAMES, "all")]
        rows.append({"joint": joint.joint, "parts": [*parts, f"{joint.rms:.3g}"]})
    return {"held": rows, "holding": [picture], "groups": [*GROUP_NAMES, "all", "left"]}


def residual(gathered: Gathered) -> dict[str, Any]:
    """Return averages of the residual over four quantities, one row per joint, and what the residual model holds."""
    motion = gathered.motion
    model = residual_model(gathered)
    if motion is None:
        return {"pictures": [], **model}
    one = Picture(
        drawn(
            lambda: residual_figure(motion, gathered.robot),
            f"mean and spread of the residual of each joint over {', '.join(AGAINST)}",
        ),
        "The line is the mean residual in a bin, the band one standard deviation; noise gives a flat line at zero.",
        "A step at zero velocity is friction, a wave over position gravity or a spring, "
        "a slope over load a gear or gain, a drift over time heat.",
    )
    return {"pictures": [one], **model}
