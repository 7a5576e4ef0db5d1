"""Tables of results for terminals, notebooks and pandas: rows are dictionaries with the same keys.

Text from files is shown as text: control characters become visible, and HTML is escaped.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

from dynid.errors import PackageMissing
from dynid.text import html, visible

if TYPE_CHECKING:
    from pandas import DataFrame

#: Cells that stand on the right: numbers, also with a unit, which is no word, and the dash for what is not there.
_NUMBER = re.compile(r"-|[-+<]?\d[\d.]*(e[-+]?\d+)?( (?![a-z]{5})[^\d_]+)?")
#: Believed values below this are zero: a centre of mass turned into its DH frame is off an axis by rounding.
ROUNDING = 1e-12


class Table(list[dict[str, Any]]):
    """Rows that print as a table.

    Args:
        rows: dictionaries with the same keys, in the order of the columns.
    """

    def __init__(self, rows: Sequence[Mapping[str, Any]]) -> None:
        super().__init__(map(dict, rows))

    def to_dataframe(self) -> DataFrame:
        """Return the rows as a pandas DataFrame.

        Raises:
            PackageMissing: pandas is not installed.
        """
        return dataframe([*self])

    def __repr__(self) -> str:
        """Return the table as text with aligned columns."""
        lines = []
        if self:
            heads = list(self[0])
            cells = [[cell_text(row[head]) for head in heads] for row in self]
            numbers = [all(map(_NUMBER.fullmatch, column)) for column in zip(*cells, strict=True)]
            widths = [
                max(len(head), *(len(row[k]) for row in cells)) for k, head in enumerate(heads)
            ]
            for row in [heads, *cells]:
                aligned = (
                    text.rjust(width) if number else text.ljust(width)
                    for text, width, number in zip(row, widths, numbers, strict=True)
                )
                lines.append("  ".join(aligned).rstrip())
        return "\n".join(lines)

    def _repr_html_(self) -> str:
        """Return the table as HTML for notebooks."""
        if not self:
            return ""
        heads = "".join(f"<th>{html(str(head))}</th>" for head in self[0])
        rows = ("".join(f"<td>{html(cell_text(x))}</td>" for x in row.values()) for row in self)
        body = "".join(f"<tr>{row}</tr>" for row in rows)
        return f"<table><thead><tr>{heads}</tr></thead><tbody>{body}</tbody></table>"


def dataframe(data: Any) -> DataFrame:  # noqa: ANN401
    """Return rows or columns as a pandas DataFrame.

    Raises:
        PackageMissing: pandas is not installed.
    """
    try:
        from pandas import DataFrame
    except ImportError:
        raise PackageMissing("to_dataframe() needs pandas", fix="pip install pandas") from None
    return DataFrame(data)


def with_error(value: float, error: float | None) -> str:
    """Return a value with the digits that two digits of its standard error leave; four digits without an error."""
    if error is None or not math.isfinite(error) or error <= 0:
        return f"{value:.4g}"
    places = 1 - math.floor(math.log10(error))
    text = f"{value:.{max(0, places)}f}"
    return f"{value:.3g}" if places > 7 else "0" if float(text) == 0.0 else text


def cell_text(value: Any) -> str:  # noqa: ANN401
    """Return a value as a person wants to read it: four digits, a dash for what is not there, text made visible."""
    if value is None or (isinstance(value, float) and not math.isfinite(value)):
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return f"{value:.4g}"
    return visible(str(value))
