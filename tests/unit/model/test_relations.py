"""Relations for people and programs, and the formulas they are made of."""

import json
import math
import time
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import numpy as np
import pytest

from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.exact import (
    FieldRegressor,
    reduce_exactly,
    relations_json,
    relations_latex,
    relations_text,
)
from dynid.model.polynomial import ONE, Polynomial
from dynid.model.reduce import reduce
from dynid.robot import Joint, Robot

PAPER = Path(__file__).parents[3] / "robots" / "paper"
GEN2 = load_robot(PAPER / "kinova_gen2_table6.yaml")


@pytest.fixture(scope="module")
def gen2():
    return build_model(GEN2)


@pytest.fixture(scope="module")
def exact(gen2):
    return reduce_exactly(gen2)


def oblique(n):
    """Return an arm of n turning joints whose twists are no special angles."""
    joints = tuple(
        Joint(f"j{k}", a=0.1 + 0.01 * k, d=0.2 + 0.03 * k, twist=0.3 + 0.1 * k)
        for k in range(1, n + 1)
    )
    return Robot("oblique", "standard", joints)


def test_json_terms_are_the_coefficients_of_the_singular_values(gen2, exact):
    found = json.loads(json.dumps(relations_json(exact)))
    svd = reduce(gen2)
    assert found["rank"] == 48
    assert [g["name"] for g in found["groups"]] == list(svd.base_names)
    for row, group in enumerate(found["groups"]):
        assert group["terms"] == pytest.approx(svd.terms(row))


def test_json_formulas_give_the_terms_when_computed_with_the_symbols(exact):
    found = relations_json(exact)
    for group in found["groups"]:
        for name, text in group["formulas"].items():
            size = math.prod(
                found["symbols"][part.split("^")[0]] ** int([*part.split("^"), "1"][1])
                if part[0] == "d"
                else float(part)
                for part in text.lstrip("-").split("*")
            )
            assert (-size if text[0] == "-" else size) == pytest.approx(group["terms"][name])


def test_text_shows_numbers_beside_the_formulas(exact):
    assert (
        "mcz2R = mcz2 + mcy3 + d3*(m3+m4+m5+m6+m7)    [d3 = -0.41]"
        in relations_text(exact).splitlines()
    )


def test_latex_has_a_row_for_each_combination(exact):
    latex = relations_latex(exact)
    assert latex.count("^{R} &=") == 17
    assert r"mc_{6,z}^{R} &= mc_{6,z} + mc_{7,z} + d_{7} m_{7}" in latex


def test_formulas_add_multiply_and_evaluate_like_numbers():
    d, c = (
        Polynomial.monomial(2, {"d3": 1}),
        Polynomial.monomial(Fraction(-1, 2), {"ca4": -1, "sqrt(3)": 1}),
    )
    values = {"d3": 0.4, "ca4": 0.3}
    assert (d * c + ONE).value(values) == pytest.approx(2 * 0.4 * -0.5 * math.sqrt(3) / 0.3 + 1)
    assert (d + -d).terms == ()


def test_relations_do_not_depend_on_the_random_states(gen2):
    first, second = (FieldRegressor(gen2, seed=seed) for seed in (1, 2))
    base, K = first.relations(first.actual())
    again, L = second.relations(second.actual())
    assert base == again
    assert np.array_equal(K, L)


def test_oblique_twists_are_named_and_their_values_are_right():
    model = build_model(oblique(4))
    r = reduce_exactly(model)
    assert r.unnamed == 0
    np.testing.assert_allclose(r.K, reduce(model).K, rtol=1e-8, atol=1e-8)


@pytest.mark.slow
def test_special_oblique_twists_are_symbols_with_the_same_formulas():
    def arm(degrees):
        joints = tuple(replace(j, twist=math.radians(degrees)) for j in oblique(3).joints)
        return [
            g["text"]
            for g in relations_json(
                reduce_exactly(build_model(replace(oblique(3), joints=joints)))
            )["groups"]
        ]

    assert arm(30) == arm(60) == arm(37.123)


@pytest.mark.slow
def test_seven_joints_take_half_a_second_and_twelve_five():
    for robot, limit in ((GEN2, 0.5), (oblique(12), 5.0)):
        model = build_model(robot)
        seconds = []
        for _ in range(3):
            start = time.process_time()
            r = reduce_exactly(model)
            seconds.append(time.process_time() - start)
        assert r.unnamed == 0
        assert min(seconds) <= limit, f"{robot.n} joints: {min(seconds):.2f} s"
