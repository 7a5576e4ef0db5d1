"""Pseudo-inertias and bounds against textbook bodies."""

import numpy as np
import pytest

from dynid.estimation.possible_set import (
    body_parameters,
    make_constraints,
    pseudo_inertia,
    smallest_eigenvalues,
)
from dynid.model.parameters import numbered
from dynid.robot import LINK_PARAMETERS, Body
from synthetic_arm import holds


def test_pseudo_inertia_is_the_second_moment_of_point_masses():
    rng = np.random.default_rng(1)
    points, masses = rng.standard_normal((20, 3)), rng.uniform(0.1, 1, 20)
    homogeneous = np.column_stack([points, np.ones(20)])
    expected = np.einsum("k,ka,kb->ab", masses, homogeneous, homogeneous)
    total = sum(Body(m, tuple(p)).parameters() for m, p in zip(masses, points, strict=True))
    assert np.allclose(pseudo_inertia(total), expected)


def test_maps_are_inverse_of_each_other():
    bodies = np.random.default_rng(2).standard_normal((5, 10))
    assert np.allclose(body_parameters(pseudo_inertia(bodies)), bodies)


def test_a_rod_thicker_than_its_length_allows_is_refused():
    possible = Body(1.0, (0.1, 0, 0), (0.01, 0, 0, 0.01, 0, 0.015)).parameters()
    impossible = Body(
        1.0, (0.1, 0, 0), (0.01, 0, 0, 0.01, 0, 0.021)
    ).parameters()  # Izz > Ixx + Iyy
    assert smallest_eigenvalues(possible[None]).min() > 0.0
    assert smallest_eigenvalues(np.stack([possible, impossible])).min() < 0.0
    assert smallest_eigenvalues(np.stack([possible, impossible]))[1] == pytest.approx(
        -0.0005, rel=0.05
    )


def test_bounds_hold_inside_and_break_outside():
    parameters = [numbered(kind, 1, "") for kind in (*LINK_PARAMETERS, "fv", "fo")]
    names = [parameter.name for parameter in parameters]
    x = np.concatenate(
        [Body(2.0, (0.1, 0, 0), (0.1, 0, 0, 0.1, 0, 0.1)).parameters(), [0.1, 1.0, -3.0]]
    )
    box = {1: (np.array([0, -1, -1]), np.array([0.2, 1, 1]))}
    constraints = make_constraints(parameters, x, total_mass=(1, 3), com_box=box)
    assert holds(constraints, x)
    for change in ({"m1": 2.0}, {"mcx1": 0.5}, {"fv1": -2.0}, {"Im1": -0.2}, {"mcx1": -0.3}):
        broken = x.copy()
        for name, value in change.items():
            broken[names.index(name)] += value
        assert not holds(constraints, broken), change
