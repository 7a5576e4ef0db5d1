"""The base parameters as lines of a comment: value, how well it is known, what it is made of."""

from __future__ import annotations

from dynid.exporters.interface import Source


def parameter_lines(source: Source) -> list[str]:
    """Return one line a base parameter."""
    reduction = source.base.reduction
    lines = []
    for row, (name, value, known) in enumerate(zip(reduction.base_names, source.theta, source.known, strict=True)):
        terms = [f"{factor:+.6g} {term}" for term, factor in reduction.terms(row).items()]
        formula = f"  = {' '.join(terms)}" if len(terms) > 1 else ""
        origin = "not determined by the data" if known == "not determined" else f"from the data, known {known}"
        lines.append(f"{name:<7} {float(value): .6e}  {origin}{formula}")
    return lines
