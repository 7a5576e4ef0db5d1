"""The body fixed to the last link, from a log with it and a result without it.

A body phi on the last link changes the base parameters by K_n phi, where K_n are the columns of that link in
``Reduction.K``. The rows of the loaded log are fitted with the posterior of the arm without the load (parameters and
residual model) beside them. Friction may have changed since (load, warmth), and gains may be wrong in both logs.
Docs: docs/explanation/consistency.md.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.arrays import Floats, Mask
from dynid.errors import Finding, WrongUsage
from dynid.estimation import tuning
from dynid.estimation.factor import Factor, of_unit_diagonal, triangle
from dynid.estimation.identified import body_facts
from dynid.estimation.least_squares import solvable, symmetric_root
from dynid.estimation.possible_arm import fit_pooled, inverse
from dynid.estimation.possible_set import make_constraints
from dynid.estimation.posterior import information_of
from dynid.estimation.residual_model import SIZE, ModelError, centred
from dynid.estimation.result import Identification
from dynid.model.base_model import BaseModel
from dynid.model.parameters import BODY_PARAMETERS, body_columns, body_of, numbered
from dynid.robot import Body

#: Information that each joint has at least, relative to that of all.
UNTOLD = 1e-9
#: Standard errors to either side of a 95 % interval, and which of the ten numbers are never negative.
WIDTH, POSITIVE = 1.96, np.isin(np.arange(10), (0, 4, 7, 9))
#: Kinds of parameters that are friction.
FRICTION = ("fv", "fc", "fo", "fvc", "fcc")


@dataclass(frozen=True)
class IdentifiedPayload:
    """A body in the frame of the last link.

    Attributes:
        body: mass, centre of mass, inertia about it.
        std_error: of mass [kg], centre of mass [m] and inertia xx, xy, xz, yy, yz, zz [kg m^2], (10,).
        misfit: how much worse the change of the base parameters is explained by a body than its errors allow; 1 is
            as expected. Errors are widened by its root.
        covariance: of mass, first moments and inertia about the frame's origin, ``body.parameters()``, (10, 10).
    """

    body: Body
    std_error: Floats
    misfit: float
    covariance: Floats

    @property
    def intervals(self) -> Floats:
        """95 % intervals of the numbers, (10, 2); masses and moments of inertia are never negative."""
        ends = self.body.numbers[:, None] + WIDTH * self.std_error[:, None] * [-1.0, 1.0]
        return np.where(POSITIVE[:, None], np.maximum(ends, 0.0), ends)

    def facts(self) -> dict[str, Any]:
        """Return the body for JSON."""
        return {
            **body_facts(self.body.numbers),
            "std_error": body_facts(self.std_error),
            "interval_95": body_facts(self.intervals),
            "misfit": self.misfit,
        }

    def findings(self) -> list[Finding]:
        """Say when a body on the last link does not explain what has changed."""
        if self.misfit < tuning.LOAD_MISFIT:
            return []
        text = (
            f"a body on the last link explains the change badly (reduced chi-square {self.misfit:.1f}): "
            "is it fixed to the last link, and is everything else as before?"
        )
        return [Finding("W411", "warning", text, {"misfit": self.misfit})]


@solvable()
def find_payload(loaded: Identification, unloaded: Identification) -> IdentifiedPayload:
    """Return the body that the loaded arm has in addition.

    Args:
        loaded: identified from a log with the body; its rows, where it has them, are used with the residual model.
        unloaded: identified without it, with the same base parameters.

    Raises:
        WrongUsage: the results are of different arms, or the last link is not identified.
    """
    unloaded.require(loaded.base)
    problem = LoadProblem.of(loaded, unloaded)
    body = fitted_body(*problem.solved(0.0, 0.0)[:3]).body
    # Why not with the loaded log's own parameters: their noise would seem to tell the scale of the torques.
    problem = replace(problem, torque=unloaded.theta + problem.K @ body.parameters())
    known = loaded.robot.torque.scale_error
    return fitted_body(*problem.solved(known, problem.own_scale_error(known))[:3])


@dataclass(frozen=True)
class LoadProblem:
    """Rows of a loaded log, and the posterior of the arm without the load; n joints, p parameters, k columns.

    Attributes:
        unloaded: the result without the load.
        residual: its residual model; None without, or where it is unknown how it acts with the load.
        factors: rows [Z W tau] of each joint with the load, whitened, (n, m, k + p + 1); k is 0 without residual model.
        torque: base parameters with the load, whose torques the gains multiply, (p,).
    """

    unloaded: Identification
    residual: ModelError | None
    factors: Floats
    torque: Floats

    @classmethod
    def of(cls, loaded: Identification, unloaded: Identification) -> LoadProblem:
        """Return the problem of two results."""
        whiten, noise, stack = information_of(loaded)[1], loaded.noise, loaded.stack
        residual, k = unloaded.model_error, 0
        if residual is not None and stack is not None and stack.earlier is None:
            shaped = residual.factors(stack, noise, loaded.fit.robust)
            rows, k = residual.changed(shaped) / whiten[:, None, None], SIZE
        else:
            # Why: without its rows nothing is known of how the residual model acts in the loaded log.
            unknown = 0.0 if residual is None else residual.rms[:, -1] * whiten / noise
            rows = loaded.factors / np.hypot(whiten, unknown)[:, None, None]
            residual = None
        return cls(unloaded, residual, centred(rows, k, loaded.plain), loaded.theta)

    @cached_property
    def K(self) -> Floats:
        """Change of the base parameters by the ten parameters of the load, (p, 10)."""
        return self.unloaded.reduction.K[:, last_link(self.unloaded.base)]

    @cached_property
    def friction(self) -> Mask:
        """Columns of friction, which may have changed since, (p,)."""
        return friction(self.unloaded.base)

    def own_scale_error(self, known: float) -> float:
        """Return how far the gains of joints are off beyond what is known, each by itself, as a share.

        Each joint weighs the load with its own gain. Where they disagree by more than their errors, the evidence of the
        rows says by how much.

        Args:
            known: what the robot file says of the torque's scale.
        """
        sizes = np.array(tuning.OWN_SCALE_ERRORS)
        evidence = np.array([self.solved(known, x)[3] for x in sizes.tolist()])
        weight = np.exp(evidence - evidence.max())
        return float(np.sqrt(weight @ sizes**2 / weight.sum()))

    def solved(self, scale_error: float, own: float) -> tuple[Floats, Floats, float, float]:
        """Return rows R, (10, 10), and r, (10,), with R x = r of the load, and how badly a load explains the change.

        Last comes the log evidence of the rows, up to a constant that no scale error changes.

        Unknown are the base parameters and the residual model, known by the posterior; what friction has changed by;
        the gain of each joint, the same in both logs, and its drift; and the load.

        Args:
            scale_error: standard deviation of the torque's scale, as a share.
            own: the same of each joint's own, beyond that.
        """
        n, common = len(self.factors), tuning.COMMON_SCALE_SHARE * scale_error**2
        covariance = common + (scale_error**2 - common + own**2) * np.eye(n)
        scale = symmetric_root(covariance)
        root, theta = symmetric_root(information_of(self.unloaded)[0]).T, self.unloaded.theta
        problem = Factor({"arm": root}, root @ theta)
        problem = problem.prior("friction", self._friction_change())
        problem = problem.prior("scale", np.ones(n)).prior("drift", np.ones(n))
        # Why of real arms only: the residual model is evidence for more than the model has.
        real = self.unloaded.model_error is not None
        drifts, free = tuning.SCALE_DRIFT * real * np.eye(n), []
        for rows, moved, drift in zip(self._rows, self._moved_by_gains, drifts, strict=True):
            arm, W, right = rows.blocks["arm"], rows.blocks["change"], rows.right
            unknown = {"friction": W[:, self.friction], "scale": W @ moved @ scale}
            unknown |= {"drift": np.outer(W @ self.torque, drift), "load": W @ self.K}
            problem += Factor({"arm": arm, **unknown}, right)
            free.append(np.column_stack([W, right - arm @ theta]))
        load = problem.without("arm", "friction", "scale", "drift")[0]
        R, unexplained = load.rows, triangle(np.vstack(free))[-1, -1]
        # Why: free parameters leave this of the loaded log; what a load leaves beyond it has changed in another way.
        beyond = max(0.0, float(R[-1, -1] ** 2 - unexplained**2))
        freedom = int(np.linalg.matrix_rank(root)) - len(R) + 1 - self.friction.sum()
        evidence = load.without("load")[0].volume - 0.5 * float(R[-1, -1] ** 2)
        return R[:-1, :-1], R[:-1, -1], beyond / max(1, freedom), evidence

    @cached_property
    def _rows(self) -> list[Factor]:
        """Rows of each joint in the parameters of the arm and their change, the residual model integrated out."""
        found, residual, theta = [], self.residual, self.unloaded.theta
        k = self.factors.shape[2] - len(theta) - 1
        for j, F in enumerate(self.factors):
            apart = residual is not None and residual.apart[j]
            W, size = F[:, k:-1], k + len(theta) if apart else k
            rows = Factor({"beside": F[:, :size], "arm": W, "change": W}, F[:, -1])
            if residual is not None:
                root = np.asarray(np.linalg.inv(residual.root[j, :size, :size]))
                slope = root @ residual.slope[j, :size]
                right = root @ residual.mean[j, :size] - slope @ theta
                rows += Factor({"beside": root, "arm": -slope}, right)
            found.append(rows.without("beside")[0])
        return found

    @cached_property
    def _moved_by_gains(self) -> Floats:
        """By how much a wrong gain of each joint moves what the rows of each have, (n, p, n).

        Each joint moves the parameters as far as its rows decide them. Together they scale them all: the torques of an
        arm do not tell their own scale, and what came from the prior must not seem to.
        """
        n, whiten = len(self.factors), information_of(self.unloaded)[1]
        W = self.unloaded.factors[:, :, :-1] / whiten[:, None, None]
        information = W.swapaxes(1, 2) @ W
        # Why of each joint: parameters that no row tells move with all joints alike.
        information += UNTOLD * np.diag(of_unit_diagonal(information.sum(axis=0))[1] ** -2)
        moved = inverse(information.sum(axis=0)) @ (information @ self.unloaded.theta).T
        return np.einsum("p,jk->jpk", self.torque, np.eye(n)) - moved

    def _friction_change(self) -> Floats:
        """Return by how much friction may have changed: each column by all the friction of its joint, (f,)."""
        W = self.factors[:, :, -len(self.torque) - 1 : -1][:, :, self.friction]
        size = np.linalg.norm(W, axis=1)
        torque = np.linalg.norm(W @ self.unloaded.theta[self.friction], axis=1)
        torque = torque[np.argmax(size, axis=0)]
        least = tuning.FRICTION_CHANGE_LEAST * np.linalg.norm(self.factors[:, :, -1], axis=1).max()
        largest = size.max(axis=0)
        return np.maximum(torque, least) / np.where(largest > 0.0, largest, 1.0)


def last_link(base: BaseModel) -> NDArray[np.intp]:
    """Return the columns of the last link's ten parameters among all parameters, (10,).

    Raises:
        WrongUsage: the last link is not identified, or torques are in amperes.
    """
    n = base.robot.n
    if base.robot.torque.relative:
        raise WrongUsage("a load in kg needs the drives' gains", fix="find the gains: --loaded LOG")
    columns = body_columns(base.model.parameters).get(n)
    if columns is None:
        raise WrongUsage(
            f"link {n} is not among the identified ones", fix="`links: all` in the robot file"
        )
    return columns


def friction(base: BaseModel) -> Mask:
    """Return which base parameters are the friction of joints or motors, (p,)."""
    kinds = [base.model.parameters[k].kind for k in base.reduction.base]
    return np.array([kind in FRICTION for kind in kinds])


def fitted_body(R: Floats, r: Floats, misfit: float = 0.0) -> IdentifiedPayload:
    """Return the possible body that whitened rows ask for, with its posterior.

    Args:
        R: rows of the ten parameters of the body, (m, 10).
        r: what they shall give, (m,).
        misfit: how much worse a body explains these rows than their errors allow; errors are widened by its root.
    """
    from scipy.optimize import approx_fprime  # here: its import takes as long as a fit

    parameters = [numbered(kind, 1, "") for kind in BODY_PARAMETERS]
    wide = math.sqrt(max(1.0, misfit))
    R, r = R / wide, r / wide
    x = np.asarray(np.linalg.lstsq(R, r, rcond=None)[0], dtype=np.float64)
    # Why twice: least squares alone may put the centre of a light load far away.
    for _ in range(2):
        fit = fit_pooled(R, r, make_constraints(parameters, _ball(x).parameters()))[0]
        x = fit.x
    J = approx_fprime(
        fit.x, lambda x: body_of(x).numbers, 1e-6 * np.maximum(np.abs(fit.x), 1e-3 * fit.x[0])
    )
    covariance = fit.covariance
    return IdentifiedPayload(
        body_of(fit.x), np.sqrt(np.diagonal(J @ covariance @ J.T)), misfit, covariance
    )


def _ball(phi: Floats) -> Body:
    """Return a ball with the mass and centre of mass of a first estimate."""
    mass = max(float(phi[0]), tuning.LOAD_LEAST_KG)
    x, y, z = (phi[1:4] / mass if phi[0] > tuning.LOAD_LEAST_KG else np.zeros(3)).tolist()
    inertia = 0.4 * mass * tuning.LOAD_RADIUS_M**2
    return Body(mass, (x, y, z), (inertia, 0.0, 0.0, inertia, 0.0, inertia))
