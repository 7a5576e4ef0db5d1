"""Relations for people and programs: text, JSON and LaTeX of what each base parameter is made of."""

from __future__ import annotations

from typing import Any

from dynid.model.exact import ExactReduction, Term
from dynid.model.formula import joined, latex_symbol


def base_name(group: tuple[Term, ...]) -> str:
    """Return the name of a base parameter: a combination is called after its representative with an R, ``Ixx2R``."""
    return group[0].name + ("R" if len(group) > 1 else "")


def group_text(group: tuple[Term, ...]) -> str:
    """Return one relation as text, such as ``mcz2R = mcz2 - mcy3 + d3*(m3+m4)``."""
    parts = []
    for terms in _factored(group):
        names = "+".join(term.name for term in terms)
        body = f"({names})" if len(terms) > 1 else names
        sign, factor = _factor(terms[0])
        parts.append((sign, f"{factor}*{body}" if factor else body))
    return f"{base_name(group)} = {joined(parts)}"


def coefficient_values(group: tuple[Term, ...]) -> dict[str, float]:
    """Return the number behind each coefficient that is not 1 or -1, by its text."""
    found = {}
    for terms in _factored(group):
        formula = terms[0].formula
        if formula is not None and formula.degree:
            found[formula.text()] = terms[0].value
    return found


def groups_text(reduction: ExactReduction, *, alone: bool = False) -> str:
    """Return all relations as text, the numbers of their coefficients beside them, with a sentence on how to read it.

    Args:
        reduction: the base parameters.
        alone: whether to list the parameters that stand alone as well.
    """
    lines = []
    for group in reduction.groups:
        if len(group) > 1 or alone:
            values = ", ".join(f"{text} = {value:.6g}" for text, value in coefficient_values(group).items())
            lines.append(group_text(group) + (f"    [{values}]" if values else ""))
    if reduction.unnamed:
        lines.append(f"{reduction.unnamed} coefficients have no formula and are given as numbers only")
    return "\n".join(lines)


def groups_json(reduction: ExactReduction) -> dict[str, Any]:
    """Return all relations for programs.

    Returns:
        ``rank``, ``classes``, ``symbols`` (value of each DH symbol), ``unnamed`` (number of coefficients without a
        formula) and ``groups``: of each base parameter ``name``, ``terms`` (coefficient of each parameter),
        ``formulas`` (the same as text, null where there is none) and ``text``.
    """
    groups = [
        {
            "name": base_name(group),
            "terms": {term.name: term.value for term in group},
            "formulas": {term.name: term.formula.text() if term.formula else None for term in group},
            "text": group_text(group),
        }
        for group in reduction.groups
    ]
    classes = {"alone": list(reduction.alone), "none": list(reduction.none), "combined": list(reduction.combined)}
    return {
        "rank": reduction.rank,
        "classes": classes,
        "symbols": reduction.geometry,
        "unnamed": reduction.unnamed,
        "groups": groups,
    }


def groups_latex(reduction: ExactReduction) -> str:
    """Return the relations of all combinations as a LaTeX ``align*`` environment."""
    rows = []
    for group in reduction.groups:
        if len(group) > 1:
            own = latex_symbol(group[0].name)
            rows.append(rf"  {own}^{{R}} &= {joined([_latex_part(terms) for terms in _factored(group)])}")
    return "\n".join([r"\begin{align*}", " \\\\\n".join(rows), r"\end{align*}"])


def _factored(group: tuple[Term, ...]) -> list[tuple[Term, ...]]:
    """Return the terms of a relation gathered by equal coefficient: plain ones first and one by one, then by degree."""
    gathered: dict[object, list[Term]] = {}
    for term in group:
        plain = term.formula is not None and term.formula.degree == 0 and abs(term.value) == 1
        key: object = term.name if plain or term.formula is None else term.formula
        gathered.setdefault(key, []).append(term)
    # Why: a stable sort keeps textbook order among equals.
    return sorted((tuple(terms) for terms in gathered.values()), key=_weight)


def _weight(terms: tuple[Term, ...]) -> tuple[bool, int]:
    formula = terms[0].formula
    return formula is None, formula.degree if formula is not None else 0


def _factor(term: Term) -> tuple[str, str]:
    """Return sign and size of a coefficient as text; the size is empty for 1."""
    if term.formula is None:
        return "-" if term.value < 0 else "+", f"{abs(term.value):.9g}"
    if len(term.formula.terms) > 1:
        return "+", f"({term.formula.text()})"
    size = (-term.formula if term.formula.negative else term.formula).text()
    return "-" if term.formula.negative else "+", "" if size == "1" else size


def _latex_part(terms: tuple[Term, ...]) -> tuple[str, str]:
    names = " + ".join(latex_symbol(term.name) for term in terms)
    body = rf"\left({names}\right)" if len(terms) > 1 else names
    formula = terms[0].formula
    sign, plain = _factor(terms[0])
    if formula is None or not plain:
        return sign, f"{plain} {body}".strip()
    if len(formula.terms) > 1:
        return sign, rf"\left({formula.latex()}\right) {body}"
    return sign, f"{(-formula if formula.negative else formula).latex()} {body}"
