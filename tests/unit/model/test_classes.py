"""Base parameters: counts and relations of the paper's two arms, and what must not change them."""

import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid import Robot, load_robot
from dynid.errors import ReductionsDisagree
from dynid.model import build_model
from dynid.model.reduce import random_states, reduce
from dynid.model.relations import base_name, base_parameters, relations_of
from dynid.robot import LINK_PARAMETERS, Joint

ROBOTS = Path(__file__).parents[3] / "robots"
PAPER = ROBOTS / "paper"
GEN2 = load_robot(PAPER / "kinova_gen2_table6.yaml")
LWR_ZERO = load_robot(PAPER / "kuka_lwr4plus_table7.yaml")
LWR = replace(
    LWR_ZERO,
    joints=tuple(
        replace(j, d=d)
        for j, d in zip(LWR_ZERO.joints, (0.31, 0, 0.4, 0, 0.39, 0, 0.078), strict=True)
    ),
)


def with_joints(robot, **changes):
    return replace(robot, joints=tuple(replace(j, **changes) for j in robot.joints))


def shifted(robot):
    """Return the arm in modified DH: each twist belongs to the joint before."""
    twists = [0.0, *(j.twist for j in robot.joints[:-1])]
    joints = tuple(replace(j, twist=t) for j, t in zip(robot.joints, twists, strict=True))
    return replace(robot, convention="modified", joints=joints)


def counts(robot):
    """Return how many base parameters there are, and parameters alone and never shown."""
    r = reduce(build_model(robot))
    assert len(r.names) == len(r.alone) + len(r.none) + len(r.combined)
    return r.rank, len(r.alone), len(r.none)


def texts(robot):
    found = base_parameters(build_model(robot))
    return [
        text for name, text in zip(found.base_names, found.formulas, strict=True) if name[-1] == "R"
    ]


REAL = ("kuka_lwr4plus", "kinova_gen2", "franka_panda", "ur10")
WALL, NOWHERE = (9.81, 0, 0), (0, 0, 0)


#: Rank, alone, none; each friction adds one that stands alone to the joints, each rotor left out takes five away.
COUNTS = {
    "gen2": (GEN2, (48, 31, 11)),
    "gen2-driver": (with_joints(load_robot("kinova_gen2"), friction=()), (48, 31, 11)),
    "lwr-zero": (LWR_ZERO, (48, 31, 16)),
    "lwr": (LWR, (48, 31, 11)),
    "gen2-no-rotors": (with_joints(GEN2, motor_inertia=False), (43, 26, 11)),
    "lwr-no-rotors": (with_joints(LWR, motor_inertia=False), (43, 26, 11)),
    "lwr-friction": (with_joints(LWR, friction=("viscous", "coulomb")), (62, 45, 11)),
    "gen2-modified": (shifted(GEN2), (48, 31, 11)),
    "lwr-zero-modified": (shifted(LWR_ZERO), (48, 31, 16)),
    "gen2-wall": (replace(GEN2, gravity=WALL), (50, 32, 8)),
    "lwr-zero-wall": (replace(LWR_ZERO, gravity=WALL), (50, 32, 13)),
    "gen2-no-gravity": (replace(GEN2, gravity=NOWHERE), (44, 27, 13)),
    "lwr-zero-no-gravity": (replace(LWR_ZERO, gravity=NOWHERE), (36, 24, 33)),
}


@pytest.mark.parametrize("case", COUNTS)
def test_ranks_and_classes_are_the_published_ones(case):
    robot, expected = COUNTS[case]
    assert counts(robot) == expected


def test_parameters_stand_alone_or_vanish_as_listed():
    wanted = [f"mcx{k}" for k in range(2, 8)] + ["mcy7", "Izz7"] + [f"Im{k}" for k in range(3, 8)]
    wanted += [f"{name}{k}" for name in ("Ixy", "Ixz", "Iyz") for k in range(2, 8)]
    first = {f"{name}1" for name in {*LINK_PARAMETERS} - {"Iyy", "Im"}} | {"m2", "mcy2"}
    for robot, more in ((GEN2, set()), (LWR, set()), (LWR_ZERO, {f"m{k}" for k in range(3, 8)})):
        r = reduce(build_model(robot))
        assert set(r.alone) == set(wanted)
        assert set(r.none) == first | more


GEN2_RELATIONS = """\
Iyy1R = Iyy1 + Im1 + Izz2
mcz2R = mcz2 + mcy3 + d3*(m3+m4+m5+m6+m7)
Ixx2R = Ixx2 - Izz2 + Izz3 + 2*d3*mcy3 + d3^2*(m3+m4+m5+m6+m7)
Iyy2R = Iyy2 + Im2 + Izz3 + 2*d3*mcy3 + d3^2*(m3+m4+m5+m6+m7)
mcz3R = mcz3 + mcy4 + d4*(m4+m5+m6+m7)
Ixx3R = Ixx3 - Izz3 + Izz4 + 2*d4*mcy4 + d4^2*(m4+m5+m6+m7)
Iyy3R = Iyy3 + Izz4 + 2*d4*mcy4 + d4^2*(m4+m5+m6+m7)
mcz4R = mcz4 + mcy5 + d5*(m5+m6+m7)
Ixx4R = Ixx4 - Izz4 + Izz5 + 2*d5*mcy5 + d5^2*(m5+m6+m7)
Iyy4R = Iyy4 + Izz5 + 2*d5*mcy5 + d5^2*(m5+m6+m7)
mcz5R = mcz5 + mcy6
Ixx5R = Ixx5 - Izz5 + Izz6
Iyy5R = Iyy5 + Izz6
mcz6R = mcz6 + mcz7 + d7*m7
Ixx6R = Ixx6 - Izz6 + Iyy7 + 2*d7*mcz7 + d7^2*m7
Iyy6R = Iyy6 + Iyy7 + 2*d7*mcz7 + d7^2*m7
Ixx7R = Ixx7 - Iyy7
""".splitlines()
LWR_RELATIONS = """\
Iyy1R = Iyy1 + Im1 + Izz2
mcz2R = mcz2 - mcy3 + d3*(m3+m4+m5+m6+m7)
Ixx2R = Ixx2 - Izz2 + Izz3 - 2*d3*mcy3 + d3^2*(m3+m4+m5+m6+m7)
Iyy2R = Iyy2 + Im2 + Izz3 - 2*d3*mcy3 + d3^2*(m3+m4+m5+m6+m7)
mcz3R = mcz3 + mcy4
Ixx3R = Ixx3 - Izz3 + Izz4
Iyy3R = Iyy3 + Izz4
mcz4R = mcz4 + mcy5 + d5*(m5+m6+m7)
Ixx4R = Ixx4 - Izz4 + Izz5 + 2*d5*mcy5 + d5^2*(m5+m6+m7)
Iyy4R = Iyy4 + Izz5 + 2*d5*mcy5 + d5^2*(m5+m6+m7)
mcz5R = mcz5 - mcy6
Ixx5R = Ixx5 - Izz5 + Izz6
Iyy5R = Iyy5 + Izz6
mcz6R = mcz6 + mcz7 + d7*m7
Ixx6R = Ixx6 - Izz6 + Iyy7 + 2*d7*mcz7 + d7^2*m7
Iyy6R = Iyy6 + Iyy7 + 2*d7*mcz7 + d7^2*m7
Ixx7R = Ixx7 - Iyy7
""".splitlines()


def test_relations_are_named_in_dh_symbols():
    assert texts(GEN2) == GEN2_RELATIONS
    assert texts(LWR) == LWR_RELATIONS


def test_printed_lwr_relations_are_those_without_lengths():
    shown = [" ".join(re.sub(r" [+-] (2\*)?d[^ ]*", "", text).split()) for text in LWR_RELATIONS]
    assert texts(LWR_ZERO) == shown


@pytest.mark.slow
@pytest.mark.parametrize("d4", [0.1, 1e-3, 1e-6])
def test_relations_do_not_depend_on_how_small_an_offset_is(d4):
    joints = tuple(replace(j, d=d4) if k == 3 else j for k, j in enumerate(GEN2.joints))
    assert texts(replace(GEN2, joints=joints)) == texts(GEN2)


def test_a_near_right_angle_leaves_the_rank_open_and_the_message_says_where():
    joints = tuple(replace(j, twist=1.5708) if k == 0 else j for k, j in enumerate(GEN2.joints))
    model = build_model(replace(GEN2, joints=joints))
    with pytest.raises(ReductionsDisagree) as caught:
        base_parameters(model, tolerance=1e-4)
    assert caught.value.code == "E209"
    assert "singular values relative to the largest are" in caught.value.what


def test_gravity_along_an_oblique_joint_axis_is_recognised_without_a_tolerance():
    # Joint 1 stands along gravity only because both lean by 45 degrees; other leaning arms have more parameters.
    joints = tuple(
        Joint(f"j{k}", twist=t, a=a, d=0.1, friction=())
        for k, t, a in ((1, math.pi / 4, 0), (2, math.pi / 2, 0.3), (3, 0, 0.2))
    )
    upright = Robot(
        "upright", "modified", (replace(joints[0], twist=0.0), *joints[1:]), gravity=(0, 0, -9.81)
    )
    leaning = Robot("leaning", "modified", joints, gravity=(0, 6.93, -6.93))
    assert counts(leaning) == counts(upright)
    assert len(base_parameters(build_model(leaning)).formulas) == counts(upright)[0]


def test_a_subset_of_links_keeps_only_their_columns():
    r = base_parameters(build_model(replace(GEN2, links=(6, 7))))
    assert set(r.names) <= {f"{n.rstrip('0123456789')}{k}" for n in r.names for k in (6, 7)}
    assert "mcz6R = mcz6 + mcz7 + d7*m7" in r.formulas


def test_torques_at_rest_of_the_seven_joint_arm_have_nineteen_parameters_with_offsets():
    arm = load_robot(ROBOTS / "kinova_gen2.yaml")
    model = build_model(arm)
    names = [base_name(g) for g in relations_of(model, still=True)]
    assert names == [
        *(name for k in range(2, 7) for name in (f"mcx{k}", f"mcz{k}R")),
        *("mcx7", "mcy7"),
        *(f"fo{k}" for k in range(1, 8)),
    ]


@pytest.mark.parametrize(
    "name", ["staubli_tx40", *(pytest.param(x, marks=pytest.mark.slow) for x in REAL)]
)
def test_base_columns_times_relations_give_the_whole_regressor(name):
    """Columns of the TX40's coupled motors take part like any; none is nearly made of others."""
    model = build_model(load_robot(name))
    found = base_parameters(model)
    P = model.regressor(*random_states(model.robot, 20, seed=7)).reshape(-1, model.size)
    base = P[:, found.base]
    assert base @ found.K == pytest.approx(P, abs=1e-9 * np.abs(P).max())
    assert np.linalg.cond(base / np.linalg.norm(base, axis=0)) < 20


def test_the_result_does_not_depend_on_the_seed():
    model = build_model(GEN2)
    first, second = reduce(model), reduce(model, seed=99)
    assert first.base.tolist() == second.base.tolist()
    assert pytest.approx(second.K, abs=1e-9) == first.K


def test_a_joint_that_slides_along_gravity_ties_mass_rotor_and_offset_together():
    """Its force is m (qdd + g) + Im qdd + fo: three parameters, two functions of time."""
    robot = load_robot("scara")
    found = reduce(build_model(robot))
    sliding = next(k for k, joint in enumerate(robot.joints, start=1) if not joint.revolute)
    assert {f"m{sliding}", f"Im{sliding}", f"fo{sliding}"} <= set(found.combined)
    together = [terms for i in range(found.rank) if f"fo{sliding}" in (terms := found.terms(i))]
    assert together
