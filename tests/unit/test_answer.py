"""An answer says the same on a terminal, in a notebook and to a program."""

import pytest

from dynid.answer import Answer, Answered
from dynid.errors import Finding
from dynid.table import Table, with_error

ANSWER = Answer(
    {"schema": "dynid/toy/1"},
    "It <works>.",
    parts=[
        "Because of this.",
        Table([{"joint": "a", "rms": 0.5}]),
        Finding("W316", "warning", "odd"),
    ],
    details=[("rank", "7 of 7")],
    notes=[("noise", "from repeats")],
)


class Toy(Answered):
    def answer(self):
        return ANSWER


def test_text_has_every_part_in_its_order_and_details_only_where_they_are_asked_for():
    short = ["It <works>.", "Because of this.", "joint  rms", "a      0.5", "W316 odd"]
    short.append("noise      from repeats")
    assert repr(Toy()).splitlines() == short
    assert Toy().summary().splitlines() == [*short, "rank       7 of 7"]


def test_a_notebook_shows_text_as_text_and_tables_as_tables():
    shown = Toy()._repr_html_()
    assert shown.startswith("<p>It &lt;works&gt;.</p><p>Because of this.</p><table>")
    assert shown.endswith("<p>rank       7 of 7</p>")
    assert Toy().table() == [{"joint": "a", "rms": 0.5}]


# ---------------------------------------------------------------- tables and numbers as text
@pytest.mark.parametrize(
    ("value", "error", "text"),
    [
        (1.13456, 0.0034, "1.1346"),
        (1234.5, 12.0, "1234"),
        (-1.8e-5, 6.3e-4, "-0.00002"),
        (1e-9, 0.1, "0"),
        (2.5e-9, 3.1e-10, "2.5e-09"),
        (0.123456, None, "0.1235"),
    ],
)
def test_a_value_has_the_digits_that_its_error_leaves(value, error, text):
    assert with_error(value, error) == text
