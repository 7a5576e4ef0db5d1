"""YAML: every number with its name, unit and origin, for people and for one's own programs."""

from __future__ import annotations

from typing import Any

from dynid.estimation.identified import body_facts
from dynid.exporters.interface import RESIDUAL, Format, IdentifiedArm
from dynid.robot import LINK_PARAMETERS
from dynid.text import yaml_text

#: What a table of links holds of a joint.
DH = ("type", "a", "twist", "d", "theta_offset")


def text(arm: IdentifiedArm) -> str:
    """Return the YAML."""
    return yaml_text(_document(arm), arm.head(str))


def _document(arm: IdentifiedArm) -> dict[str, Any]:
    full, robot, known = arm.full, arm.robot, arm.full.by_name
    links, of_links = [], set[str]()
    for i, (joint, body) in enumerate(zip(robot.joints, full.bodies, strict=True), start=1):
        names = [f"{name}{i}" for name in LINK_PARAMETERS]
        of_links.update(names)
        links.append(
            {
                "joint": joint.name,
                "dh": {key: getattr(joint, key) for key in DH},
                **body_facts(body.numbers),
                "rotor_inertia": known.get(f"Im{i}", 0.0),
                "parameters": {name: known.get(name, 0.0) for name in names},
                "origin": {name: full.origin.get(name, "prior") for name in names},
                "possible": i not in full.impossible_links(),
            }
        )
    return {
        "schema": "dynid/full/1",
        "robot": robot.name,
        "convention": robot.convention,
        "angles": "rad",
        "gravity_frame_0": robot.gravity,
        "links": links,
        "coulomb": robot.coulomb_shape.facts(),
        "friction": {name: value for name, value in full.drives.items() if name not in of_links},
        "base_parameters": dict(zip(arm.base.names, arm.theta.tolist(), strict=True)),
    }


def leaves_out(arm: IdentifiedArm) -> tuple[str, ...]:
    """Return the effects, which stay in the robot file, and the residual model."""
    effects = (
        f"effect {effect.effect} on {', '.join(effect.joints)}" for effect in arm.robot.effects
    )
    return (*effects, *[RESIDUAL] * (arm.model_error is not None))


YAML = Format("yaml", ".yaml", text, leaves_out, lambda text, arm: None, needs_bodies=False)
