"""The one criterion: log marginal likelihood of whitened rows, with what has no name sized by it.

    torque = base parameters + named effects + errors that all joints share      (T, common to all joints)
           + known errors of one joint + what is missing and has no name          (R, of one joint alone)
           + noise

All are Gaussian, so the integral over everything is in closed form. The rest of one joint is eliminated by itself
(Schur complement), which leaves a small matrix over what is common; sizes of kinds of the rest maximise the result.

Source: MacKay 1992, "Bayesian interpolation", for sizes by evidence; Kass and Raftery 1995, "Bayes factors".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from dynid.gap import tuning
from dynid.gap.known_errors import (
    SHARP,
    KnownErrors,
    acceleration_torques,
    common_columns,
    own_columns,
)
from dynid.gap.noise import RepeatPair
from dynid.gap.rest import MISSING, rest_columns
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.interface import Floats

#: Prior precision of base parameters over what the rows know of them: none.
FLAT = 1e-16
#: Least and largest log rms of a kind of the rest, in units of the noise.
LOG_RMS = (-6.0, 5.0)
#: Log rms of a rest that is not there.
NONE = -4.0
#: The kind that is the shape of reversals, in shares of Coulomb friction.
SHAPE = "shape"
#: Steps of sizing one joint's rest.
STEPS = 25


@dataclass(frozen=True)
class JointModel:
    """The rows of one joint as products.

    Attributes:
        gram: of [T, R, torque], (t + r + 1, t + r + 1).
        count: number of rows.
        kinds: where the columns of each kind of the rest are among R; the shape of reversals comes first, then known
            errors of one size.
        errors: number of known errors of this joint.
        log_rms: size of each kind, (kinds,).
        level: log of how much quieter than measured the noise is, in power.
    """

    gram: Floats
    count: int
    kinds: tuple[tuple[str, slice], ...]
    errors: int
    log_rms: Floats
    level: float = 0.0

    @property
    def precision(self) -> Floats:
        """Prior precision of R, (r,)."""
        found = np.ones(max([self.errors, *(part.stop for _, part in self.kinds)]))
        for (_, part), h in zip(self.kinds, self.log_rms, strict=True):
            found[part] = np.exp(-2.0 * h)
        return found

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Which kinds are something that is missing, (kinds,)."""
        return np.array([name in MISSING for name, _ in self.kinds], dtype=bool)

    @property
    def shape(self) -> NDArray[np.bool_]:
        """Which kind is the shape of reversals, (kinds,)."""
        return np.array([name == SHAPE for name, _ in self.kinds], dtype=bool)

    def widened(self, columns: Floats, products: Floats, at: int) -> JointModel:
        """Return the model with k further columns of T, as the columns from ``at`` on.

        Args:
            columns: their own products, (k, k).
            products: with [T, R, torque], (k, t + r + 1).
            at: number of columns of T.
        """
        k, size = len(columns), len(self.gram)
        order = np.r_[0:at, at + k : size + k]
        gram = np.zeros((size + k, size + k))
        gram[np.ix_(order, order)] = self.gram
        gram[at : at + k][:, order] = products
        gram[order, at : at + k] = products.T
        gram[at : at + k, at : at + k] = columns
        return replace(self, gram=gram)


def log_prior(model: JointModel, log_rms: Floats, price: float) -> tuple[float, Floats]:
    """Return the log prior of sizes, and its slope, (kinds,).

    Args:
        model: the joint.
        log_rms: sizes.
        price: of something that is missing, in log odds.
    """
    spread = np.where(model.shape, tuning.SHARPER_SPREAD, tuning.REST_SPREAD)
    z = (log_rms - np.where(model.shape, 0.0, np.log(tuning.REST_USUAL))) / spread
    active = model.missing / (
        1.0 + np.exp(-(log_rms - np.log(tuning.REST_ACTIVE)) / tuning.REST_EDGE)
    )
    slope = -z / spread - price * active * (1.0 - active) / tuning.REST_EDGE
    level = 0.5 * (model.level / tuning.LEVEL_SPREAD) ** 2
    return float(-0.5 * z @ z - price * active.sum() - level), slope


@dataclass(frozen=True)
class Rest:
    """What is missing without a name.

    Attributes:
        odds: log odds that anything is, (n,).
        rms: size of each kind by joint, in units of the noise; ``"all"`` is that of all kinds together.
        level: log of how much quieter than measured the noise is, in power, (n,): below 0 there is something that no
            kind of the rest holds.
    """

    odds: Floats
    rms: tuple[dict[str, float], ...]
    level: Floats


@dataclass(frozen=True)
class Eliminated:
    """One joint without its rest.

    Attributes:
        information: on [T, torque], (t + 1, t + 1).
        log_evidence: of the joint, but for what T explains.
        root: lower root of the information on R, (r, r).
        towards: root^-1 times products of R with [T, torque], (r, t + 1).
        scale: power of the rows, as they count.
    """

    information: Floats
    log_evidence: float
    root: Floats
    towards: Floats
    scale: float


def lower_root(matrix: Floats) -> Floats:
    """Return the lower Cholesky root, of a matrix a little larger where rounding leaves none."""
    from scipy.linalg import lapack

    root, failed = lapack.dpotrf(matrix, lower=1, clean=1)
    if failed:
        size = np.sqrt(np.maximum(np.diag(matrix), 1e-300))
        values, V = np.linalg.eigh(matrix / np.outer(size, size))
        V = V * np.sqrt(np.maximum(values, 1e-13 * values[-1]))
        root = np.asarray(np.linalg.qr((size[:, None] * V).T)[1]).T
        root = root * np.sign(np.where(np.diag(root) == 0, 1.0, np.diag(root)))
    return np.asarray(root)


def forward(root: Floats, right: Floats) -> Floats:
    """Return root^-1 right."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(root, right, lower=True, check_finite=False))


def eliminated(model: JointModel, at: int) -> Eliminated:
    """Return a joint without its rest.

    Args:
        model: the joint.
        at: number of columns of T.
    """
    b, lam = float(np.exp(model.level)), model.precision
    R, outer = slice(at, at + len(lam)), np.r_[0:at, at + len(lam)]
    root = lower_root(b * model.gram[R, R] + np.diag(lam))
    towards = forward(root, b * model.gram[R][:, outer])
    value = 0.5 * model.count * model.level - np.log(np.diag(root)).sum() + 0.5 * np.log(lam).sum()
    information = b * model.gram[np.ix_(outer, outer)] - towards.T @ towards
    return Eliminated(information, float(value), root, towards, b)


@dataclass(frozen=True)
class Evidence:
    """Everything that explains the rows at one choice of names, with sizes of the rest.

    Attributes:
        joints: the joints.
        prior: precision of T, (t, t).
        held: precision times mean of T, (t,).
        price: log odds of something missing without a name.
        base: number of base parameters and errors that joints share, at the front of T.
    """

    joints: tuple[JointModel, ...]
    prior: Floats
    held: Floats
    price: float
    base: int

    @property
    def width(self) -> int:
        """Number of columns of T."""
        return len(self.held)

    @cached_property
    def parts(self) -> list[Eliminated]:
        """Each joint without its rest."""
        return [eliminated(model, self.width) for model in self.joints]

    @cached_property
    def whole(self) -> tuple[Floats, Floats]:
        """Lower root of the information on T, (t, t), and root^-1 of its right side, (t,)."""
        total = np.sum([part.information for part in self.parts], axis=0)
        root = lower_root(np.asarray(total[:-1, :-1] + self.prior))
        return root, forward(root, total[:-1, -1] + self.held)

    @property
    def estimate(self) -> Floats:
        """T as it is most likely, (t,)."""
        from scipy.linalg import solve_triangular

        root, right = self.whole
        return np.asarray(solve_triangular(root, right, lower=True, trans=1))

    @cached_property
    def log_evidence(self) -> float:
        """Log marginal likelihood, with the prior of sizes, up to a constant of the rows."""
        root, right = self.whole
        torque = sum(float(part.information[-1, -1]) for part in self.parts)
        sizes = sum(log_prior(model, model.log_rms, self.price)[0] for model in self.joints)
        value = (
            sum(part.log_evidence for part in self.parts)
            + sizes
            - float(np.log(np.diag(root)).sum())
        )
        # Why the determinant of what is added alone: that of the base never changes.
        _, size = np.linalg.slogdet(self.prior[self.base :, self.base :])
        return value + 0.5 * float(right @ right) - 0.5 * torque + 0.5 * float(size)

    def replaced(self, models: Mapping[int, JointModel]) -> Evidence:
        """Return the same with other joints, those that stay eliminated as they are."""
        joints = tuple(models.get(j, model) for j, model in enumerate(self.joints))
        found = replace(self, joints=joints)
        kept = [
            eliminated(m, self.width) if j in models else self.parts[j]
            for j, m in enumerate(joints)
        ]
        found.__dict__["parts"] = kept
        return found

    def with_columns(
        self, products: Mapping[int, tuple[Floats, Floats]], precision: Floats
    ) -> Evidence:
        """Return the evidence with further columns of T.

        Args:
            products: for each joint that they act on, their own products and those with [T, R, torque].
            precision: of their prior, (k, k).
        """
        k, t = len(precision), self.width
        joints = []
        for j, model in enumerate(self.joints):
            own, others = products.get(j, (np.zeros((k, k)), np.zeros((k, len(model.gram)))))
            joints.append(model.widened(own, others, t))
        prior = np.zeros((t + k, t + k))
        prior[:t, :t], prior[t:, t:] = self.prior, precision
        found = replace(
            self, joints=tuple(joints), prior=prior, held=np.append(self.held, np.zeros(k))
        )
        # Why: what the columns do not act on stays as it is, with zeros for them.
        order = np.r_[0:t, t + k]
        parts = []
        for j, (model, part) in enumerate(zip(joints, self.parts, strict=True)):
            if j in products:
                parts.append(eliminated(model, t + k))
                continue
            information, towards = (
                np.zeros((t + k + 1, t + k + 1)),
                np.zeros((len(part.root), t + k + 1)),
            )
            information[np.ix_(order, order)], towards[:, order] = part.information, part.towards
            parts.append(replace(part, information=information, towards=towards))
        found.__dict__["parts"] = parts
        return found

    def without(self, first: int, last: int) -> Evidence:
        """Return the evidence without some columns of T."""
        kept = np.r_[0:first, last : self.width]
        joints = []
        for model in self.joints:
            rows = np.r_[0:first, last : len(model.gram)]
            joints.append(replace(model, gram=model.gram[np.ix_(rows, rows)]))
        return replace(
            self, joints=tuple(joints), prior=self.prior[np.ix_(kept, kept)], held=self.held[kept]
        )

    def known_errors(self, first: int) -> KnownErrors:
        """Return what no effect has to explain, known errors as large as they are most likely.

        Args:
            first: number of base parameters, the first columns of T.
        """
        theta, own = self.estimate, []
        half = forward(self.whole[0], np.eye(self.width)[:, :first])
        for model, part in zip(self.joints, self.parts, strict=True):
            own.append(back(part.root, part.towards @ np.append(-theta, 1.0))[: model.errors])
        return KnownErrors(theta[first : self.base], np.array(own), half.T @ half)

    def rest(self) -> Rest:
        """Return what is missing without a name."""
        found, odds = [], np.zeros(len(self.joints))
        theta, t = self.estimate, self.width
        for j, model in enumerate(self.joints):
            part = self.parts[j]
            w = back(part.root, part.towards @ np.append(-theta, 1.0))
            # Why not all of it: what base parameters would take up is no sign of anything.
            G = (
                model.gram[:t, :t]
                + 1e-9 * np.diag(np.maximum(np.diag(model.gram)[:t], 1e-12))
                + 1e-12 * np.eye(t)
            )
            root = lower_root(G)
            columns = {
                name: np.arange(part.start, part.stop)
                for name, part in model.kinds
                if name in MISSING
            }
            columns["all"] = np.concatenate([np.zeros(0, dtype=int), *columns.values()])
            sizes = {}
            for name, at in columns.items():
                z = forward(root, model.gram[:t, t + at] @ w[at])
                power = float(w[at] @ model.gram[np.ix_(t + at, t + at)] @ w[at]) - float(z @ z)
                sizes[name] = float(np.sqrt(max(power, 0.0) / max(model.count, 1)))
            found.append(sizes)
            none = np.where(model.missing, LOG_RMS[0], model.log_rms)
            bare = replace(model, log_rms=none)
            odds[j] = self.log_evidence - self.replaced({j: bare}).log_evidence
            # Why without: the prior of sizes is no evidence for one.
            odds[j] += (
                log_prior(bare, none, self.price)[0]
                - log_prior(model, model.log_rms, self.price)[0]
            )
        return Rest(odds, tuple(found), np.array([model.level for model in self.joints]))

    # ------------------------------------------------------------ sizes
    def sized(self, joints: Sequence[int], *, level: bool = False) -> Evidence:
        """Return the evidence with the rest of some joints as large as is most likely, from two starts.

        Args:
            joints: these joints, 0-based.
            level: whether the power of the noise is found too.
        """
        found = self
        for j in (j for j in joints if self.joints[j].kinds):
            for _ in range(2 if level else 1):
                found = found.replaced({j: found._with_sizes(j)})
                if level:
                    found = found.replaced({j: found._with_level(j)})
        return found

    def _beside(self, j: int) -> tuple[Floats, Floats]:
        """Return information on R of one joint beside all that is common, (r, r), and its right side, (r,)."""
        model, t = self.joints[j], self.width
        b, r = float(np.exp(model.level)), len(model.gram) - 1 - t
        others = np.zeros((t + 1, t + 1)) + sum(
            part.information for i, part in enumerate(self.parts) if i != j
        )
        G = b * model.gram
        root = lower_root(np.asarray(G[:t, :t] + others[:-1, :-1] + self.prior))
        Z = forward(
            root, np.column_stack([G[:t, t : t + r], G[:t, -1] + others[:-1, -1] + self.held])
        )
        X = Z[:, :-1]
        return G[t : t + r, t : t + r] - X.T @ X, G[t : t + r, -1] - X.T @ Z[:, -1]

    def _with_sizes(self, j: int) -> JointModel:
        from scipy.optimize import minimize

        model = self.joints[j]
        S, s = self._beside(j)
        none = np.where(model.missing, np.minimum(model.log_rms, NONE), model.log_rms)

        def cost(h: Floats) -> tuple[float, Floats]:
            value, slope = _rest_evidence(replace(model, log_rms=h), S, s)
            prior, more = log_prior(model, h, self.price)
            return -value - prior, -slope - more

        runs = [
            minimize(
                cost,
                start,
                jac=True,
                method="L-BFGS-B",
                bounds=[LOG_RMS] * len(none),
                options={"maxiter": STEPS},
            )
            for start in (model.log_rms, none)
        ]
        best = min(runs, key=lambda run: float(run.fun))
        return replace(model, log_rms=np.asarray(best.x))

    def _with_level(self, j: int) -> JointModel:
        """Return one joint with its noise as loud as is most likely: one step towards what is left of its rows."""
        model = self.joints[j]
        part, lam = self.parts[j], model.precision
        root, _ = self.whole
        theta = self.estimate
        w = back(part.root, part.towards @ np.append(-theta, 1.0))
        all_of = np.concatenate([theta, w, [-1.0]])
        squares = float(all_of @ model.gram @ all_of)
        # How many parameters the rows use up: of T by this joint's share of what is known of them, and of R.
        inverse = forward(part.root, np.eye(len(lam)))
        moved = forward(root, back(part.root, part.towards[:, :-1]).T)
        used = float(np.trace(forward(root, forward(root, part.information[:-1, :-1]).T)))
        used += (
            len(lam)
            - float(lam @ np.sum(inverse**2, axis=0))
            - float(lam @ np.sum(moved**2, axis=0))
        )
        spread = tuning.LEVEL_SPREAD**2
        level = model.level
        for _ in range(5):
            slope = 0.5 * (model.count - used - np.exp(level) * squares) - level / spread
            level -= slope / (-0.5 * np.exp(level) * squares - 1.0 / spread)
        return replace(model, level=float(np.clip(level, -1.5, 1.5)))


def back(root: Floats, right: Floats) -> Floats:
    """Return root^-T right."""
    from scipy.linalg import solve_triangular

    return np.asarray(solve_triangular(root, right, lower=True, trans=1, check_finite=False))


def _rest_evidence(model: JointModel, S: Floats, s: Floats) -> tuple[float, Floats]:
    """Return the log evidence of a joint's sizes, and its slope, (kinds,).

    Args:
        model: the joint with its sizes.
        S: information of the rows on R beside all that is common, (r, r).
        s: its right side, (r,).
    """
    from scipy.linalg import lapack

    lam = model.precision
    root = lower_root(S + np.diag(lam))
    w = back(root, forward(root, s))
    value = 0.5 * np.log(lam).sum() - np.log(np.diag(root)).sum() + 0.5 * float(s @ w)
    inverse, _ = lapack.dpotri(root, lower=1)
    spread = lam * (w**2 + np.diag(inverse)) - 1.0
    return float(value), np.array([spread[part].sum() for _, part in model.kinds])


# ---------------------------------------------------------------- rows
@dataclass(frozen=True)
class EvidenceRows:
    """The whitened columns that everything is judged beside.

    Attributes:
        regression: rows with the base parameters.
        T: base parameters and errors that joints share, one (M, t) per joint.
        R: known errors of one joint and its rest, one (M, r) per joint.
    """

    regression: WhitenedRegression
    T: list[Floats]
    R: list[Floats]

    def products(
        self, columns: EffectColumns, more: Sequence[EffectColumns] = ()
    ) -> dict[int, tuple[Floats, Floats]]:
        """Return products of further columns with themselves and with [T, R, torque], by joint.

        Args:
            columns: {joint: (k, M)}.
            more: columns that have been added to T, one effect after the other.
        """
        found = {}
        for j, C in columns.items():
            added = [C @ one[j].T if j in one else np.zeros((len(C), _count(one))) for one in more]
            y = (C @ self.regression.joints[j].y)[:, None]
            found[j] = (C @ C.T, np.concatenate([C @ self.T[j], *added, C @ self.R[j], y], axis=1))
        return found


def _count(one: EffectColumns) -> int:
    return len(next(iter(one.values())))


def evidence_of(
    regression: WhitenedRegression, repeats: Sequence[RepeatPair]
) -> tuple[Evidence, EvidenceRows]:
    """Return the evidence of rows without any name, the rest sized.

    Args:
        regression: whitened rows with base parameters alone.
        repeats: segments of the same motion.
    """
    n, segments = len(regression.joints), regression.segments
    torques = [acceleration_torques(s) for s in segments]
    common = [common_columns(s, x) for s, x in zip(segments, torques, strict=True)]
    T, R, models = [], [], []
    for j, rows in enumerate(regression.joints):
        T.append(np.column_stack([rows.A, regression.whiten(j, [x[:, j] for x in common]).T]))
        errors = regression.whiten(
            j, [own_columns(s, j, x) for s, x in zip(segments, torques, strict=True)]
        )
        parts, kinds, at = [errors], [], len(errors)
        if errors[:SHARP].any():
            kinds.append((SHAPE, slice(0, SHARP)))
        for name, columns in rest_columns(segments, repeats, j).items():
            white = regression.whiten(j, columns)
            power = float(np.sum(white**2)) / max(white.shape[1], 1)
            seen = np.sum(white**2, axis=1) > 1e-9 * power * white.shape[1] / len(white)
            white = white[seen] / np.sqrt(max(power, 1e-12))
            if len(white):
                parts.append(white)
                kinds.append((name, slice(at, at + len(white))))
                at += len(white)
        R.append(np.concatenate(parts).T)
        X = np.column_stack([T[j], R[j], rows.y])
        usual = np.array([0.0 if name == SHAPE else np.log(tuning.REST_USUAL) for name, _ in kinds])
        models.append(JointModel(X.T @ X, len(rows.y), tuple(kinds), len(errors), usual))
    size, base = T[0].shape[1], regression.size
    prior, held = np.zeros((size, size)), np.zeros(size)
    known = sum(np.diag(model.gram)[:base] for model in models)
    prior[range(base), range(base)] = FLAT * np.maximum(known, 1e-12)
    prior[range(base, size), range(base, size)] = 1.0
    if regression.prior is not None:
        prior[:base, :base] += regression.prior[:, :-1].T @ regression.prior[:, :-1]
        held[:base] += regression.prior[:, :-1].T @ regression.prior[:, -1]
    found = Evidence(tuple(models), prior, held, float(np.log(7.0 * n)), size)
    return found.sized(range(n), level=True), EvidenceRows(regression, T, R)
