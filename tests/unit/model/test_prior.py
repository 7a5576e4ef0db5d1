"""Bodies believed before measuring."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from arms import tensor_of
from dynid import Robot, load_robot
from dynid.model.parameters import (
    DEFAULT_CYLINDERS,
    cylinder_body,
    joined,
    link_cylinders,
    prior_bodies,
    prior_parameters,
)
from dynid.robot import Body, Cylinders, Joint, Prior


def two_links(convention="standard", **prior):
    joints = (Joint("a", a=0.5, twist=math.pi / 2), Joint("b", a=0.3))
    return Robot(
        "planar", convention, joints, prior=Prior(cylinders=Cylinders(**prior)) if prior else None
    )


def test_total_mass_is_the_one_that_was_given():
    """The density is scaled, whatever the shapes."""
    for name, mass in (("kuka_lwr4plus", 15.0), ("kinova_gen2", 5.1)):
        assert sum(body.mass for body in prior_bodies(load_robot(name))) == pytest.approx(
            mass, rel=1e-12
        )


def test_a_cylinder_has_the_textbook_inertia():
    """Along x: m r^2 / 2 about its axis, m (3 r^2 + L^2) / 12 across."""
    mass = 1000 * math.pi * 0.05**2 * 0.4
    body = cylinder_body(np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0]]), 0.05, mass)
    across = mass * (3 * 0.05**2 + 0.4**2) / 12
    assert body.mass == pytest.approx(mass)
    assert body.com == pytest.approx((0.2, 0.0, 0.0))
    assert body.inertia_com == pytest.approx((mass * 0.05**2 / 2, 0.0, 0.0, across, 0.0, across))


def test_standard_links_reach_from_the_previous_origin_to_their_own():
    """In frame i the previous origin is at (-a, -d sin twist, -d cos twist), Paper Eq. 9."""
    joint = Joint("a", a=0.2, twist=0.7, d=0.4)
    ((start, end),) = link_cylinders(Robot("r", "standard", (joint,)))
    assert start == pytest.approx((-0.2, -0.4 * math.sin(0.7), -0.4 * math.cos(0.7)))
    assert end == pytest.approx((0.0, 0.0, 0.0))


def test_modified_links_reach_to_the_next_axis():
    """The row's own a belongs to the link before; the next row's lies in this one."""
    first, last = link_cylinders(two_links("modified", radius=0.05, density=1000.0))
    assert_allclose(first, [(0.0, 0.0, 0.0), (0.3, 0.0, 0.0)])
    assert np.linalg.norm(last[1] - last[0]) == pytest.approx(0.1)


def test_a_link_without_length_is_a_housing_about_its_joint_axis():
    """Standard frame: the joint axis is z of the frame before, (0, sin twist, cos twist) in the link's own."""
    ((start, end),) = link_cylinders(Robot("r", "standard", (Joint("a", twist=math.pi / 2),)))
    assert_allclose(end - start, [0, 2 * DEFAULT_CYLINDERS.radius, 0], atol=1e-12)


def test_explicit_bodies_are_taken_as_they_are():
    """Numbers in the file win over shapes."""
    bodies = (Body(1.0, (0.1, 0.0, 0.0)), Body(2.0))
    assert prior_bodies(replace(two_links(), prior=Prior(links=bodies))) == bodies


def test_the_tool_rides_on_the_last_link():
    """Mass, first moment and inertia about the frame's origin add up."""
    tool = Body(0.7, (0.0, 0.1, 0.2), (0.01, 0.0, 0.0, 0.02, 0.0, 0.015))
    plain, loaded = prior_parameters(two_links()), prior_parameters(replace(two_links(), tool=tool))
    assert_allclose(loaded[:10], plain[:10])
    assert_allclose(loaded[10:], plain[10:] + tool.parameters(), rtol=1e-12)


def test_bodies_without_mass_join_to_none():
    """No division by a mass that is not there."""
    assert joined(Body(0.0), Body(0.0)).mass == 0.0


def test_the_default_prior_is_physical():
    """Principal moments are positive and obey the triangle inequality on the arms that ship."""
    for name in ("kuka_lwr4plus", "kinova_gen2"):
        for body in prior_bodies(replace(load_robot(name), prior=None)):
            a, b, c = np.linalg.eigvalsh(tensor_of(body))
            assert a > 0
            assert a + b >= c
