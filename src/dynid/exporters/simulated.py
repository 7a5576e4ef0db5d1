"""Where each effect goes in a simulator: the numbers of a file, MuJoCo's own elements, or effects.py beside them."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cache

import numpy as np
from numpy.typing import NDArray

from dynid.exporters import closed_forms
from dynid.exporters.closed_forms import Column, on_joints
from dynid.exporters.engines import module
from dynid.exporters.full_model import FullModel
from dynid.exporters.interface import IdentifiedArm
from dynid.model.effects.catalogue import Added
from dynid.model.parameters import body_of

Floats = NDArray[np.float64]

#: Effects that are more of a number that every simulator has; those of a joint by the number's name.
NUMBERS = {
    "viscous": "fv",
    "viscous_change": "fv",
    "coulomb": "fc",
    "coulomb_change": "fc",
    "torque_offset": "fo",
    "motor_inertia": "Im",
    "payload": "",
}
#: Where those are.
_IN_NUMBERS = {
    "fv": "viscous friction of its joint",
    "fc": "Coulomb friction of its joint",
    "fo": "offset of its joint",
    "Im": "rotor inertia of its joint",
    "": "in the body of the last link",
}
#: A wave whose number over a turn is nearer to a whole one than this is one.
WHOLE = 1e-9
#: An MJCF that only a MuJoCo with polynomial springs and passive motors reads.
_NEWEST = (
    '<mujoco><worldbody><body><inertial pos="0 0 0" mass="1" diaginertia="1 1 1"/>'
    '<joint name="j" stiffness="1 1 1"/></body></worldbody><actuator><dcmotor joint="j" input="none" resistance="1" '
    'motorconst="1e-9" cogging="1 1 0" lugre="1 0 1 1 1"/></actuator></mujoco>'
)


@cache
def newest_elements() -> bool:
    """Return whether the installed MuJoCo has springs of third order and passive motors with LuGre friction."""
    engine = module("mujoco")
    if engine is None:
        return False
    try:
        engine.MjModel.from_xml_string(_NEWEST)
    except ValueError:
        return False
    return True


@dataclass(frozen=True)
class Wave:
    """Cogging of a joint: amplitude sin(poles q + phase).

    Attributes:
        joint: 0-based.
        amplitude: [N m or N].
        poles: waves a turn.
        phase: [rad].
    """

    joint: int
    amplitude: float
    poles: int
    phase: float


@dataclass(frozen=True)
class Bristle:
    """Friction of a bristle that bends before it slides.

    Attributes:
        joint: 0-based.
        size: [N m or N].
        length: over which it bends [rad or m].
    """

    joint: int
    size: float
    length: float


@dataclass(frozen=True)
class Simulated:
    """An arm as simulators get it.

    Attributes:
        full: bodies, rotors and friction, with the effects that are more of such a number.
        springs: spring of a joint: stiffnesses of first to third order, and the position where it is slack.
        waves: cogging that MuJoCo has an element for.
        bristles: friction that MuJoCo has an element for.
        columns: columns of effects.py with their sizes, and whether an MJCF has an element for them.
        whole_arm: effects of effects.py that turn the torque of the whole arm.
        numbers: effects that are in the numbers of every file, in words.
        elements: effects that are elements of an MJCF, in words.
        left: effects that nothing holds, in words with the reason.
    """

    full: FullModel
    springs: dict[int, tuple[Floats, float]]
    waves: tuple[Wave, ...]
    bristles: tuple[Bristle, ...]
    columns: tuple[tuple[Column, float, bool], ...]
    whole_arm: tuple[Added, ...]
    numbers: tuple[str, ...]
    elements: tuple[str, ...]
    left: tuple[str, ...]

    def effects_beside(self, *, mjcf: bool, names: tuple[str, ...]) -> list[str]:
        """Return the effects that effects.py adds to a file, one phrase each.

        Args:
            mjcf: whether the file is an MJCF.
            names: the joints.
        """
        found = [f"{one.effect.name}{on_joints(one, names)}" for one in self.whole_arm]
        for column, _, native in self.columns:
            phrase = f"{_effect_of(column)} on {names[column.joint]}"
            if not (mjcf and native) and phrase not in found:
                found.append(phrase)
        return found

    def in_effects_file(self, *, mjcf: bool, names: tuple[str, ...]) -> list[str]:
        """Return all that effects.py adds to a file, one phrase each; arguments as for ``effects_beside``."""
        offsets = ["torque offsets fo"] if any(self.full.joint_friction("fo")) else []
        rotors = ["rotor inertia"] if not mjcf and any(self.full.rotor_inertia) else []
        return [*self.effects_beside(mjcf=mjcf, names=names), *offsets, *rotors]


def _effect_of(column: Column) -> str:
    """Return the identifier of the effect of a column's parameter, such as stribeck of stribeck4_a."""
    return column.name[: next(i for i, letter in enumerate(column.name) if letter.isdigit())]


def simulated(arm: IdentifiedArm) -> Simulated:
    """Return where each effect of an arm goes."""
    names = arm.robot.joint_names
    columns: list[tuple[Column, float, bool]] = []
    whole: list[Added] = []
    numbers: list[str] = []
    elements: list[str] = []
    springs: dict[int, tuple[Floats, float]] = {}
    waves: list[Wave] = []
    bristles: list[Bristle] = []
    full = _with_numbers(arm)
    newest = newest_elements()
    for added in arm.base.model.added:
        name = added.effect.name
        sizes = [
            float(arm.full.friction.get(column.parameter.name, 0.0)) for column in added.columns
        ]
        if name in NUMBERS:
            numbers.append(f"{name}{on_joints(added, names)}: {_IN_NUMBERS[NUMBERS[name]]}")
            continue
        forms = closed_forms.columns_of(added)
        if forms is None:
            whole += [added] if name in closed_forms.WHOLE_ARM else []
            continue
        joint, native = added.joints[0], ""
        if (
            name == "spring"
            and joint not in springs
            and (spring := _spring(added, sizes, newest)) is not None
        ):
            springs[joint], native = spring, "stiffness and springref of its joint"
        elif newest and (wave := _wave(added, sizes)) is not None:
            waves.append(wave)
            native = "cogging of a passive dcmotor"
        elif (
            newest and name == "presliding_hysteresis" and _slides(full, joint, sizes[0], bristles)
        ):
            bristles.append(Bristle(joint, sizes[0], added.shape["delta"]))
            native = "lugre of a passive dcmotor, and as much less frictionloss"
        if native:
            elements.append(f"{name}{on_joints(added, names)}: {native}")
        columns += [(form, size, bool(native)) for form, size in zip(forms, sizes, strict=True)]
    left = closed_forms.without_torque(arm.robot)
    motors = tuple(waves), tuple(bristles)
    return Simulated(
        full, springs, *motors, tuple(columns), tuple(whole), tuple(numbers), tuple(elements), left
    )


def _with_numbers(arm: IdentifiedArm) -> FullModel:
    """Return bodies, rotors and friction with the effects that are more of them."""
    full, bodies = arm.full, list(arm.full.bodies)
    rotors, friction = list(full.rotor_inertia), dict(full.friction)
    for added in arm.base.model.added:
        target = NUMBERS.get(added.effect.name)
        for column in added.columns if target is not None else ():
            size = friction.get(column.parameter.name, 0.0)
            if target == "Im":
                rotors[added.joints[0]] += size
            elif target:
                key = f"{target}{added.joints[0] + 1}"
                friction[key] = friction.get(key, 0.0) + size
        if target == "":
            more = np.zeros(10)
            more[: len(added.columns)] = [
                friction.get(column.parameter.name, 0.0) for column in added.columns
            ]
            bodies[-1] = body_of(bodies[-1].parameters() + more)
    return replace(full, bodies=tuple(bodies), rotor_inertia=tuple(rotors), friction=friction)


def _spring(added: Added, sizes: list[float], newest: bool) -> tuple[Floats, float] | None:
    """Return a spring k1 (q - s) + k2 (q - s)^2 + k3 (q - s)^3, and s; None where there is none."""
    order = round(added.shape["order"])
    polynomial = np.polynomial.Polynomial(
        [sizes[order] if added.shape["constant"] else 0.0, *sizes[:order]]
    )
    roots = [float(root.real) for root in polynomial.roots() if abs(root.imag) < 1e-12]
    if not roots or (order > 1 and not newest):
        return None
    slack = min(roots, key=abs)
    slopes = [
        float(polynomial.deriv(k)(slack)) / float(np.prod(np.arange(1, k + 1)))
        for k in range(1, order + 1)
    ]
    # Why: before polynomials MuJoCo took a negative stiffness for none.
    return (np.array(slopes), slack) if newest or slopes[0] > 0.0 else None


def _wave(added: Added, sizes: list[float]) -> Wave | None:
    """Return minus the torque that drives need as a wave, None where a turn is no whole number of periods."""
    name, joint = added.effect.name, added.joints[0]
    if name not in ("torque_ripple", "counterbalance"):
        return None
    poles = added.shape.get("k", 1.0)
    if abs(poles - round(poles)) > WHOLE or round(poles) < 1:
        return None
    cosine, sine = sizes if name == "torque_ripple" else sizes[::-1]
    return Wave(
        joint, float(np.hypot(cosine, sine)), round(poles), float(np.arctan2(-cosine, -sine))
    )


def _slides(full: FullModel, joint: int, size: float, bristles: list[Bristle]) -> bool:
    """Return whether a bristle may take its share of the Coulomb friction of a joint, as no other has."""
    alone = all(each.joint != joint for each in bristles)
    return alone and 0.0 < size <= full.joint_friction("fc")[joint]
