"""Tables and numbers as text."""

import pytest

from dynid.table import with_error


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
