"""The one criterion: log marginal likelihood of rows by frequency, with what has no name sized by it.

    torque = base parameters + named effects + errors that all joints share      (T, common to all joints)
           + known errors of one joint + functions of the state without a name   (R, of one joint alone)
           + noise, louder in each band by what follows no state

All are Gaussian, so the integral over everything is in closed form. The rest of one joint is eliminated by itself
(Schur complement), which leaves a small matrix over what is common; sizes of kinds of the rest and powers of bands
maximise the result. No row is touched again for another size: products are kept band by band.

Source: MacKay 1992, "Bayesian interpolation", for sizes by evidence; Kass and Raftery 1995, "Bayes factors".
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import lapack, solve_triangular

from dynid.gap import tuning
from dynid.gap.bands import Bands
from dynid.gap.known_errors import (
    SHARP,
    KnownErrors,
    acceleration_torques,
    common_columns,
    own_columns,
)
from dynid.gap.noise import RepeatPair
from dynid.gap.rest import rest_columns
from dynid.gap.whitened_regression import EffectColumns, WhitenedRegression
from dynid.model.effects.interface import Floats

#: Products of columns with themselves and with [T, R, torque], band by band, (B, k, k) and (B, k, t + r + 1).
Products = tuple[Floats, Floats]

#: Prior precision of base parameters over what the rows know of them: none.
FLAT = 1e-16
#: Least and largest log rms of a kind of the rest, in units of the noise, and that of one that is not there.
LOG_RMS, NONE = (-6.0, 5.0), -4.0
#: How much quieter than measured a band may be, in the logarithm of its power.
QUIETER = -1.5
#: The kind that is the shape of reversals, in shares of Coulomb friction.
SHAPE = "shape"
#: Steps of sizing, and of the first one, from nothing.
STEPS, FIRST_STEPS = 8, 20


@dataclass(frozen=True)
class JointModel:
    """The rows of one joint as products.

    Attributes:
        grams: of [T, R, torque] in each band, (B, t + r + 1, t + r + 1).
        counts: number of rows of each, (B,).
        kinds: where the columns of each kind of the rest are among R; the shape of reversals comes first, then known
            errors of one size.
        errors: number of known errors of this joint.
        log_rms: size of each kind, (kinds,).
        powers: log of the power of each band that follows nothing, over that of the noise, (B,).
    """

    grams: Floats
    counts: Floats
    kinds: tuple[tuple[str, slice], ...]
    errors: int
    log_rms: Floats
    powers: Floats

    @cached_property
    def precision(self) -> Floats:
        """Prior precision of R, (r,)."""
        found = np.ones(max([self.errors, *(part.stop for _, part in self.kinds)]))
        for (_, part), h in zip(self.kinds, self.log_rms, strict=True):
            found[part] = np.exp(-2.0 * h)
        return found

    @cached_property
    def gram(self) -> Floats:
        """Products over all bands, all alike."""
        return np.asarray(self.grams.sum(axis=0))

    @property
    def missing(self) -> NDArray[np.bool_]:
        """Which kinds are something that is missing, and no shape of reversals, (kinds,)."""
        return np.array([name != SHAPE for name, _ in self.kinds], dtype=bool)

    @property
    def level(self) -> float:
        """Power of what follows no state over that of the noise, over all bands, which is in it."""
        return float(self.counts @ np.exp(self.powers) / max(self.counts.sum(), 1e-9))

    @property
    def bare(self) -> JointModel:
        """The joint with hardly anything missing."""
        none = np.where(self.missing, np.minimum(self.log_rms, NONE), self.log_rms)
        return replace(self, log_rms=none, powers=np.minimum(self.powers, 0.0))

    @property
    def usual(self) -> tuple[Floats, Floats]:
        """How far each size is from what is usual, in spreads of its logarithm, and these, (kinds,)."""
        spread = np.where(self.missing, tuning.REST_SPREAD, tuning.SHARPER_SPREAD)
        away = self.log_rms - np.where(self.missing, np.log(tuning.REST_USUAL), 0.0)
        return away / spread, spread

    def log_prior(self, price: float) -> float:
        """Return the log prior of sizes and powers.

        Args:
            price: of something that is missing, in log odds.
        """
        z, _ = self.usual
        active = self.missing / (
            1.0 + np.exp(-(self.log_rms - np.log(tuning.REST_ACTIVE)) / tuning.REST_EDGE)
        )
        bands = self.powers + np.exp(-self.powers) - 1.0
        return float(-0.5 * z @ z - price * active.sum() - 0.5 * tuning.BAND_ROWS * bands.sum())

    def widened(self, products: Products, at: int) -> JointModel:
        """Return the model with k further columns of T, as the columns from ``at`` on."""
        own, others = products
        k, size = own.shape[-1], self.grams.shape[-1]
        order, new = np.r_[0:at, at + k : size + k], np.arange(at, at + k)
        grams = np.zeros((len(self.grams), size + k, size + k))
        grams[:, order[:, None], order] = self.grams
        grams[:, new[:, None], order] = others
        grams[:, order[:, None], new] = others.transpose(0, 2, 1)
        grams[:, new[:, None], new] = own
        return replace(self, grams=grams)


@dataclass(frozen=True)
class Rest:
    """What is missing without a name.

    Attributes:
        odds: log odds that anything is, (n,).
        rms: size of all kinds together by joint, in units of the noise, (n,).
        level: power of what follows no state over that of the noise, (n,).
    """

    odds: Floats
    rms: Floats
    level: Floats


@dataclass(frozen=True)
class Eliminated:
    """One joint without its rest.

    Attributes:
        information: on [T, torque], (t + 1, t + 1).
        log_evidence: of the joint, but for what T explains.
        root: lower root of the information on R, (r, r).
        towards: root^-1 times products of R with [T, torque], (r, t + 1).
        weights: of the bands, (B,).
    """

    information: Floats
    log_evidence: float
    root: Floats
    towards: Floats
    weights: Floats


def lower_root(matrix: Floats) -> Floats:
    """Return the lower Cholesky root, of a matrix a little larger where rounding leaves none."""
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
    return np.asarray(solve_triangular(root, right, lower=True, check_finite=False))


def back(root: Floats, right: Floats) -> Floats:
    """Return root^-T right."""
    return np.asarray(solve_triangular(root, right, lower=True, trans=1, check_finite=False))


def eliminated(model: JointModel, at: int) -> Eliminated:
    """Return a joint without its rest.

    Args:
        model: the joint.
        at: number of columns of T.
    """
    weights, lam = np.exp(-model.powers), model.precision
    gram = np.tensordot(weights, model.grams, 1)
    R, outer = slice(at, at + len(lam)), np.r_[0:at, at + len(lam)]
    root = lower_root(gram[R, R] + np.diag(lam))
    towards = forward(root, gram[R][:, outer])
    value = -0.5 * model.counts @ model.powers + 0.5 * np.log(lam).sum()
    value -= np.log(np.diag(root)).sum()
    information = gram[np.ix_(outer, outer)] - towards.T @ towards
    return Eliminated(information, float(value), root, towards, weights)


@dataclass(frozen=True)
class Evidence:
    """Everything that explains the rows at one choice of names, with sizes of the rest.

    Attributes:
        joints: the joints.
        prior: precision of T, (t, t).
        held: precision times mean of T, (t,).
        price: log odds of something missing without a name.
        base: number of base parameters and errors that joints share, at the front of T.
        shared: number of these errors, behind the base parameters.
    """

    joints: tuple[JointModel, ...]
    prior: Floats
    held: Floats
    price: float
    base: int
    shared: int

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

    @cached_property
    def estimate(self) -> Floats:
        """T as it is most likely, (t,)."""
        return back(*self.whole)

    @cached_property
    def log_evidence(self) -> float:
        """Log marginal likelihood, with the prior of sizes, up to a constant of the rows."""
        root, right = self.whole
        torque = sum(float(part.information[-1, -1]) for part in self.parts)
        value = sum(part.log_evidence for part in self.parts)
        value += sum(model.log_prior(self.price) for model in self.joints)
        # Why the determinant of what is added alone: that of the base never changes.
        _, size = np.linalg.slogdet(self.prior[self.base :, self.base :])
        value -= float(np.log(np.diag(root)).sum())
        return value + 0.5 * float(right @ right) - 0.5 * torque + 0.5 * float(size)

    def replaced(self, models: Mapping[int, JointModel]) -> Evidence:
        """Return the same with other joints, those that stay eliminated as they are."""
        joints = tuple(models.get(j, model) for j, model in enumerate(self.joints))
        found = replace(self, joints=joints)
        found.__dict__["parts"] = [
            eliminated(m, self.width) if j in models else self.parts[j]
            for j, m in enumerate(joints)
        ]
        return found

    @cached_property
    def without_rest(self) -> Evidence:
        """The evidence with hardly anything missing."""
        return self.replaced({j: model.bare for j, model in enumerate(self.joints)})

    @cached_property
    def with_half(self) -> Evidence:
        """The evidence with what is missing half as large, in the logarithm."""
        half = {}
        for j, (one, none) in enumerate(zip(self.joints, self.without_rest.joints, strict=True)):
            half[j] = replace(
                one,
                log_rms=0.5 * (one.log_rms + none.log_rms),
                powers=0.5 * (one.powers + none.powers),
            )
        return self.replaced(half)

    def with_columns(self, products: Mapping[int, Products], precision: Floats) -> Evidence:
        """Return the evidence with further columns of T.

        Args:
            products: for each joint that they act on, their own products and those with [T, R, torque].
            precision: of their prior, (k, k).
        """
        k, t = len(precision), self.width
        joints = []
        for j, model in enumerate(self.joints):
            bands, size, _ = model.grams.shape
            none = np.zeros((bands, k, k)), np.zeros((bands, k, size))
            joints.append(model.widened(products.get(j, none), t))
        prior = np.zeros((t + k, t + k))
        prior[:t, :t], prior[t:, t:] = self.prior, precision
        held = np.append(self.held, np.zeros(k))
        found = replace(self, joints=tuple(joints), prior=prior, held=held)
        # Why: where they do not act all stays as it is, with zeros for them.
        order = np.r_[0:t, t + k]
        parts = []
        for j, (model, part) in enumerate(zip(joints, self.parts, strict=True)):
            if j in products:
                parts.append(eliminated(model, t + k))
                continue
            information = np.zeros((t + k + 1, t + k + 1))
            towards = np.zeros((len(part.root), t + k + 1))
            information[np.ix_(order, order)], towards[:, order] = part.information, part.towards
            parts.append(replace(part, information=information, towards=towards))
        found.__dict__["parts"] = parts
        return found

    def without(self, first: int, last: int) -> Evidence:
        """Return the evidence without some columns of T."""
        kept = np.r_[0:first, last : self.width]
        outer = np.append(kept, self.width)
        joints, parts = [], []
        for model, part in zip(self.joints, self.parts, strict=True):
            rows = np.r_[0:first, last : model.grams.shape[-1]]
            joints.append(replace(model, grams=model.grams[:, rows[:, None], rows]))
            information = part.information[np.ix_(outer, outer)]
            parts.append(replace(part, information=information, towards=part.towards[:, outer]))
        found = replace(
            self, joints=tuple(joints), prior=self.prior[np.ix_(kept, kept)], held=self.held[kept]
        )
        # Why as they are: what is eliminated of a joint does not depend on which columns are common.
        found.__dict__["parts"] = parts
        return found

    def rest_of(self, joint: int) -> Floats:
        """Return R of a joint as it is most likely, (r,)."""
        part = self.parts[joint]
        return back(part.root, part.towards @ np.append(-self.estimate, 1.0))

    def known_errors(self, first: int) -> KnownErrors:
        """Return what no effect has to explain, known errors as large as they are most likely.

        Args:
            first: number of base parameters, the first columns of T.
        """
        half = forward(self.whole[0], np.eye(self.width)[:, :first])
        own = [self.rest_of(j)[: model.errors] for j, model in enumerate(self.joints)]
        return KnownErrors(self.estimate[first : self.base], np.array(own), half.T @ half)

    def seen(self, columns: slice, size: Floats, joints: Sequence[int]) -> Floats:
        """Return the rms of what some columns say that base parameters and names cannot, in units of the noise, (n,).

        Args:
            columns: among [T, R].
            size: of each.
            joints: on which they act.
        """
        # Why without errors that joints share: these are small, and would take up a delay of any size here.
        others = np.r_[0 : self.base - self.shared, self.base : self.width]
        others = others[(others < columns.start) | (others >= columns.stop)]
        G = np.sum([model.gram[np.ix_(others, others)] for model in self.joints], axis=0)
        G = G + self.prior[np.ix_(others, others)]
        ridge = 1e-9 * np.maximum(np.diag(G), 1e-12) + 1e-12
        right = np.sum([self.joints[j].gram[others, columns] @ size for j in joints], axis=0)
        root = lower_root(G + np.diag(ridge))
        taken = back(root, forward(root, right))
        found = np.zeros(len(self.joints))
        for j, model in enumerate(self.joints):
            power = float(taken @ model.gram[np.ix_(others, others)] @ taken)
            if j in joints:
                own = size @ model.gram[columns, columns] @ size
                power += float(own - 2.0 * taken @ model.gram[others, columns] @ size)
            found[j] = max(power, 0.0) / max(float(model.counts.sum()), 1.0)
        return np.sqrt(found)

    def rest(self) -> Rest:
        """Return what is missing without a name."""
        odds, rms = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        for j, model in enumerate(self.joints):
            w = self.rest_of(j)
            columns = slice(self.width + model.errors, self.width + len(w))
            rms[j] = self.seen(columns, w[model.errors :], [j])[j]
            bare = replace(model, log_rms=np.where(model.missing, LOG_RMS[0], model.log_rms))
            odds[j] = self.log_evidence - self.replaced({j: bare}).log_evidence
            # Why without: the prior of sizes is no evidence for one.
            odds[j] += bare.log_prior(self.price) - model.log_prior(self.price)
        return Rest(odds, rms, np.array([model.level for model in self.joints]))

    # ------------------------------------------------------------ sizes
    def sized(self, joints: Sequence[int], steps: int = STEPS) -> Evidence:
        """Return the evidence with rest and bands of some joints as large as is most likely.

        Args:
            joints: these joints, 0-based.
            steps: of MacKay's fixed point.
        """
        found = self
        for _ in range(steps):
            inverse = forward(found.whole[0], np.eye(self.width))
            covariance = inverse.T @ inverse
            found = found.replaced({j: found._step(j, covariance) for j in joints})
        for j in joints:
            for k, (name, _) in enumerate(found.joints[j].kinds):
                model = found.joints[j]
                if name == SHAPE or model.log_rms[k] <= NONE:
                    continue
                sizes = model.log_rms.copy()
                sizes[k] = NONE
                other = found.replaced({j: replace(model, log_rms=sizes)})
                found = other if other.log_evidence > found.log_evidence else found
        return found

    def _step(self, j: int, S: Floats) -> JointModel:
        """Return a joint with sizes and powers after one step towards what its rows say.

        Args:
            j: the joint.
            S: covariance of T, (t, t).
        """
        model, part = self.joints[j], self.parts[j]
        lam, w = model.precision, self.rest_of(j)
        half = forward(part.root, np.eye(len(lam)))
        along = back(part.root, part.towards[:, :-1])
        across = -S @ along.T
        own = half.T @ half - along @ across
        sizes, pull = model.log_rms.copy(), model.usual[0] / model.usual[1]
        for k, (_, rows) in enumerate(model.kinds):
            free = max(len(lam[rows]) - float(lam[rows] @ np.diag(own)[rows]), 1e-9)
            more, square = pull[k], float(w[rows] @ w[rows])
            square += max(-more, 0.0) * np.exp(2.0 * sizes[k])
            sizes[k] = 0.5 * np.log(max(square, 1e-300) / (free + max(more, 0.0)))
        full = np.concatenate([self.estimate, w, [-1.0]])
        spread = np.block([[S, across], [across.T, own]])
        left = np.einsum("a,bac,c->b", full, model.grams, full, optimize=True)
        left += np.einsum("ac,bac->b", spread, model.grams[:, :-1, :-1])
        more = tuning.BAND_ROWS
        powers = np.log((left + more) / (model.counts + more))
        return replace(model, log_rms=np.clip(sizes, *LOG_RMS), powers=np.maximum(powers, QUIETER))


# ---------------------------------------------------------------- rows
@dataclass(frozen=True)
class EvidenceRows:
    """The columns that everything is judged beside, by frequency.

    Attributes:
        bands: how rows become rows by frequency.
        own: base parameters and errors that joints share, then known errors of one joint and its rest, then its
            torque, one (t + r + 1, F) per joint.
        filtered: the known errors and the rest of each joint as they are filtered, one (r, M) per segment.
        common: number of columns that joints share.
    """

    bands: Bands
    own: list[Floats]
    filtered: list[list[Floats]]
    common: int

    @property
    def regression(self) -> WhitenedRegression:
        """The whitened rows."""
        return self.bands.regression

    def with_regression(self, regression: WhitenedRegression) -> EvidenceRows:
        """Return the rows with effects that scale with another model."""
        return replace(self, bands=replace(self.bands, regression=regression))

    def products(self, joint: int, C: Floats, added: Sequence[EffectColumns] = ()) -> Products:
        """Return products of further columns, (..., k, F), with themselves and with [T, R, torque].

        Args:
            joint: 0-based.
            C: the columns.
            added: columns that have been added to T, one effect after the other.
        """
        flat = C.reshape(-1, C.shape[-1])
        more = [
            one[joint] if joint in one else np.zeros((_count(one), C.shape[-1])) for one in added
        ]
        own = self.own[joint]
        whole = np.concatenate([own[: self.common], *more, own[self.common :]])
        return self.bands.products(C, C), self.bands.products(flat, whole)


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
    n, segments, bands = len(regression.joints), regression.segments, Bands.of(regression, repeats)
    torques = [acceleration_torques(s) for s in segments]
    common = [common_columns(s, x) for s, x in zip(segments, torques, strict=True)]
    every, filtered, models = [], [], []
    for j in range(n):
        shared = [
            np.concatenate([s.W[:, j].T, x[:, j]]) for s, x in zip(segments, common, strict=True)
        ]
        parts = [[own_columns(s, j, x) for s, x in zip(segments, torques, strict=True)]]
        white = [bands.rows(j, parts[0])]
        kinds, at, counts = [], len(white[0]), bands.counts(j)
        if white[0][:SHARP].any():
            kinds.append((SHAPE, slice(0, SHARP)))
        for name, columns in rest_columns(segments, j).items():
            rows = bands.rows(j, columns)
            size = np.sqrt(max(float(np.sum(rows**2)) / max(float(counts.sum()), 1.0), 1e-12))
            kinds.append((name, slice(at, at + len(rows))))
            white.append(rows / size)
            parts.append([x / size for x in columns])
            at += len(rows)
        torque = bands.rows(j, [s.tau[:, j][None] for s in segments])
        T = bands.rows(j, shared)
        every.append(np.concatenate([T, *white, torque]))
        filtered.append([np.concatenate(x) for x in zip(*parts, strict=True)])
        usual = np.array([0.0 if name == SHAPE else np.log(tuning.REST_USUAL) for name, _ in kinds])
        grams = bands.products(every[j], every[j])
        powers = np.zeros(len(counts))
        models.append(JointModel(grams, counts, tuple(kinds), len(white[0]), usual, powers))
    size, base = len(T), segments[0].W.shape[2]
    prior, held = np.zeros((size, size)), np.zeros(size)
    known = sum(np.diag(model.gram)[:base] for model in models)
    prior[range(base), range(base)] = FLAT * np.maximum(known, 1e-12)
    prior[range(base, size), range(base, size)] = 1.0
    if regression.prior is not None:
        prior[:base, :base] += regression.prior[:, :base].T @ regression.prior[:, :base]
        held[:base] += regression.prior[:, :base].T @ regression.prior[:, -1]
    found = Evidence(tuple(models), prior, held, float(np.log(7.0 * n)), size, size - base)
    return found.sized(range(n), FIRST_STEPS), EvidenceRows(bands, every, filtered, size)
