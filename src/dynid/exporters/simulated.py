"""Where each effect goes in a simulator: the numbers of a file, or effects.py beside it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from dynid.exporters.formulas import Column, columns_of, phrase, without_torque
from dynid.exporters.full_model import FullModel, lifted
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
        columns: columns of effects.py with their sizes.
        arm_effects: effects of effects.py that act on the torques of all joints.
    """

    full: FullModel
    left: tuple[str, ...]
    numbers: tuple[str, ...]
    columns: Sequence[tuple[Column, float]]
    arm_effects: Sequence[Added]

    @property
    def effects(self) -> list[str]:
        """The effects of effects.py, one phrase each."""
        names = self.full.robot.joint_names
        added = [*self.arm_effects, *(column.added for column, _ in self.columns)]
        return list(dict.fromkeys(phrase(one, names) for one in added))

    @property
    def left_out(self) -> tuple[str, ...]:
        """What a simulator's file has no place for beyond the numbers of joints, one phrase each."""
        return (*(f"effect {phrase}" for phrase in self.effects), *self.left)

    def in_effects_file(self, *, mjcf: bool) -> list[str]:
        """Return all that effects.py adds to an MJCF, or to a URDF, one phrase each."""
        offsets = ["torque offsets fo"] * any(self.full.of_joints("fo"))
        rotors = ["rotor inertia"] * (not mjcf and any(self.full.of_joints("Im")))
        return [*self.effects, *offsets, *rotors]


def simulated(arm: IdentifiedArm) -> Simulated:
    """Return where each effect of an arm goes."""
    names, bodies, drives = arm.robot.joint_names, list(arm.full.bodies), dict(arm.full.drives)
    in_numbers, arm_effects, columns = [], [], list[tuple[Column, float]]()
    for added in arm.base.model.added:
        target, sizes = added.effect.more_of, arm.full.values(added.names).tolist()
        if target:
            in_numbers.append(f"{phrase(added, names)}: {NUMBERS[target]}")
        if target == "body":
            more = np.pad(sizes, (0, 10 - len(sizes)))
            bodies[-1] = body_of(lifted(bodies[-1].parameters() + more))
        elif target:
            key = f"{target}{added.joints[0] + 1}"
            drives[key] = drives.get(key, 0.0) + sizes[0]
        elif not added.effect.left_out:
            forms = columns_of(added)
            columns += zip(forms, sizes, strict=False)
            arm_effects += [added] * (not forms)
    return Simulated(
        full=replace(arm.full, bodies=tuple(bodies), drives=drives),
        left=(
            *(f"coupled motors' {name}" for name in drives if name[:3] in ("Imc", "fvc", "fcc")),
            *without_torque(arm.robot),
            *[RESIDUAL] * (arm.model_error is not None),
        ),
        numbers=tuple(in_numbers),
        columns=columns,
        arm_effects=arm_effects,
    )


def numbers_of(arm: IdentifiedArm, *kinds: str) -> dict[str, float]:
    """Return the parameters by name of bodies, and of joints' numbers of these kinds, such as ``fv``, with effects."""
    known = arm.full.by_name
    names = [name for name in known if name.rstrip("0123456789") in (*BODY_PARAMETERS, *kinds)]
    for added in arm.base.model.added:
        if added.effect.more_of in ("body", *kinds):
            names += added.names
    return {name: known.get(name, 0.0) for name in names}
