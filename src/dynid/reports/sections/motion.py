"""What the motion could teach, measured beside predicted torque, and where the residual is."""

from __future__ import annotations

from typing import Any

from dynid.estimation.prediction import EstimatedMotion
from dynid.estimation.residual_model import GROUP_NAMES
from dynid.reports.charts import (
    AGAINST,
    coverage_chart,
    residual_chart,
    residual_model_chart,
    spectrum_chart,
    torque_chart,
)
from dynid.reports.evidence import Evidence
from dynid.reports.svg import Picture
from dynid.text import shell


def excitation(evidence: Evidence) -> dict[str, Any]:
    """Return singular values of the stack, and how far each joint moved."""
    values, motion, robot = evidence.singular_values, evidence.motion, evidence.robot
    pictures = []
    if values is not None:
        label = "singular values of the stack with normalised columns"
        pictures.append(
            Picture(
                (spectrum_chart(values, label),),
                "Each dot is a combination of parameters; the further right, the less the motion shows it.",
                "Dots below the dashed line (1/1000): noise in those directions is amplified a thousandfold.",
            )
        )
    if motion is not None:
        label = "range of positions and velocities of each joint, and its limits"
        pictures.append(
            Picture(
                (coverage_chart(motion, robot, label),),
                "Blue is what the joint did, grey what its limits allow.",
                "A joint whose blue bar is short taught little: its inertia and friction come from few, small signals.",
            )
        )
    return {"pictures": pictures, "found": evidence.result, "size": len(evidence.result.names)}


def torque(evidence: Evidence) -> dict[str, Any]:
    """Return torques of the logs that were fitted, with the table of joints."""
    pictures = [] if evidence.motion is None else [_torques(evidence, evidence.motion, "fitted logs")]
    units = [joint.torque_unit for joint in evidence.robot.joints]
    return {"pictures": pictures, "joints": list(zip(evidence.result.joints, units, strict=True))}


def unseen(evidence: Evidence) -> dict[str, Any]:
    """Return validations beside the result, else the rows that were held out."""
    shown = [(each, _torques(evidence, each.motion, f"unseen: {each.name}")) for each in evidence.unseen]
    validate = f"{shell('dynid', 'validate', evidence.result.path)} LOG"
    return {"unseen": shown, "found": evidence.result, "joints": evidence.robot.joint_names, "validate": validate}


def _torques(evidence: Evidence, motion: EstimatedMotion, title: str) -> Picture:
    robot = evidence.robot
    return Picture(
        tuple(
            torque_chart(motion, robot, j, f"measured and estimated torque of {name}, {title}")
            for j, name in enumerate(robot.joint_names)
        ),
        "Grey is measured, blue estimated, orange what is left, all on one scale per joint.",
        "Orange that follows a pattern (steps at reversals, waves) is an effect that the model misses, not noise.",
    )


def residual_model(evidence: Evidence) -> dict[str, Any]:
    """Return what the residual model holds of each joint's torque, table and picture; nothing where there is none."""
    found = evidence.result
    if found.model_error is None:
        return {"held": [], "holding": []}
    picture = Picture(
        (residual_model_chart(found, "torque that the residual model holds, by joint"),),
        "Torque that position, friction of position and speed, and friction of the load add to the parameters' in "
        "predictions; the last bar is what is still left. URDF and the like hold the parameters alone.",
        "A joint whose residual model holds more than is left lacks an effect: dynid gap may name it.",
    )
    rows = []
    for joint, held in zip(found.joints, found.residual_table(), strict=True):
        parts = [f"{held[group]:.3g}" for group in (*GROUP_NAMES, "all")]
        rows.append({"joint": joint.joint, "parts": [*parts, f"{joint.rms:.3g}"]})
    return {"held": rows, "holding": [picture], "groups": [*GROUP_NAMES, "all", "left"]}


def residual(evidence: Evidence) -> dict[str, Any]:
    """Return averages of the residual over four quantities, one row per joint, and what the residual model holds."""
    motion, robot = evidence.motion, evidence.robot
    model = residual_model(evidence)
    if motion is None:
        return {"pictures": [], **model}
    one = Picture(
        tuple(
            residual_chart(motion, robot, against, f"mean and spread of the residual of each joint over {against}")
            for against in AGAINST
        ),
        "The line is the mean residual in a bin, the band one standard deviation; noise gives a flat line at zero.",
        "A step at zero velocity is friction, a wave over position gravity or a spring, "
        "a slope over load a gear or gain, a drift over time heat.",
        narrow=True,
    )
    return {"pictures": [one], **model}
