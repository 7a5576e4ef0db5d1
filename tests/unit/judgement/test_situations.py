"""What all commands say in one situation agrees; benchmarks/judgement.py does the same with 200 of them."""

import pytest

from judgement import calibration, case_of, contradictions, run

#: Arm, hidden, whether it was there when the model was identified, length of the logs [s].
SITUATIONS = (("nothing", True, 15.0), ("payload", False, 15.0), ("drift", True, 8.0))


@pytest.fixture(scope="module")
def rows():
    names = ("hidden", "always", "seconds")
    same = {"arm": "scara", "noise": 0.01}
    return [
        run(case_of(k) | same | dict(zip(names, situation, strict=True)))
        for k, situation in enumerate(SITUATIONS)
    ]


@pytest.mark.slow
def test_no_two_commands_contradict_each_other_and_good_and_bad_are_right(rows):
    assert [row["contradictions"] for row in rows] == [[], [], []]
    assert all({"identify", "validate", "gap", "report"} <= set(row["states"]) for row in rows)
    good, right, _, wrong = calibration(rows)
    assert (good, wrong) == (right, 0)


def test_the_reader_finds_statements_that_contradict_each_other():
    lights = [{"name": name, "state": "fair"} for name in ("fit", "unseen motion", "complete")]
    said = {
        "state": "good",
        "sentence": "No missing effect found.",
        "lights": lights,
        "warnings": [],
        "next": [],
    }
    found = contradictions({"gap": {"judgement": said, "verdict": "nothing_missing", "named": []}})
    assert {text.removeprefix("gap: ") for text in found} >= {
        "good beside a light that is not",
        "nothing missing beside a light",
        "no next step",
        "its verdict and its light",
    }
