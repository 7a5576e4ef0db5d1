"""Where each effect goes in a simulator: the numbers of a file, MuJoCo's own elements, or effects.py."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from dynid.exporters.engines import module
from dynid.exporters.formulas import Column, columns_of, phrase, without_torque
from dynid.exporters.full_model import FullModel, lifted, numbers
from dynid.exporters.interface import IdentifiedArm
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
#: A wave whose number over a turn is nearer to a whole one than this is one.
WHOLE = 1e-9


def newest_elements() -> bool:
    """Return whether the installed MuJoCo has springs of third order and passive motors with LuGre friction."""
    engine = module("mujoco")
    return engine is not None and int(engine.__version__.split(".")[0]) >= 4


@dataclass(frozen=True)
class Element:
    """What MuJoCo has for an effect.

    Attributes:
        added: the effect.
        where: in words.
        attributes: of the joint for a spring, else of a passive motor.
        loss: Coulomb friction that the joint has less [N m or N].
    """

    added: Added
    where: str
    attributes: Mapping[str, str]
    loss: float = 0.0

    @property
    def place(self) -> tuple[str, int]:
        """Name of the effect and its joint, 0-based."""
        return self.added.effect.name, self.added.joints[0]


@dataclass
class Simulated:
    """An arm as simulators get it.

    Attributes:
        full: bodies, rotors and friction, with the effects that are more of such a number.
        left: effects that nothing holds, in words with the reason.
        numbers: effects that are in the numbers of every file, in words.
        native: elements of an MJCF.
        columns: columns of effects.py with their sizes, and whether an MJCF has an element for them.
        arm_effects: effects of effects.py that act on the torques of all joints.
    """

    full: FullModel
    left: tuple[str, ...]
    numbers: tuple[str, ...]
    native: list[Element] = field(default_factory=list)
    columns: list[tuple[Column, float, bool]] = field(default_factory=list)
    arm_effects: list[Added] = field(default_factory=list)

    @property
    def elements(self) -> tuple[str, ...]:
        """Effects that are elements of an MJCF, in words."""
        names = self.full.robot.joint_names
        return tuple(f"{phrase(one.added, names)}: {one.where}" for one in self.native)

    def effects_in_file(self, *, mjcf: bool) -> list[str]:
        """Return the effects that effects.py adds to an MJCF, or to a URDF, one phrase each."""
        names = self.full.robot.joint_names
        phrases = [phrase(one, names) for one in self.arm_effects]
        for column, _, native in self.columns:
            if not (mjcf and native):
                phrases.append(f"{column.added.effect.name} on {names[column.joint]}")
        return list(dict.fromkeys(phrases))

    def in_effects_file(self, *, mjcf: bool) -> list[str]:
        """Return all that effects.py adds to an MJCF, or to a URDF, one phrase each."""
        offsets = ["torque offsets fo"] * any(self.full.of_joints("fo"))
        rotors = ["rotor inertia"] * (not mjcf and any(self.full.of_joints("Im")))
        return [*self.effects_in_file(mjcf=mjcf), *offsets, *rotors]


def simulated(arm: IdentifiedArm) -> Simulated:
    """Return where each effect of an arm goes."""
    names, bodies, drives = arm.robot.joint_names, list(arm.full.bodies), dict(arm.full.drives)
    numbers, others = [], []
    for added in arm.base.model.added:
        target, sizes = added.effect.more_of, arm.full.sizes(added)
        if target:
            numbers.append(f"{phrase(added, names)}: {NUMBERS[target]}")
        elif not added.effect.left_out:
            others.append((added, sizes))
        if target == "body":
            more = np.pad(sizes, (0, 10 - len(sizes)))
            bodies[-1] = body_of(lifted(bodies[-1].parameters() + more))
        elif target:
            key = f"{target}{added.joints[0] + 1}"
            drives[key] = drives.get(key, 0.0) + sizes[0]
    full = replace(arm.full, bodies=tuple(bodies), drives=drives)
    simulation = Simulated(full, without_torque(arm.robot), tuple(numbers))
    for added, sizes in others:
        element = _element(added, sizes, simulation)
        simulation.native += [element] if element else []
        forms = columns_of(added)
        simulation.columns += [
            (*one, element is not None) for one in zip(forms, sizes, strict=False)
        ]
        simulation.arm_effects += [added] * (not forms)
    return simulation


def numbers_of(arm: IdentifiedArm, *kinds: str) -> dict[str, float]:
    """Return the parameters by name of bodies, and of joints' numbers of these kinds, such as ``fv``, with effects."""
    known = arm.full.by_name
    names = [name for name in known if name.rstrip("0123456789") in (*BODY_PARAMETERS, *kinds)]
    for added in arm.base.model.added:
        if added.effect.more_of in ("body", *kinds):
            names += [column.parameter.name for column in added.columns]
    return {name: known.get(name, 0.0) for name in names}


# ---------------------------------------------------------------- elements of MuJoCo
def _element(added: Added, sizes: list[float], simulation: Simulated) -> Element | None:
    """Return what MuJoCo has for an effect; None where it has nothing, or the joint has another one already."""
    name = added.effect.name
    taken = any(one.place == (name, *added.joints) for one in simulation.native)
    if name == "spring" and not taken:
        return _spring(added, sizes)
    if not newest_elements():
        return None
    if name in ("torque_ripple", "counterbalance"):
        return _wave(added, sizes)
    if name == "presliding_hysteresis" and not taken:
        size = sizes[0]
        if 0.0 < size <= simulation.full.of_joints("fc")[added.joints[0]]:
            lugre = numbers([size / added.shape["delta"], 0.0, size, size, 1.0])
            where = "lugre of a passive dcmotor, and as much less frictionloss"
            return Element(added, where, {"lugre": lugre}, size)
    return None


def _spring(added: Added, sizes: list[float]) -> Element | None:
    """Return a spring k1 (q - s) + k2 (q - s)^2 + k3 (q - s)^3; None where no s is slack."""
    order, newest = round(added.shape["order"]), newest_elements()
    constant = sizes[order] if added.shape["constant"] else 0.0
    torque = np.polynomial.Polynomial([constant, *sizes[:order]])
    roots = [float(root.real) for root in torque.roots() if abs(root.imag) < 1e-12]
    if not roots or (order > 1 and not newest):
        return None
    slack = min(roots, key=abs)
    stiffness = torque(np.polynomial.Polynomial([slack, 1.0])).coef[1:]
    # Why: before polynomials MuJoCo took a negative stiffness for none.
    if not newest and stiffness[0] <= 0.0:
        return None
    facts = {"stiffness": numbers(stiffness), "springref": repr(slack)}
    return Element(added, "stiffness and springref of its joint", facts)


def _wave(added: Added, sizes: Iterable[float]) -> Element | None:
    """Return minus the torque that drives need as a wave, None where a turn is no whole number of periods."""
    poles = added.shape.get("k", 1.0)
    if abs(poles - round(poles)) > WHOLE or round(poles) < 1:
        return None
    cosine, sine = sizes
    if added.effect.name == "counterbalance":
        cosine, sine = sine, cosine
    cogging = numbers([np.hypot(cosine, sine), round(poles), np.arctan2(-cosine, -sine)])
    return Element(added, "cogging of a passive dcmotor", {"cogging": cogging})
