"""Text for other programs is what those programs read."""

import csv
import io
from types import SimpleNamespace

from dynid.reports.tables import runs_csv, runs_latex


def run(names, values, errors):
    rows = [
        {"name": name, "value": value, "std_error": error}
        for name, value, error in zip(names, values, errors, strict=True)
    ]
    return SimpleNamespace(
        robot=SimpleNamespace(name="arm_1"),
        names=names,
        parameter_rows=lambda: rows,
        method="wls",
        rank=len(names),
        condition_number_scaled=30.0,
        relative_error_percent=1.25,
        heldout_relative_error_percent=None,
    )


def test_csv_keeps_every_digit_and_leaves_empty_what_a_run_does_not_have():
    """Two robots with different parameters in one file."""
    value = 0.1 + 0.2
    rows = list(
        csv.DictReader(
            io.StringIO(
                runs_csv(
                    ["a, b", "c"], [run(("m1",), [value], [None]), run(("fv1",), [-1.5], [0.5])]
                )
            )
        )
    )
    assert [row["run"] for row in rows] == ["a, b", "c"]
    assert float(rows[0]["m1"]) == value
    assert rows[0]["m1_std_error"] == rows[0]["fv1"] == rows[1]["m1"] == ""
    # A negative number is no formula.
    assert (rows[1]["fv1"], rows[1]["fv1_std_error"]) == ("-1.5", "0.5")


def test_latex_shows_two_digits_of_the_error():
    """3.14159 known to 0.0123 is 3.142 +- 0.012; what is not determined says so."""
    text = runs_latex(["run_1"], [run(("m1", "m2"), [3.14159, 5.0], [0.0123, None])])
    assert r"$3.142 \pm 0.012$" in text
    assert "not determined" in text
    assert r"run\_1" in text
