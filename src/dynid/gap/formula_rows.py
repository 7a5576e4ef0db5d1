"""Products of a library on the rows of one joint: which of many thousands explain most, before any is made exactly."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dynid.gap.formula_library import Factor, forms, library_of
from dynid.gap.noise import whitened
from dynid.gap.segments import SegmentRows
from dynid.gap.significance import whitened_columns
from dynid.gap.whitened_regression import WhitenedRegression
from dynid.model.effects.formula import Formula, formula_text
from dynid.model.effects.interface import Floats

#: Products that are screened together.
TOGETHER = 64
#: All products are screened on one of so many stretches of time [s], the best on all rows: what has to explain half of
#: a joint's gap is among these.
THIN, STRETCH, BEST = 4, 2.0, 1200
#: Share of a column's power below which the model absorbs it.
ABSORBED = 1e-3
#: Most factors of a product.
FACTORS = 3


class FactorRows:
    """The values of all factors at the rows of one joint; their products are those of the motion but for the filter."""

    def __init__(self, regression: WhitenedRegression, joint: int) -> None:
        self.robot, self.joint = regression.segments[0].motion.robot, joint
        self.revolute = [one.revolute for one in self.robot.joints]
        load = np.concatenate([np.abs(s.motion.rigid[:, joint]) for s in regression.segments])
        levels = np.quantile(load, [0.25, 0.5, 0.75])
        self.library = library_of(joint, self.robot.n, self.revolute, levels.tolist())
        texts = sorted(
            {text for one in (*self.library.places, *self.library.motions) for text in one.texts}
        )
        made = [self.formula([text]) for text in texts]
        parts = [np.ones((1, sum(len(s) for s in regression.segments)))]
        parts.append(
            np.concatenate([_filtered(s, made, joint) for s in regression.segments], axis=1)
        )
        # Why the smallest type: products are only sorted by it, and there are millions of values.
        self.values: NDArray[np.float32] = np.concatenate(parts).astype(np.float32)
        self.place = {text: k for k, text in enumerate(texts, start=1)}
        self.kept = list(self.library.products())
        self.columns = sum(len(forms(one)) for one in self.kept)
        self._made: dict[str, Floats] = {}

    def formula(self, terms: Sequence[str]) -> Formula:
        """Return the formula of terms."""
        return Formula(formula_text(terms), self.revolute, self.joint)

    def made(self, regression: WhitenedRegression, terms: Sequence[str]) -> Floats:
        """Return the whitened columns of terms, made before the filter, (k, M); each is made once."""
        new = [term for term in terms if term not in self._made]
        if new:
            columns = whitened_columns(regression, self.formula(new), (self.joint,), [{}])[
                self.joint
            ][0]
            self._made |= zip(new, columns, strict=True)
        return np.array([self._made[term] for term in terms])

    def screen(self, regression: WhitenedRegression) -> None:
        """Keep the products that explain most of a part of the rows."""
        self.kept = [
            self.kept[k] for k in np.argsort(-self.gains(regression, self.kept, THIN))[:BEST]
        ]

    def best(self, regression: WhitenedRegression, count: int) -> list[tuple[Factor, ...]]:
        """Return the products that explain most, the best first."""
        gains = self.gains(regression, self.kept)
        return [self.kept[k] for k in np.argsort(-gains)[:count] if gains[k] > 0]

    def gains(
        self, regression: WhitenedRegression, products: Sequence[tuple[Factor, ...]], thin: int = 1
    ) -> Floats:
        """Return about how much each product explains, less what its freedom costs, (P,).

        Args:
            regression: what is left.
            products: the products.
            thin: of so many stretches of time one is looked at.
        """
        found = np.zeros(len(products))
        by_width: dict[int, list[int]] = {}
        every = [forms(one) for one in products]
        for k, one in enumerate(every):
            by_width.setdefault(len(one), []).append(k)
        chosen, kept, at = self._stretches(regression, thin)
        values = np.ascontiguousarray(self.values[:, chosen])
        ar = regression.noise.ar[self.joint].astype(np.float32)
        scale = regression.noise.sigma[self.joint] * regression.noise.count[self.joint] ** 0.5
        both = regression.fit.e[self.joint], regression.basis(self.joint)
        e, Q = (x[at].astype(np.float32) for x in both)
        for width, group in by_width.items():
            for start in range(0, len(group), TOGETHER):
                some = group[start : start + TOGETHER]
                index = np.array([self._places(form) for k in some for form in every[k]]).T
                C = values[index[0]]
                for more in index[1:]:
                    C *= values[more]
                C = whitened(C, ar)[:, kept] / np.float32(scale)
                P = C @ Q
                C, P = C.reshape(len(some), width, -1), P.reshape(len(some), width, -1)
                raw = np.einsum("gkm,gkm->gk", C, C)
                gram = C @ C.transpose(0, 2, 1) - P @ P.transpose(0, 2, 1)
                found[some] = _batched(gram.astype(np.float64), (C @ e).astype(np.float64), raw)
            found[group] -= width * np.log(len(e))
        return found

    def _places(self, form: tuple[str, ...]) -> list[int]:
        places = [self.place[text] for text in form]
        return places + [0] * (FACTORS - len(places))

    def _stretches(
        self, regression: WhitenedRegression, thin: int
    ) -> tuple[NDArray[np.int64], NDArray[np.int64], NDArray[np.int64]]:
        """Return rows of the segments, which of them count after whitening, and where those are among the joint's."""
        order, segments = regression.noise.order, regression.segments
        length = max(1, round(STRETCH * segments[0].rate))
        chosen, first, start = [], [], 0
        for s in segments:
            # Why the last: what is too short for one stretch is looked at whole.
            edges = range(0, len(s), thin * length) if thin > 1 else (0,)
            for k in edges:
                rows = np.arange(k, min(k + length, len(s)) if thin > 1 else len(s))
                chosen.append(start + rows)
                first.append(rows < k + order)
            start += len(s)
        together = np.concatenate(chosen)
        index = regression.joints[self.joint].index
        at = np.minimum(np.searchsorted(index, together), len(index) - 1)
        counts = (index[at] == together) & ~np.concatenate(first)
        kept = np.flatnonzero(counts)
        return together, kept - order, at[kept]


def _filtered(segment: SegmentRows, formulas: Sequence[Formula], joint: int) -> Floats:
    values = np.array([one.columns(segment.motion, (joint,), {})[0, 0] for one in formulas])
    return segment.filtered(values)


def _batched(gram: Floats, right: Floats, raw: Floats) -> Floats:
    """Return the gains of groups of columns, those that the model absorbs left out, (G,)."""
    own = np.diagonal(gram, axis1=1, axis2=2)
    there = own > ABSORBED * raw
    size = np.sqrt(np.where(there, own, 1.0))
    scaled = gram / (size[:, :, None] * size[:, None, :])
    scaled = np.where(there[:, :, None] & there[:, None, :], scaled, 0.0)
    scaled += (1e-3 + ~there[:, :, None]) * np.eye(gram.shape[1])
    b = np.where(there, right / size, 0.0)
    gains: Floats = np.einsum("gk,gk->g", b, np.linalg.solve(scaled, b[..., None])[..., 0])
    return gains
