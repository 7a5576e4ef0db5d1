"""URDF and MJCF move in other people's engines as the parameters say."""

import xml.etree.ElementTree as ET
from dataclasses import replace

import mujoco
import pytest
from export_cases import SHIPPED, off_in_pinocchio, off_in_pybullet, random, shipped, written
from numpy.testing import assert_allclose

from dynid.exporters import FORMATS
from dynid.exporters.effects_file import EFFECTS
from dynid.exporters.full_model import model_of
from dynid.exporters.urdf import own_gravity
from dynid.robot import Body

CASES = {name: lambda name=name: shipped(name) for name in SHIPPED}
CASES |= {f"random {seed}": lambda seed=seed: random(seed) for seed in range(4)}


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
@pytest.mark.parametrize("case", CASES)
def test_a_written_file_gives_dynids_torques_in_every_engine(case, format, tmp_path):
    """1000 states, shipped and random arms of any pose: 1e-8 N m in Pinocchio, PyBullet and MuJoCo."""
    source = CASES[case]()
    path = written(source, format, tmp_path)
    (agreement,) = FORMATS[format].check(path.read_text(), source)
    assert (agreement.engine, agreement.states) == (f"MuJoCo {mujoco.__version__}", 1000)
    least = 1e-9 if case in SHIPPED else 1e-8
    assert agreement.largest < least
    assert off_in_pinocchio(source, path) < least
    if format == "urdf":
        assert off_in_pybullet(source, path) < 1e-8
        assert EFFECTS.check(EFFECTS.text(source), source)[0].largest < 1e-8


def test_mujoco_gets_rotors_and_friction_and_the_urdf_friction(tmp_path):
    """Armature, damping and friction loss of each joint are the identified numbers."""
    source = shipped("kuka_lwr4plus")
    model = mujoco.MjModel.from_xml_path(str(written(source, "mjcf", tmp_path)))
    assert_allclose(model.dof_armature, source.full.of_joints("Im"))
    assert_allclose(model.dof_damping.ravel()[:7], source.full.of_joints("fv"))
    assert_allclose(model.dof_frictionloss, source.full.of_joints("fc"))
    root = ET.parse(written(source, "urdf", tmp_path)).getroot()
    damping = [float(joint.find("dynamics").get("damping")) for joint in root.findall("joint")]
    assert_allclose(damping, source.full.of_joints("fv"))


def test_what_a_format_cannot_hold_is_said():
    """Offsets fit nowhere, rotors only in MJCF, a gravity that is not that of simulators not in a URDF."""
    source = shipped("kuka_lwr4plus")
    said = {name: " ".join(exporter.leaves_out(source)) for name, exporter in FORMATS.items()}
    assert all("offsets" in said[name] for name in ("urdf", "mjcf"))
    assert "rotor" in said["urdf"]
    assert "rotor" not in said["mjcf"]
    assert not said["c"]
    assert "gravity" not in said["urdf"]
    assert "0, -9.8, 0" in own_gravity(replace(source.robot, gravity=(0.0, -9.8, 0.0)))


@pytest.mark.parametrize("format", ["urdf", "mjcf"])
def test_each_link_says_what_comes_from_data_and_what_from_the_prior(format):
    """The origin of every parameter stands beside its link."""
    source = shipped("scara")
    source.full.origin["Izz2"] = "prior"
    text = FORMATS[format].text(source)
    assert "from prior: Izz2" in text
    assert "from data: m1" in text


def test_a_body_that_is_possible_up_to_rounding_is_written_as_mujoco_takes_it(tmp_path):
    """A flat plate, a rod and a point of mass: their pseudo-inertias have eigenvalues of zero."""
    source = shipped("scara")
    thin = (Body(1.0, (0.1, 0, 0), tensor) for tensor in ((0.1, 0, 0, 0.2, 0, 0.3), (0,) * 6))
    rod = Body(2.0, (0.0, 0.2, 0.1), (0.3, 0.0, 0.0, 0.0, 0.0, 0.3))
    bodies = (*source.full.bodies[:1], *thin, rod)
    gamma = replace(source.full, bodies=bodies).values(source.base.model.parameter_names)
    full = model_of(source.base, source.base.model.parameter_names, gamma, source.full.origin)
    assert full.impossible_links() == ()
    model = mujoco.MjModel.from_xml_string(FORMATS["mjcf"].text(replace(source, full=full)))
    assert (model.body_inertia[1:] > 0).all()
    assert_allclose(full.values(source.base.model.parameter_names), gamma, rtol=1e-8, atol=1e-8)
