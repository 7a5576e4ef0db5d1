"""Coefficients as polynomials: sums of monomials in the DH symbols, with text, LaTeX and value."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from fractions import Fraction

from dynid.model.prime_field import PRIME, ROOTS, residue

Monomial = tuple[tuple[str, int], ...]

_ROOT_NAMES = {f"sqrt({k})": k for k in ROOTS}


@dataclass(frozen=True)
class Polynomial:
    """A sum of monomials.

    Attributes:
        terms: (factor, ((symbol, power), ...)) of each monomial, symbols sorted. Symbols are ``d3`` and ``a3`` [m],
            ``ca3`` and ``sa3`` for cosine and sine of a twist, ``c3`` and ``s3`` for those of a sliding joint's angle,
            ``sqrt(2)`` and so on.
    """

    terms: tuple[tuple[Fraction, Monomial], ...]

    @staticmethod
    def monomial(factor: Fraction | int, powers: Mapping[str, int]) -> Polynomial:
        """Return one monomial."""
        return Polynomial(
            ((Fraction(factor), tuple(sorted((s, k) for s, k in powers.items() if k))),)
        )

    def __add__(self, other: Polynomial) -> Polynomial:
        """Return the sum with equal monomials merged."""
        total: dict[Monomial, Fraction] = {}
        for factor, monomial in (*self.terms, *other.terms):
            total[monomial] = total.get(monomial, Fraction(0)) + factor
        return Polynomial(
            tuple(
                (factor, monomial)
                for monomial, factor in sorted(total.items(), key=_order)
                if factor
            )
        )

    def __mul__(self, other: Polynomial) -> Polynomial:
        """Return the product."""
        total = Polynomial(())
        for left, one in self.terms:
            for right, two in other.terms:
                powers = dict(one)
                for symbol, power in two:
                    powers[symbol] = powers.get(symbol, 0) + power
                total += Polynomial.monomial(left * right, powers)
        return total

    def __neg__(self) -> Polynomial:
        """Return the formula with the other sign."""
        return Polynomial(tuple((-factor, monomial) for factor, monomial in self.terms))

    @property
    def degree(self) -> int:
        """Largest degree of a monomial."""
        return max(
            (sum(abs(power) for _, power in monomial) for _, monomial in self.terms), default=0
        )

    @property
    def negative(self) -> bool:
        """Whether the first factor is negative."""
        return bool(self.terms) and self.terms[0][0] < 0

    def value(self, geometry: Mapping[str, float]) -> float:
        """Return the number for given DH values."""
        known = {**geometry, **{name: math.sqrt(k) for name, k in _ROOT_NAMES.items()}}
        return math.fsum(
            float(f) * math.prod(known[s] ** k for s, k in monomial) for f, monomial in self.terms
        )

    def residue(self, geometry: Mapping[str, int]) -> int:
        """Return the value in the prime field for given DH values there."""
        known = {**geometry, **{name: ROOTS[k] for name, k in _ROOT_NAMES.items()}}
        total = 0
        for factor, monomial in self.terms:
            product = residue(factor)
            for symbol, power in monomial:
                product = product * pow(known[symbol], power, PRIME) % PRIME
            total += product
        return total % PRIME

    def text(self) -> str:
        """Return the formula as text, such as ``2*d3*ca4``."""
        parts = [
            _signed(factor, [_power(s, k) for s, k in monomial]) for factor, monomial in self.terms
        ]
        return joined(parts)

    def latex(self) -> str:
        """Return the formula in LaTeX."""
        parts = []
        for factor, monomial in self.terms:
            size = abs(factor)
            number = "" if size == 1 and monomial else latex_number(size)
            symbols = " ".join(
                f"{latex_symbol(s)}^{{{k}}}" if k != 1 else latex_symbol(s) for s, k in monomial
            )
            parts.append(("-" if factor < 0 else "+", f"{number} {symbols}".strip()))
        return joined(parts)


ONE = Polynomial.monomial(1, {})


def _order(item: tuple[Monomial, Fraction]) -> tuple[int, Monomial]:
    return sum(abs(power) for _, power in item[0]), item[0]


def _power(symbol: str, power: int) -> str:
    return symbol if power == 1 else f"{symbol}^{power}"


def _signed(factor: Fraction, symbols: list[str]) -> tuple[str, str]:
    size = [str(abs(factor))] if abs(factor) != 1 or not symbols else []
    return "-" if factor < 0 else "+", "*".join(size + symbols)


def joined(parts: list[tuple[str, str]]) -> str:
    """Join signed terms: the first without a plus sign, the others with spaces round the sign."""
    first, *others = parts
    return (
        ("-" if first[0] == "-" else "")
        + first[1]
        + "".join(f" {sign} {body}" for sign, body in others)
    )


def latex_number(number: Fraction) -> str:
    """Return a positive fraction in LaTeX."""
    if number.denominator == 1:
        return str(number.numerator)
    return rf"\tfrac{{{number.numerator}}}{{{number.denominator}}}"


def latex_symbol(name: str) -> str:
    """Return a DH symbol or a parameter's name in LaTeX: ``d_{3}`` for ``d3``, ``mc_{3,x}`` for ``mcx3``."""
    if name.startswith("sqrt"):
        return rf"\sqrt{{{name[5:-1]}}}"
    kind = name.rstrip("0123456789")
    number = name[len(kind) :]
    if kind in ("ca", "sa"):
        return rf"{'c' if kind == 'ca' else 's'}_{{\alpha {number}}}"
    if kind in ("c", "s"):
        return rf"{kind}_{{\theta {number}}}"
    head, tail = ("mc", kind[2:]) if kind.startswith("mc") else (kind[0], kind[1:])
    index = f"{number},{tail}" if tail else number
    return rf"{'mc' if head == 'mc' else head}_{{{index}}}"
