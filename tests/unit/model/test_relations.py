"""Relations for people and programs, and the formulas they are made of."""

import json
import math
from dataclasses import replace
from pathlib import Path

import pytest

from dynid import Robot, load_robot
from dynid.model import build_model
from dynid.model.reduce import reduce
from dynid.model.relations import (
    relations_json,
    relations_of,
    relations_text,
    unnamed,
)
from dynid.robot import Joint

PAPER = Path(__file__).parents[3] / "robots" / "paper"
GEN2 = load_robot(PAPER / "kinova_gen2_table6.yaml")


@pytest.fixture(scope="module")
def gen2():
    return build_model(GEN2)


@pytest.fixture(scope="module")
def groups(gen2):
    return relations_of(gen2)


def oblique(n):
    """Return an arm of n turning joints whose twists are no special angles."""
    joints = tuple(
        Joint(f"j{k}", a=0.1 + 0.01 * k, d=0.2 + 0.03 * k, twist=0.3 + 0.1 * k)
        for k in range(1, n + 1)
    )
    return Robot("oblique", "standard", joints)


def test_json_terms_are_the_coefficients_of_the_singular_values(gen2, groups):
    found = json.loads(json.dumps(relations_json(gen2, groups)))
    svd = reduce(gen2)
    assert found["rank"] == 48
    assert [g["name"] for g in found["groups"]] == list(svd.base_names)
    for row, group in enumerate(found["groups"]):
        assert group["terms"] == pytest.approx(svd.terms(row))


def test_json_formulas_give_the_terms_when_computed_with_the_symbols(gen2, groups):
    found = relations_json(gen2, groups)
    for group in found["groups"]:
        for name, text in group["formulas"].items():
            size = math.prod(
                found["symbols"][part.split("^")[0]] ** int([*part.split("^"), "1"][1])
                if part[0] == "d"
                else float(part)
                for part in text.lstrip("-").split("*")
            )
            assert (-size if text[0] == "-" else size) == pytest.approx(group["terms"][name])


def test_text_shows_numbers_beside_the_formulas(groups):
    assert (
        "mcz2R = mcz2 + mcy3 + d3*(m3+m4+m5+m6+m7)    [d3 = -0.41]"
        in relations_text(groups).splitlines()
    )


def test_oblique_twists_are_named_and_their_values_are_right():
    model = build_model(oblique(4))
    svd = reduce(model)
    relations = relations_of(model, svd)
    assert unnamed(relations) == 0
    for row, relation in enumerate(relations):
        values = {term.name: term.value for term in relation}
        assert values == pytest.approx(svd.terms(row), rel=1e-8, abs=1e-8)


@pytest.mark.slow
def test_special_oblique_twists_are_symbols_with_the_same_formulas():
    def arm(degrees):
        joints = tuple(replace(j, twist=math.radians(degrees)) for j in oblique(3).joints)
        model = build_model(replace(oblique(3), joints=joints))
        return relations_text(relations_of(model)).count("sa3")

    assert arm(50) == arm(60) == arm(77.123) > 0


@pytest.mark.slow
def test_every_coefficient_of_twelve_oblique_joints_has_a_name():
    assert unnamed(relations_of(build_model(oblique(12)))) == 0
