"""The base model of an arm: its regressor together with what of its parameters can be identified, as people see it."""

from __future__ import annotations

import re
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from dynid.model.kinematics import geometry
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model, Observer
from dynid.robot import FRICTION_PARAMETERS, LINK_PARAMETERS, Robot
from dynid.table import Table

if TYPE_CHECKING:
    from pandas import DataFrame

#: What stands for a class in the table of classes.
SYMBOLS = {"alone": "#", "combined": "+", "none": ".", "absent": ""}


@dataclass(frozen=True, repr=False)
class BaseModel:
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

    @property
    def classes(self) -> dict[str, tuple[str, ...]]:
        """Names of the link, drive and friction parameters by class: alone, not identifiable, combined."""
        found = self.reduction
        return {"alone": found.alone, "not identifiable": found.none, "combined": found.combined}

    @property
    def relations(self) -> dict[str, str]:
        """What each combination is made of in the symbols of the DH table, by the name of the base parameter."""
        rows = zip(self.names, self.reduction.formulas, self.reduction.base, strict=False)
        alone = set(self.reduction.alone)
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
        units, alone, relations = self.model.units, set(self.reduction.alone), self.relations
        rows = []
        for name, k in zip(self.names, self.reduction.base, strict=True):
            parameter = self.reduction.names[k]
            kind = "alone" if parameter in alone else "combined"
            made_of = parameter if kind == "alone" else relations.get(name, "").partition(" = ")[2]
            rows.append({"name": name, "unit": units[parameter], "class": kind, "made of": made_of})
        return Table(rows, self._title(), (self.where,) if self.where else ())

    def class_table(self) -> Table:
        """Return the paper's Table 8: one row per joint, one column per kind of parameter, the class in each cell."""
        known = set(self.reduction.names)
        numbers = range(1, self.robot.n + 1)
        kinds = [*LINK_PARAMETERS, *FRICTION_PARAMETERS.values()]
        kinds = [kind for kind in kinds if any(f"{kind}{j}" in known for j in numbers)]
        rows = []
        for j, joint in zip(numbers, self.robot.joints, strict=True):
            names = {kind: f"{kind}{j}" for kind in kinds}
            classes = {kind: self.reduction.class_of(name) for kind, name in names.items() if name in known}
            cells = {kind: SYMBOLS[classes.get(kind, "absent")] for kind in kinds}
            rows.append({"joint": f"{j} {joint.name}", **cells})
        return Table(rows, self._title(), (self.legend,))

    @property
    def legend(self) -> str:
        """What the symbols of the class table mean, and how many parameters each class has."""
        found = self.reduction
        totals = f"totals  {len(found.alone)}   {len(found.combined)}   {len(found.none)}   = {len(found.names)}"
        return f"# alone   + combined   . none      {totals}"

    def to_dataframe(self) -> DataFrame:
        """Return the table of base parameters as a pandas DataFrame.

        Raises:
            PackageMissing: pandas is not installed.
        """
        return self.table().to_dataframe()

    def __repr__(self) -> str:
        """Return the table of classes as text."""
        return repr(self.class_table())

    def _repr_html_(self) -> str:
        return self.table()._repr_html_()

    def _title(self) -> str:
        count = len(self.reduction.names)
        return f"{self.robot.name}: {count} parameters, {self.rank} base parameters"
