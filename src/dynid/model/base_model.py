"""The base model of an arm: its regressor and what of its parameters can be identified, as people see it and on disk.

``regressor.npz`` and ``fullregressor.npz`` are keyed by the content of the robot file. The program is stored as integer
arrays for other programs; dynid derives it again in the time that reading it would take.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.answer import Answer, Answered
from dynid.arrays import Floats
from dynid.files.artifact import read_artifact, read_header, reading
from dynid.model.kinematics import geometry
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model, ModelTorques, Observer, build_model, prior_vector
from dynid.npz import write_artifact
from dynid.robot import FRICTION_PARAMETERS, LINK_PARAMETERS, Robot
from dynid.table import Table

#: What stands for a class in the table of classes.
SYMBOLS = {"alone": "#", "combined": "+", "none": "."}


@dataclass(frozen=True, repr=False)
class BaseModel(Answered):
    """A model with its base parameters theta = K gamma, the most that torques can tell (Paper Eq. 13).

    Attributes:
        model: the full regressor.
        reduction: the base parameters.
    """

    model: Model
    reduction: Reduction

    def __reduce__(self) -> tuple[object, ...]:
        """Pickle without what was derived from the two, which cannot be."""
        return BaseModel, (self.model, self.reduction)

    @cached_property
    def observer(self) -> Observer:
        """Evaluator of the base columns."""
        return self.model.observer(self.reduction.base)

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.model.robot

    @property
    def rank(self) -> int:
        """Number of base parameters."""
        return self.reduction.rank

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, (p); a combination ends in ``R``, such as ``Ixx2R``."""
        return self.reduction.base_names

    def prior(self, *, unknown: float = np.nan) -> Floats:
        """Return the prior of the base parameters, K gamma, (p,), in their units.

        Args:
            unknown: what stands where the prior says nothing: for friction, a rotor inertia and added effects alone; in
                a combination these count as zero.
        """
        reduction, parameters = self.reduction, self.model.parameters
        known = [
            parameters[k].of_body or len(reduction.terms(row)) > 1
            for row, k in enumerate(reduction.base)
        ]
        return np.where(known, reduction.K @ prior_vector(self.model), unknown)

    def torques(self, theta: Floats) -> ModelTorques:
        """Return the torques of base parameters: their representatives carry them, all other parameters are zero."""
        values = np.zeros(self.model.size)
        values[self.reduction.base] = theta
        return ModelTorques(self.model, values)

    @property
    def classes(self) -> dict[str, tuple[str, ...]]:
        """Names of the link, drive and friction parameters by class: alone, not identifiable, combined."""
        base = self.reduction
        return {"alone": base.alone, "not identifiable": base.none, "combined": base.combined}

    @property
    def relations(self) -> dict[str, str]:
        """What each combination is made of in the symbols of the DH table, by the name of the base parameter."""
        rows = zip(self.names, self.reduction.formulas, self.reduction.base, strict=False)
        alone = self.reduction.alone
        return {name: text for name, text, k in rows if self.reduction.names[k] not in alone}

    @property
    def symbols(self) -> dict[str, float]:
        """Lengths of the DH table that the relations name [m]."""
        used = set(re.findall(r"\b[ad]\d+\b", " ".join(self.relations.values())))
        return {name: value for name, value in geometry(self.robot).items() if name in used}

    @property
    def where(self) -> str:
        """The numbers behind the symbols, such as ``with d3 = 0.4 m``; empty where no relation names a length."""
        values = ", ".join(f"{name} = {value:g} m" for name, value in self.symbols.items())
        return f"with {values}" if values else ""

    def table(self) -> Table:
        """Return one row per base parameter: name, unit, class, and what it is made of."""
        units, relations = self.model.units, self.relations
        rows = []
        for name, k in zip(self.names, self.reduction.base, strict=True):
            parameter = self.reduction.names[k]
            kind = self.reduction.class_of(parameter)
            made_of = parameter if kind == "alone" else relations.get(name, "").partition(" = ")[2]
            rows.append({"name": name, "unit": units[parameter], "class": kind, "made of": made_of})
        return Table(rows)

    def class_table(self) -> Table:
        """Return the paper's Table 8: one row per joint, one column per kind of parameter, the class in each cell."""
        symbols = {name: SYMBOLS[self.reduction.class_of(name)] for name in self.reduction.names}
        numbers = range(1, self.robot.n + 1)
        kinds = [*LINK_PARAMETERS, *FRICTION_PARAMETERS.values()]
        kinds = [kind for kind in kinds if any(f"{kind}{j}" in symbols for j in numbers)]
        rows = []
        for j, joint in zip(numbers, self.robot.joints, strict=True):
            cells = {kind: symbols.get(f"{kind}{j}", "") for kind in kinds}
            rows.append({"joint": f"{j} {joint.name}", **cells})
        return Table(rows)

    @property
    def sentence(self) -> str:
        """How many parameters of the arm are identifiable, in one sentence."""
        base = self.reduction
        alone, grouped, every = len(base.alone), len(base.combined), len(base.names)
        groups = self.rank - alone
        return (
            f"{self.robot.name}: of {every} parameters {alone} are identifiable alone, {grouped} only in {groups} "
            f"linear combinations, {len(base.none)} not at all: {self.rank} base parameters."
        )

    @property
    def legend(self) -> str:
        """What the symbols of the class table mean, and how many parameters each class has."""
        base = self.reduction
        totals = f"totals  {len(base.alone)}   {len(base.combined)}   {len(base.none)}"
        return f"# alone   + in a combination   . not identifiable   {totals}   = {len(base.names)}"

    def answer(self) -> Answer:
        """Return the table of classes, and what each combination is made of."""
        relations = [f"  {each}" for each in (*self.relations.values(), self.where) if each]
        return Answer(
            {"robot": self.robot.name},
            self.sentence,
            ("", self.class_table(), self.legend, *relations),
        )


#: Base models that are kept in memory, by the key of their robot: naming its relations takes a second.
_kept: dict[str, BaseModel] = {}
KEPT = 8


def in_memory(robot: Robot, samples: int = 200, tolerance: float | None = None) -> BaseModel:
    """Return the base model of an arm, derived once in this process.

    Args:
        robot: the arm.
        samples: number of random states at which singular values are computed.
        tolerance: relative singular value below which columns count as dependent; None for the usual one.
    """
    from dynid.model.relations import base_parameters

    key = f"{key_of(robot)}-{samples}-{tolerance}"
    if key not in _kept:
        model = build_model(robot)
        if len(_kept) >= KEPT:
            del _kept[next(iter(_kept))]
        _kept[key] = BaseModel(model, base_parameters(model, samples=samples, tolerance=tolerance))
    kept = _kept[key]
    return (
        kept if kept.robot is robot else BaseModel(Model(robot, kept.model.rigid), kept.reduction)
    )


# ---------------------------------------------------------------- on disk
REGRESSOR, FULL = "dynid/regressor/1", "dynid/fullregressor/1"
_PROGRAM = ("op", "lhs", "rhs", "rows", "cols", "outputs")
#: Arrays of any file that holds base parameters.
_REDUCTION = ("base", "K", "singular_values")
_LISTS = ("alone", "none", "combined", "formulas")
#: Raised when the derivation or the layout of its arrays changes, so that older caches are rebuilt.
DERIVATION = 4


def key_of(robot: Robot) -> str:
    """Return the key of a robot's model: content of the robot file and version of the derivation."""
    return f"{robot.model_key}-{DERIVATION}"


def stored_key(path: Path) -> str | None:
    """Return the key in a stored model, None when there is none."""
    key: str | None = read_header(path).get("key")
    return key


def _header(robot: Robot, **facts: object) -> dict[str, Any]:
    geometry = [[j.type, j.a, j.twist, j.d, j.theta_offset] for j in robot.joints]
    return {
        "key": key_of(robot),
        "robot": robot.name,
        "joints": list(robot.joint_names),
        "geometry": geometry,
        "convention": robot.convention,
        "gravity": list(robot.gravity),
        **facts,
    }


def save_model(path: Path, model: Model) -> None:
    """Write regressor.npz."""
    p = model.rigid
    header = _header(
        model.robot,
        program_inputs=list(p.inputs),
        constants=[],
        shape=list(p.shape),
        parameters=list(model.parameter_names),
        operations=p.flops,
    )
    write_artifact(path, REGRESSOR, header, {name: getattr(p, name) for name in _PROGRAM})


def save_reduction(path: Path, model: Model, reduction: Reduction) -> None:
    """Write fullregressor.npz."""
    facts, arrays = reduction_facts(reduction)
    write_artifact(path, FULL, _header(model.robot, **facts), arrays)


def load_reduction(path: Path) -> Reduction:
    """Read fullregressor.npz."""
    artifact = read_artifact(path, FULL)
    with reading(path):
        return reduction_from(artifact.header, artifact.arrays)


def reduction_facts(reduction: Reduction) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return base parameters as facts of a header and arrays, for any file that holds them."""
    facts = {
        "parameters": list(reduction.names),
        "base": list(reduction.base_names),
        "rank": reduction.rank,
        "gap": reduction.gap if np.isfinite(reduction.gap) else None,
        **{key: list(getattr(reduction, key)) for key in _LISTS},
    }
    return facts, {key: getattr(reduction, key) for key in _REDUCTION}


def reduction_from(facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Reduction:
    """Return the base parameters that ``reduction_facts`` wrote.

    Args:
        facts: of the header.
        arrays: ``base`` (p,), ``K`` (p, c) and ``singular_values``.
    """
    return Reduction(
        names=tuple(facts["parameters"]),
        base=arrays["base"].astype(np.intp),
        K=arrays["K"],
        singular_values=arrays["singular_values"],
        gap=np.inf if facts["gap"] is None else facts["gap"],
        **{key: tuple(facts[key]) for key in _LISTS},
    )
