"""What an identification found, as data: parameters with what is known about them (the paper's Table 10)."""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import cached_property
from operator import attrgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any, cast

import numpy as np
from numpy.typing import ArrayLike, NDArray

from dynid.arrays import Floats
from dynid.errors import Finding, WrongUsage
from dynid.estimation.least_squares import Fit, relative_error
from dynid.estimation.one_state import OneState, one_state
from dynid.estimation.possible_arm import PhysicalParameters
from dynid.estimation.prediction import JointError
from dynid.estimation.residual_model import GROUP_NAMES, ModelError
from dynid.model.base_model import BaseModel
from dynid.model.effects.motion import ArmMotion
from dynid.model.parameters import body_columns, body_of
from dynid.model.program import Program
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model, build_model
from dynid.robot import Robot
from dynid.signals.conditioned_log import known_torque
from dynid.table import Table

if TYPE_CHECKING:
    from dynid.estimation.stack import Stack


#: How the text of what was held out ends where it is part of the fitted motion.
SAME_MOTION = "the same motion"
USED = {"physical": "the physically consistent parameters", "plain": "least squares"}


def torque_units(robot: Robot) -> list[str]:
    """Return the unit in which torques of each joint are shown: A where nothing tells the size of the gains."""
    return ["A" if robot.torque.relative else joint.torque_unit for joint in robot.joints]


def body_facts(numbers: Floats) -> dict[str, Any]:
    """Return what belongs to the ten ``Body.numbers``, (10, ...), by name for JSON."""
    mass, *others = numbers.tolist()
    inertia = dict(zip(("ixx", "ixy", "ixz", "iyy", "iyz", "izz"), others[3:], strict=True))
    return {"mass_kg": mass, "com_m": others[:3], "inertia_com_kg_m2": inertia}


@dataclass(frozen=True)
class ExpectedError:
    """How far predicted torques will be off.

    Attributes:
        fitted_percent: expected relative error on another recording of the fitted motion [%].
        exciting_percent: the same on an exciting motion inside the arm's limits [%].
        noise: expected rms of what no parameter explains, per joint, (n,) [N m or N].
    """

    fitted_percent: float
    exciting_percent: float
    noise: Floats


@dataclass(frozen=True)
class JointQuality(JointError):
    """One joint on the training logs; ``heldout_rms`` is the residual on held-out rows [N m or N], None without any."""

    heldout_rms: float | None


def _part(path: str) -> Any:  # noqa: ANN401 - what it is stands beside it
    """Return an attribute of a part of a result as an attribute of the result."""
    return property(attrgetter(path), doc=f"The same as ``{path}``.")


@dataclass(frozen=True, repr=False, eq=False, kw_only=True)
class Identified:
    """What an identification found; ``Identification`` says what each attribute is."""

    robot: Robot
    reduction: Reduction
    fit: Fit
    why: str
    theta: Floats
    covariance: Floats
    std_error: Floats
    knowledge: tuple[str, ...]
    prior: Floats
    physical: PhysicalParameters
    in_force: str
    joints: tuple[JointQuality, ...]
    relative_error_percent: float
    heldout_relative_error_percent: float | None
    heldout: str
    rank: int
    condition_number: float
    condition_number_scaled: float
    samples: int
    expected: ExpectedError
    model_error: ModelError | None = None
    findings: tuple[Finding, ...] = ()
    header: dict[str, Any] = field(default_factory=dict)
    path: Path = Path()
    motions: tuple[Floats, ...] = ()
    rigid: Program | None = None
    stack: Stack | None = None

    method = cast("str", _part("fit.method"))
    plain = cast("Floats", _part("fit.theta"))
    plain_covariance = cast("Floats", _part("fit.covariance"))
    noise = cast("Floats", _part("fit.noise"))
    factors = cast("Floats", _part("fit.factors"))
    counts = cast("NDArray[np.int64]", _part("fit.counts"))

    def __getstate__(self) -> dict[str, Any]:
        """Leave out what is derived: it is derived again where it is needed."""
        return {each.name: getattr(self, each.name) for each in fields(self)}

    @property
    def cutoff(self) -> float:
        """Cut-off frequency of the filter over torques and columns [Hz]."""
        return float(self.header.get("cutoff_hz", 0.0))

    @property
    def delay(self) -> float:
        """By how much the torques were late, and were moved back [s]."""
        return float(self.header.get("delay_applied_s", 0.0))

    @property
    def log_sha256(self) -> tuple[str, ...]:
        """Hashes of the logs that it was made from."""
        return tuple(self.header.get("log_sha256", ()))

    @property
    def label(self) -> str:
        """Its file, for messages."""
        return str(self.path) if self.path.name else "the earlier result"

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the base parameters, (p,)."""
        return self.reduction.base_names

    @cached_property
    def base(self) -> BaseModel:
        """Model and base parameters."""
        model = build_model(self.robot) if self.rigid is None else Model(self.robot, self.rigid)
        return BaseModel(model, self.reduction)

    def describes(self, base: BaseModel) -> bool:
        """Return whether joints, base parameters and the unit of torques of a model are those of this result."""
        mine, theirs = (
            (x.names, x.robot.joint_names, x.robot.torque.relative) for x in (self, base)
        )
        return mine == theirs

    def require(self, base: BaseModel) -> None:
        """Raise unless joints, base parameters and the unit of torques of a model are those of this result.

        Raises:
            WrongUsage: they are not.
        """
        if not self.describes(base):
            raise WrongUsage(
                f"{self.label} has other joints, base parameters or units of torque than {base.robot.name}",
                fix="identify both with the same robot file",
            )

    # ---------------------------------------------------------------- parameters
    @property
    def params(self) -> dict[str, float]:
        """Values of the base parameters by name, those used for predictions, in their units."""
        return dict(zip(self.names, self.theta.tolist(), strict=True))

    def conf_int(self, level: float = 0.95) -> Floats:
        """Return the interval of each parameter alone, (p, 2), in its unit; infinite where the log says nothing.

        Args:
            level: probability that the interval of a parameter holds its true value.
        """
        from scipy.special import ndtri  # here: its import takes long

        half = ndtri(0.5 + level / 2) * self.std_error
        return np.column_stack([self.theta - half, self.theta + half])

    def parameter_rows(self) -> list[dict[str, Any]]:
        """Return one row per base parameter for JSON: name, value, unit, std_error, class, known, formula, prior."""
        reduction, units = self.reduction, self.base.model.units
        table = []
        for i, name in enumerate(self.names):
            terms = reduction.terms(i)
            error = float(self.std_error[i])
            table.append(
                {
                    "name": name,
                    "value": float(self.theta[i]),
                    "unit": units[reduction.names[reduction.base[i]]],
                    "std_error": error if np.isfinite(error) else None,
                    "class": "alone" if len(terms) == 1 else "combined",
                    "known": self.knowledge[i],
                    "formula": reduction.formulas[i] if reduction.formulas else None,
                    "terms": terms,
                    "prior": None if np.isnan(self.prior[i]) else float(self.prior[i]),
                }
            )
        return table

    def table(self) -> Table:
        """Return one row per base parameter: value with 95 % interval, unit, class, how well it is known, prior."""
        keys = ("value", "std_error", "2.5 %", "97.5 %", "unit", "class", "known", "prior")
        rows = self.parameter_rows()
        for row, interval in zip(rows, self.conf_int().tolist(), strict=True):
            row |= zip(keys[2:4], interval, strict=True)
        columns = {"parameter": "name", **{key.replace("_", " "): key for key in keys}}
        return Table([{name: row[key] for name, key in columns.items()} for row in rows])

    def links(self) -> list[dict[str, Any]]:
        """Return mass, centre of mass and inertia of each identified link, for JSON; ``origin`` is data or prior."""
        physical, links = self.physical, []
        for link, columns in body_columns(self.base.model.parameters).items():
            names = (physical.names[k] for k in columns)
            links.append(
                {
                    "link": link,
                    **body_facts(body_of(physical.x[columns]).numbers),
                    "origin": {name: physical.origin[name] for name in names},
                }
            )
        return links

    def residual_table(self) -> Table:
        """Return one row per joint: rms torque [N m or N] of the model error by group in the fitted motion, and in all.

        Position: angle offsets, springs, cables. Friction: friction that depends on position or speed. Load: friction
        that grows with the torque. Empty where there is no model error.
        """
        rms = [] if self.model_error is None else self.model_error.rms.tolist()
        keys = ("joint", *GROUP_NAMES, "all")
        rows = zip(self.robot.joint_names, rms, strict=False)
        return Table([dict(zip(keys, (name, *parts), strict=True)) for name, parts in rows])

    def residual_facts(self) -> dict[str, Any] | None:
        """Return what the model error holds, for JSON; None where there is none."""
        error = self.model_error
        if error is None:
            return None
        return {
            "log_evidence": error.evidence if np.isfinite(error.evidence) else None,
            "size": dict(zip(GROUP_NAMES, error.size.tolist(), strict=True)),
            "joints": list(self.residual_table()),
        }

    # ---------------------------------------------------------------- model
    def inverse_dynamics(
        self,
        q: ArrayLike,
        qd: ArrayLike,
        qdd: ArrayLike,
        t: ArrayLike | None = None,
        *,
        residual_model: bool = True,
    ) -> Floats:
        """Return the torques of the whole arm with its friction [N m or N], in DH quantities, in the shape of q.

        Links that were not identified take part with their prior values.

        Args:
            q: positions of one state, (n,), or of a motion, (N, n) [rad or m].
            qd: velocities [rad/s or m/s].
            qdd: accelerations [rad/s^2 or m/s^2].
            t: time of the samples since the motion began, (N,) [s]; needed where the robot file lists effects.
            residual_model: add the mean of the model error, where the result has one.

        Raises:
            WrongUsage: the arrays have other shapes, or the model has effects that depend on the order of the samples
                and their time is not given.
        """
        states = _state(self.robot.n, q, qd, qdd)
        error = self.model_error if residual_model else None
        if states[0].ndim == 1:
            if residual_model not in self._functions:
                self._functions[residual_model] = one_state(self.base, self.theta, error)
            function = self._functions[residual_model]
            if function is not None:
                return np.array(function(*(x.tolist() for x in states)))
        q, qd, qdd = (np.atleast_2d(x) for x in states)
        tau, observer = known_torque(self.base.model, q, qd, qdd), self.base.observer
        if self.base.model.added or error is not None:
            times = None if t is None else np.atleast_1d(np.asarray(t, dtype=float))
            W = self.regressor(q, qd, qdd, times)
            tau = tau + W @ self.theta
            if error is not None:
                tau = tau + error.torque(W, error.shapes_at(q, qd, observer))
        else:
            tau = tau + observer.torque(self.theta, q, qd, qdd)
        return tau.reshape(states[0].shape)

    @cached_property
    def _functions(self) -> dict[bool, OneState | None]:
        """The inverse dynamics of single states, with and without the residual model, once they were asked for."""
        return {}

    def regressor(self, q: Floats, qd: Floats, qdd: Floats, t: Floats | None = None) -> Floats:
        """Return the base regressor Y with tau = Y theta, (N, n, p), in DH quantities (Paper Eq. 13).

        Links that were not identified have no part in it.

        Args:
            q: positions, (N, n) [rad or m].
            qd: velocities, (N, n) [rad/s or m/s].
            qdd: accelerations, (N, n) [rad/s^2 or m/s^2].
            t: time of the samples since the motion began, (N,) [s]; needed where the robot file lists effects.

        Raises:
            WrongUsage: as for ``inverse_dynamics``.
        """
        observer = self.base.observer
        if self.base.model.added:
            if t is None:
                raise WrongUsage(
                    "this model has effects that depend on the order of the samples",
                    fix="give their time: t=[...]",
                )
            reference = self.base.torques(self.theta)
            return observer.along(ArmMotion(t, q, qd, qdd, self.robot, reference, lambda x: x))
        return observer.dense(q, qd, qdd)

    def expectation(self) -> list[str]:
        """Return the torque error to expect and what the model error holds, line by line."""
        lines = [
            f"expected torque error {self.expected.fitted_percent:.2g} % on another recording of the fitted "
            f"motion, {self.expected.exciting_percent:.2g} % on an exciting motion inside the limits"
        ]
        if self.model_error is not None:
            alone = relative_error(self.factors, self.theta)
            lines.append(
                f"torque error {self.relative_error_percent:.2f} % with the residual model, {alone:.2f} % without "
                "it (URDF and other exports have the parameters only)"
            )
        return lines


def _state(n: int, *given: ArrayLike) -> tuple[Floats, ...]:
    """Return positions, velocities and accelerations as arrays of one shape, (n,) or (N, n).

    Raises:
        WrongUsage: they have another.
    """
    states = tuple(np.asarray(x, dtype=float) for x in given)
    shape = states[0].shape
    if any(x.shape != shape for x in states) or len(shape) not in (1, 2) or shape[-1] != n:
        named = zip(("q", "qd", "qdd"), states, strict=True)
        raise WrongUsage(
            f"the shapes are {', '.join(f'{name} {x.shape}' for name, x in named)}",
            fix=f"({n},) for one state of this arm, or (N, {n}) for N samples, for all three",
        )
    return states
