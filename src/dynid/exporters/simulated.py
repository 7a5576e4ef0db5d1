"""Where each effect goes in a simulator: the numbers of a file, springs of MuJoCo, or effects.py beside them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.exporters.engines import module
from dynid.exporters.formulas import Column, columns_of, phrase, without_torque
from dynid.exporters.full_model import FullModel, lifted, numbers
from dynid.exporters.interface import RESIDUAL, IdentifiedArm
from dynid.model.effects.catalogue import Added
from dynid.model.parameters import BODY_PARAMETERS, body_of

#: Where the numbers are that some effects are more of.
NUMBERS = {
    "fv": "viscous friction of its joint",
    "fc": "Coulomb friction of its joint",
    "fo": "offset of its joint",
    "Im": "rotor inertia of its joint",
    "body": "in the body of the last link",
}


@dataclass(frozen=True)
class Simulated:
    """An arm as simulators get it.

    Attributes:
        full: bodies, rotors and friction, with the effects that are more of such a number.
        left: what no file holds: coupled motors, effects with the reason, the residual model.
        numbers: effects that are in the numbers of every file, in words.
        springs: attributes that an MJCF has for the spring of a joint, by its number, 0-based.
        elements: these effects in words.
        columns: columns of effects.py with their sizes, and whether an MJCF has them as a spring.
        arm_effects: effects of effects.py that act on the torques of all joints.
    """

    full: FullModel
    left: tuple[str, ...]
    numbers: tuple[str, ...]
    springs: Mapping[int, Mapping[str, str]]
    elements: tuple[str, ...]
    columns: Sequence[tuple[Column, float, bool]]
    arm_effects: Sequence[Added]

    def effects_in_file(self, *, mjcf: bool) -> list[str]:
        """Return the effects that effects.py adds to an MJCF, or to a URDF, one phrase each."""
        names = self.full.robot.joint_names
        phrases = [phrase(one, names) for one in self.arm_effects]
        phrases += [
            f"{column.added.effect.name} on {names[column.joint]}"
            for column, _, native in self.columns
            if not (mjcf and native)
        ]
        return list(dict.fromkeys(phrases))

    def left_out(self, *, mjcf: bool) -> tuple[str, ...]:
        """Return what an MJCF, or a URDF, has no place for beyond the numbers of joints, one phrase each."""
        return (*(f"effect {phrase}" for phrase in self.effects_in_file(mjcf=mjcf)), *self.left)

    def in_effects_file(self, *, mjcf: bool) -> list[str]:
        """Return all that effects.py adds to an MJCF, or to a URDF, one phrase each."""
        offsets = ["torque offsets fo"] * any(self.full.of_joints("fo"))
        rotors = ["rotor inertia"] * (not mjcf and any(self.full.of_joints("Im")))
        return [*self.effects_in_file(mjcf=mjcf), *offsets, *rotors]


def simulated(arm: IdentifiedArm) -> Simulated:
    """Return where each effect of an arm goes."""
    names, bodies, drives = arm.robot.joint_names, list(arm.full.bodies), dict(arm.full.drives)
    in_numbers, elements, arm_effects = [], [], []
    springs = {}
    columns = []
    for added in arm.base.model.added:
        target, sizes = added.effect.more_of, arm.full.sizes(added)
        if target:
            in_numbers.append(f"{phrase(added, names)}: {NUMBERS[target]}")
        if target == "body":
            more = np.pad(sizes, (0, 10 - len(sizes)))
            bodies[-1] = body_of(lifted(bodies[-1].parameters() + more))
        elif target:
            key = f"{target}{added.joints[0] + 1}"
            drives[key] = drives.get(key, 0.0) + sizes[0]
        elif not added.effect.left_out:
            first = added.effect.name == "spring" and added.joints[0] not in springs
            if spring := _spring(added, sizes) if first else {}:
                springs[added.joints[0]] = spring
                elements.append(f"{phrase(added, names)}: stiffness and springref of its joint")
            forms = columns_of(added)
            columns += [(*one, bool(spring)) for one in zip(forms, sizes, strict=False)]
            arm_effects += [added] * (not forms)
    return Simulated(
        full=replace(arm.full, bodies=tuple(bodies), drives=drives),
        left=(
            *(f"coupled motors' {name}" for name in drives if name[:3] in ("Imc", "fvc", "fcc")),
            *without_torque(arm.robot),
            *[RESIDUAL] * (arm.model_error is not None),
        ),
        numbers=tuple(in_numbers),
        springs=springs,
        elements=tuple(elements),
        columns=columns,
        arm_effects=arm_effects,
    )


def numbers_of(arm: IdentifiedArm, *kinds: str) -> dict[str, float]:
    """Return the parameters by name of bodies, and of joints' numbers of these kinds, such as ``fv``, with effects."""
    known = arm.full.by_name
    names = [name for name in known if name.rstrip("0123456789") in (*BODY_PARAMETERS, *kinds)]
    for added in arm.base.model.added:
        if added.effect.more_of in ("body", *kinds):
            names += [column.parameter.name for column in added.columns]
    return {name: known.get(name, 0.0) for name in names}


def _spring(added: Added, sizes: list[float]) -> dict[str, str]:
    """Return a spring k1 (q - s) + k2 (q - s)^2 + k3 (q - s)^3; {} where no s is slack, or MuJoCo has it not."""
    order, engine = round(added.shape["order"]), module("mujoco")
    # Before its version 4 a spring was linear, and one of negative stiffness none.
    newest = engine is not None and int(engine.__version__.split(".")[0]) >= 4
    constant = sizes[order] if added.shape["constant"] else 0.0
    torque = np.polynomial.Polynomial([constant, *sizes[:order]])
    slack = [float(root.real) for root in torque.roots() if abs(root.imag) < 1e-12]
    if not slack:
        return {}
    nearest = min(slack, key=abs)
    stiffness = torque(np.polynomial.Polynomial([nearest, 1.0])).coef[1:]
    if not newest and (order > 1 or stiffness[0] <= 0.0):
        return {}
    return {"stiffness": numbers(stiffness), "springref": repr(nearest)}
