"""What each column of the regressor stands for: kind, link or joint, unit. Whoever looks for columns asks here."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dynid.robot import LINK_PARAMETERS, Robot

#: The ten parameters of a link that make a body; the eleventh, Im, belongs to the drive.
BODY_PARAMETERS = LINK_PARAMETERS[:10]


@dataclass(frozen=True)
class Parameter:
    """One parameter of the model: the meaning of one column.

    Attributes:
        kind: ``m``, ``mcx`` ... ``Izz`` and ``Im`` of a link; ``fv``, ``fc``, ``fo`` of a joint's friction; ``Imc``,
            ``fvc``, ``fcc`` of a motor that drives several joints; the identifier of an added effect.
        number: number of the link, joint or motor, 1-based; of the first joint that an added effect acts on.
        unit: its unit.
        name: unique name, such as ``Ixx3``.
    """

    kind: str
    number: int
    unit: str
    name: str

    @property
    def of_body(self) -> bool:
        """Whether it is one of the ten parameters of a link's rigid body."""
        return self.kind in BODY_PARAMETERS


def numbered(kind: str, number: int, unit: str) -> Parameter:
    """Return a parameter that is called after its kind and number."""
    return Parameter(kind, number, unit, f"{kind}{number}")


def link_parameters(robot: Robot) -> tuple[Parameter, ...]:
    """Return the 11 parameters of every link in the order of Table 5, (11 n)."""
    found = []
    for link, joint in enumerate(robot.joints, start=1):
        for kind in LINK_PARAMETERS:
            unit = "kg" if kind == "m" else "kg m" if kind.startswith("mc") else "kg m^2"
            found.append(numbered(kind, link, "kg" if kind == "Im" and not joint.revolute else unit))
    return tuple(found)


def columns_of(parameters: Iterable[Parameter], *kinds: str) -> NDArray[np.intp]:
    """Return the columns whose parameter is of one of these kinds, (k,)."""
    return np.array([k for k, parameter in enumerate(parameters) if parameter.kind in kinds], dtype=np.intp)


def body_columns(parameters: Iterable[Parameter]) -> dict[int, NDArray[np.intp]]:
    """Return the columns of the ten body parameters of each link, (10,), by the link's number."""
    found: dict[int, dict[str, int]] = {}
    for k, parameter in enumerate(parameters):
        if parameter.of_body:
            found.setdefault(parameter.number, {})[parameter.kind] = k
    return {link: np.array([of[kind] for kind in BODY_PARAMETERS], dtype=np.intp) for link, of in sorted(found.items())}
