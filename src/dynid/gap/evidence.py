"""The one criterion: log marginal likelihood of rows by frequency, with what has no name sized by it.

    torque = base parameters + errors that all joints share + named effects      (T, common to all joints)
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
from functools import cached_property, partial

import numpy as np
from scipy.linalg import lapack

from dynid.arrays import Floats, Mask
from dynid.gap import tuning
from dynid.gap.bands import Bands, instants
from dynid.gap.gap_rows import EffectColumns, GapRows, on_joint
from dynid.gap.known_errors import SHARP, error_columns
from dynid.gap.problem import GapProblem
from dynid.gap.rest import rest_columns
from dynid.model.effects.catalogue import joined_motion

#: Products of columns with themselves and with [R, torque, T], band by band, (B, k, k) and (B, k, s).
Products = tuple[Floats, Floats]

#: Prior precision of base parameters over what the rows know of them: none; and that of what is zero.
FLAT, FIXED = 1e-16, 1e30
#: Shares by which a diagonal is taken larger, the smallest that does.
ROUNDING = 10.0 ** np.arange(-13, 0)
#: Least and largest log rms of a kind of the rest, in units of the noise, and that of one that is not there.
LOG_RMS, NONE = (-6.0, 5.0), -4.0
#: How much quieter than measured a band may be, in the logarithm of its power.
QUIETER = -1.5
#: The kind that is the shape of reversals, in shares of Coulomb friction.
SHAPE = "shape"
#: Steps of sizing, and of the first one, from nothing: after 20 of these the next ones still gained 2.2 in the evidence
#: of LWR4+ recordings, which every candidate counted for itself, and a tilt of the base was named for an offset.
STEPS, FIRST_STEPS = 8, 60


def forward(root: Floats, right: Floats, trans: int = 0) -> Floats:
    """Return root^-1 times a right side, the root being lower; of a transposed root where ``trans`` is 1."""
    return lapack.dtrtrs(root, right, lower=1, trans=trans)[0]


#: The same with root^-T.
back = partial(forward, trans=1)


def lower_root(matrix: Floats) -> Floats:
    """Return the lower Cholesky root, of a matrix with a larger diagonal where rounding leaves none."""
    for more in (0.0, *ROUNDING):
        larger = matrix + np.diag(more * np.diag(matrix))
        root, failed = lapack.dpotrf(larger, lower=1, clean=1)
        if not failed:
            break
    return np.asarray(root)


@dataclass(frozen=True)
class JointModel:
    """The rows of one joint as products.

    Attributes:
        grams: of [R, torque, T] in each band, (B, s, s).
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
    def own(self) -> int:
        """Number of columns of R, r; the torque is behind them, and T behind that."""
        return int(max([self.errors, *(part.stop for _, part in self.kinds)]))

    @cached_property
    def precision(self) -> Floats:
        """Prior precision of R, (r,)."""
        precision = np.ones(self.own)
        for (_, part), h in zip(self.kinds, self.log_rms, strict=True):
            precision[part] = np.exp(-2.0 * h)
        return precision

    @cached_property
    def plain(self) -> Floats:
        """Products over all bands, all alike."""
        return self.grams.sum(axis=0)

    @cached_property
    def weights(self) -> Floats:
        """Of the bands, (B,)."""
        return np.exp(-self.powers)

    @cached_property
    def gram(self) -> Floats:
        """Products over all bands, each as its power weighs it."""
        return np.tensordot(self.weights, self.grams, 1)

    @cached_property
    def root(self) -> Floats:
        """Lower root of the information on R, (r, r)."""
        return lower_root(self.gram[: self.own, : self.own] + np.diag(self.precision))

    @cached_property
    def towards(self) -> Floats:
        """Root^-1 times products of R with [torque, T], (r, t + 1)."""
        return forward(self.root, self.gram[: self.own, self.own :])

    @cached_property
    def information(self) -> Floats:
        """On [torque, T], R being eliminated, (t + 1, t + 1)."""
        return self.gram[self.own :, self.own :] - self.towards.T @ self.towards

    @property
    def log_evidence(self) -> float:
        """Of the joint, but for what T explains."""
        value = -0.5 * self.counts @ self.powers + 0.5 * np.log(self.precision).sum()
        return float(value - np.log(np.diag(self.root)).sum())

    @property
    def missing(self) -> Mask:
        """Which kinds are something that is missing, and no shape of reversals, (kinds,)."""
        return np.array([name != SHAPE for name, _ in self.kinds], dtype=bool)

    @property
    def level(self) -> float:
        """Power of what follows no state over that of the noise, over all bands, which is in it."""
        return float(self.counts @ np.exp(self.powers) / max(self.counts.sum(), 1e-9))

    def smaller(self, share: float) -> JointModel:
        """Return the joint with what is missing that much nearer to hardly anything, 0 to 1, in the logarithm."""
        none = np.where(self.missing, np.minimum(self.log_rms, NONE), self.log_rms)
        sizes = (1.0 - share) * self.log_rms + share * none
        powers = (1.0 - share) * self.powers + share * np.minimum(self.powers, 0.0)
        return replace(self, log_rms=sizes, powers=powers)

    @property
    def usual(self) -> tuple[Floats, Floats]:
        """How far each size is from what is usual, in spreads of its logarithm, and these, (kinds,)."""
        spread = np.where(self.missing, tuning.REST_SPREAD, tuning.SHARPER_SPREAD)
        away = self.log_rms - np.where(self.missing, np.log(tuning.REST_USUAL), 0.0)
        return away / spread, spread

    def log_prior(self, price: float) -> float:
        """Return the log prior of sizes and powers; the price is of something that is missing, in log odds."""
        z, _ = self.usual
        over = (self.log_rms - np.log(tuning.REST_ACTIVE)) / tuning.REST_EDGE
        active = self.missing / (1.0 + np.exp(-over))
        bands = self.powers + np.exp(-self.powers) - 1.0
        return float(-0.5 * z @ z - price * active.sum() - 0.5 * tuning.BAND_ROWS * bands.sum())

    def widened(self, products: Products | None, count: int) -> JointModel:
        """Return the model with so many further columns of T; None for zeros."""
        bands, size, _ = self.grams.shape
        grams = np.zeros((bands, size + count, size + count))
        grams[:, :size, :size] = self.grams
        if products is not None:
            own, others = products
            grams[:, size:, size:], grams[:, size:, :size] = own, others
            grams[:, :size, size:] = others.transpose(0, 2, 1)
        return replace(self, grams=grams)


@dataclass(frozen=True)
class Rest:
    """What is missing without a name.

    Attributes:
        odds: log odds that anything is, (n,).
        rms: size of all kinds together by joint, in units of the noise, (n,).
        level: power of what follows no state over that of the noise, (n,).
        quiet: the same in the quietest band, at most 1, (n,).
    """

    odds: Floats
    rms: Floats
    level: Floats
    quiet: Floats


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
    def whole(self) -> tuple[Floats, Floats]:
        """Lower root of the information on T, (t, t), and root^-1 of its right side, (t,)."""
        total = np.sum([model.information for model in self.joints], axis=0)
        root = lower_root(np.asarray(total[1:, 1:] + self.prior))
        return root, forward(root, total[1:, 0] + self.held)

    @cached_property
    def estimate(self) -> Floats:
        """T as it is most likely, (t,)."""
        return back(*self.whole)

    @cached_property
    def covariance(self) -> Floats:
        """Of T, (t, t)."""
        half = forward(self.whole[0], np.eye(self.width))
        return half.T @ half

    @cached_property
    def log_evidence(self) -> float:
        """Log marginal likelihood, with the prior of sizes, up to a constant of the rows."""
        root, right = self.whole
        value = sum(
            model.log_evidence + model.log_prior(self.price) - 0.5 * float(model.information[0, 0])
            for model in self.joints
        )
        # Why the determinant of what is added alone: that of the base never changes.
        _, size = np.linalg.slogdet(self.prior[self.base :, self.base :])
        value -= float(np.log(np.diag(root)).sum())
        return value + 0.5 * float(right @ right) + 0.5 * float(size)

    def replaced(self, models: Mapping[int, JointModel]) -> Evidence:
        """Return the same with other joints."""
        joints = tuple(models.get(j, model) for j, model in enumerate(self.joints))
        return replace(self, joints=joints)

    def smaller(self, share: float) -> Evidence:
        """Return the evidence with what is missing that much nearer to hardly anything, 0 to 1, in the logarithm."""
        return replace(self, joints=tuple(model.smaller(share) for model in self.joints))

    def sized_as(self, other: Evidence) -> Evidence:
        """Return the evidence with the sizes and powers of another one."""
        pairs = zip(self.joints, other.joints, strict=True)
        joints = tuple(replace(x, log_rms=y.log_rms, powers=y.powers) for x, y in pairs)
        return replace(self, joints=joints)

    def with_columns(self, products: Mapping[int, Products], precision: Floats) -> Evidence:
        """Return the evidence with k further columns of T.

        Args:
            products: for each joint that they act on, their own products and those with [R, torque, T].
            precision: of their prior, (k, k).
        """
        k, t = len(precision), self.width
        joints = tuple(model.widened(products.get(j), k) for j, model in enumerate(self.joints))
        prior = np.zeros((t + k, t + k))
        prior[:t, :t], prior[t:, t:] = self.prior, precision
        return replace(self, joints=joints, prior=prior, held=np.append(self.held, np.zeros(k)))

    def without(self, columns: slice) -> Evidence:
        """Return the evidence with some columns of T held at zero."""
        prior = self.prior.copy()
        prior[columns, columns] += FIXED * np.eye(len(prior[columns]))
        return replace(self, prior=prior)

    def rest_of(self, joint: int) -> Floats:
        """Return R of a joint as it is most likely, (r,)."""
        model = self.joints[joint]
        return back(model.root, model.towards @ np.append(1.0, -self.estimate))

    def seen(self, size: Floats, joints: Sequence[int], part: slice | None = None) -> Floats:
        """Return the rms of what some columns say that base parameters and names cannot, in units of the noise, (n,).

        Args:
            size: of each.
            joints: on which they act.
            part: where they are among T; None for the rest of a joint.
        """
        # Why without errors that joints share: these are small, and would take up a delay of any size here.
        T = np.r_[: self.base - self.shared, self.base : self.width]
        T = T if part is None else T[(part.start > T) | (part.stop <= T)]
        gram, side, torques = self.prior[np.ix_(T, T)], np.zeros(len(T)), []
        for j, model in enumerate(self.joints):
            torque, behind = np.zeros(len(model.plain)), model.own + 1
            if j in joints:
                own = torque[model.errors : model.own] if part is None else torque[behind:][part]
                own[:] = size
            gram = gram + model.plain[behind:, behind:][np.ix_(T, T)]
            side += model.plain[behind + T] @ torque
            torques.append(torque)
        ridge = 1e-9 * np.maximum(np.diag(gram), 1e-12) + 1e-12
        taken, power = np.linalg.solve(gram + np.diag(ridge), side), []
        for model, torque in zip(self.joints, torques, strict=True):
            torque[model.own + 1 + T] -= taken
            power.append(torque @ model.plain @ torque / max(float(model.counts.sum()), 1.0))
        return np.sqrt(np.maximum(power, 0.0))

    def rest(self) -> Rest:
        """Return what is missing without a name."""
        odds, rms = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        for j, model in enumerate(self.joints):
            rms[j] = self.seen(self.rest_of(j)[model.errors :], [j])[j]
            bare = replace(model, log_rms=np.where(model.missing, LOG_RMS[0], model.log_rms))
            odds[j] = self.log_evidence - self.replaced({j: bare}).log_evidence
            # Why without: the prior of sizes is no evidence for one.
            odds[j] += bare.log_prior(self.price) - model.log_prior(self.price)
        level = np.array([model.level for model in self.joints])
        quiet = np.exp([min(model.powers.min(), 0.0) for model in self.joints])
        return Rest(odds, rms, level, quiet)

    # ------------------------------------------------------------ sizes
    def sized(self, steps: int = STEPS) -> Evidence:
        """Return the evidence with rest and bands as large as is most likely, after steps of MacKay's fixed point."""
        evidence, joints = self, range(len(self.joints))
        for _ in range(steps):
            evidence = evidence.replaced({j: evidence._step(j) for j in joints})
        for j in joints:
            for k, missing in enumerate(self.joints[j].missing):
                model = evidence.joints[j]
                if missing and model.log_rms[k] > NONE:
                    sizes = np.where(np.arange(len(model.kinds)) == k, NONE, model.log_rms)
                    other = evidence.replaced({j: replace(model, log_rms=sizes)})
                    evidence = other if other.log_evidence > evidence.log_evidence else evidence
        return evidence

    def _step(self, j: int) -> JointModel:
        """Return a joint with sizes and powers after one step towards what its rows say."""
        model, w, S = self.joints[j], self.rest_of(j), self.covariance
        lam, root = model.precision, model.root
        half = forward(root, np.eye(len(lam)))
        along = back(root, model.towards[:, 1:])
        across = -S @ along.T
        own = half.T @ half - along @ across
        sizes, pull = model.log_rms.copy(), model.usual[0] / model.usual[1]
        for k, (_, rows) in enumerate(model.kinds):
            free = max(len(lam[rows]) - float(lam[rows] @ np.diag(own)[rows]), 1e-9)
            more, square = pull[k], float(w[rows] @ w[rows])
            square += max(-more, 0.0) * np.exp(2.0 * sizes[k])
            sizes[k] = 0.5 * np.log(max(square, 1e-300) / (free + max(more, 0.0)))
        full = np.concatenate([w, [-1.0], self.estimate])
        spread = np.block([[own, across.T], [across, S]])
        spread = np.insert(np.insert(spread, model.own, 0.0, axis=0), model.own, 0.0, axis=1)
        left = model.grams @ full @ full + np.tensordot(model.grams, spread, 2)
        more = tuning.BAND_ROWS
        powers = np.log((left + more) / (model.counts + more))
        return replace(model, log_rms=np.clip(sizes, *LOG_RMS), powers=np.maximum(powers, QUIETER))


# ---------------------------------------------------------------- rows
@dataclass(frozen=True)
class EvidenceRows:
    """The columns that everything is judged beside, by frequency.

    Attributes:
        bands: how rows become rows by frequency.
        own: [R, torque, T] of each joint, (s, F).
        filtered: R of each joint as it is filtered, (r, M).
        common: errors that all joints share, filtered, (c, n, M).
    """

    bands: Bands
    own: list[Floats]
    filtered: list[Floats]
    common: Floats

    @property
    def rows(self) -> GapRows:
        """The rows in time."""
        return self.bands.rows

    def common_torque(self, evidence: Evidence) -> Floats:
        """Return the errors that all joints share as large as they are most likely, (n, M)."""
        size = evidence.estimate[evidence.base - len(self.common) : evidence.base]
        return np.tensordot(size, self.common, 1)

    def known_power(self, evidence: Evidence) -> Floats:
        """Return the expected square of what no effect has to explain, (M, n).

        Known errors, each as large as it is most likely, and unsure base parameters.
        """
        W, torque = self.rows.W, self.common_torque(evidence)
        unsure = evidence.covariance[: W.shape[2], : W.shape[2]]
        for j, model in enumerate(evidence.joints):
            known = slice(model.errors)
            torque[j] += evidence.rest_of(j)[known] @ self.filtered[j][known]
        return np.einsum("mjp,pq,mjq->mj", W, unsure, W, optimize=True) + torque.T**2

    def with_name(self, columns: EffectColumns) -> EvidenceRows:
        """Return the rows with the columns of a name behind the others of T, {joint: (k, F)}."""
        own = [
            np.concatenate([x, on_joint(columns, j, x.shape[1])]) for j, x in enumerate(self.own)
        ]
        return replace(self, own=own)

    def products(self, joint: int, C: Floats) -> Products:
        """Return products of further columns, (..., k, F), with themselves and with [R, torque, T]."""
        flat = C.reshape(-1, C.shape[-1])
        return self.bands.products(C, C), self.bands.products(flat, self.own[joint])


def evidence_of(problem: GapProblem) -> tuple[Evidence, EvidenceRows]:
    """Return the evidence of a problem without any name, the rest sized."""
    rows = problem.searched(problem.theta)
    n, p = rows.W.shape[1:]
    bands = Bands(rows, problem.noise, *instants(rows, problem.repeats))
    common, own = error_columns(rows)
    size = p + len(common)
    every, filtered, models, motion = [], [], [], joined_motion([*rows.motions])
    for j in range(n):
        counts, at = bands.counts(j), len(own[j])
        white, parts = [bands.transformed(j, own[j])], [own[j]]
        kinds = {SHAPE: slice(0, SHARP)} if white[0][:SHARP].any() else {}
        for name, columns in rest_columns(rows, motion, j).items():
            made = bands.transformed(j, columns)
            scale = np.sqrt(max(float(np.sum(made**2)) / max(float(counts.sum()), 1.0), 1e-12))
            kinds[name] = slice(at, at + len(made))
            at += len(made)
            white.append(made / scale)
            parts.append(columns / scale)
        shared = np.concatenate([rows.tau[:, j][None], rows.W[:, j].T, common[:, j]])
        every.append(np.concatenate([*white, bands.transformed(j, shared)]))
        filtered.append(np.concatenate(parts))
        models.append(
            JointModel(
                grams=bands.products(every[j], every[j]),
                counts=counts,
                kinds=tuple(kinds.items()),
                errors=len(own[j]),
                log_rms=np.array([np.log(tuning.REST_USUAL) * (name != SHAPE) for name in kinds]),
                powers=np.zeros(len(counts)),
            )
        )
    known = sum(np.diag(m.plain)[m.own + 1 :][:p] for m in models)
    information, held = np.eye(size), np.zeros(size)
    information[range(p), range(p)] = FLAT * np.maximum(known, 1e-12)
    information[:p, :p] += problem.prior[:p, :p]
    held[:p] = problem.prior[:p, -1]
    price = float(np.log(7.0 * n))
    evidence = Evidence(tuple(models), information, held, price, size, size - p)
    return evidence.sized(FIRST_STEPS), EvidenceRows(bands, every, filtered, common)
