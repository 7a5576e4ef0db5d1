"""A result becomes a file, and the file is proved before anybody trusts it."""

import json
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from dynid import export
from dynid.errors import NotPhysical, WrongUsage
from dynid.estimation.possible_arm import constraints_of
from dynid.estimation.possible_set import smallest_eigenvalues
from dynid.exporters import FORMATS


@pytest.mark.parametrize(
    ("name", "format"), [("arm.urdf", "urdf"), ("ARM.XML", "mjcf"), ("arm.py", "python")]
)
def test_the_suffix_names_the_format_and_the_file_is_written_and_proved(
    result, tmp_path, name, format
):
    made = export(result, tmp_path / name)
    file = made.files[0]
    assert (file.format, file.path) == (format, tmp_path / name)
    assert file.path.read_text(encoding="utf-8") == file.text
    assert file.agreements
    assert all(
        each.agrees and each.states == 1000 and each.largest < 1e-9 for each in file.agreements
    )
    assert made.agrees
    assert made.findings == ()
    beside = [each for each in made.files[1:] if each.path == tmp_path / "effects.py"]
    assert len(beside) == (format == "urdf"), (
        "a URDF has no place for offsets and the smooth start of friction"
    )
    assert all(each.agrees and each.agreements for each in beside)


def test_a_suffix_of_no_format_is_refused_with_those_there_are(result, tmp_path):
    with pytest.raises(WrongUsage, match=r"no format has the suffix '\.stl'") as raised:
        export(result, tmp_path / "arm.stl")
    assert ".urdf, .xml, .yaml" in raised.value.fix
    assert not list(tmp_path.iterdir())


def test_without_gains_nothing_is_in_kilograms(result, tmp_path):
    torque = replace(result.robot.torque, source="motor_current", gain=(1.0, 2.0), relative=True)
    currents = replace(result, robot=replace(result.robot, torque=torque))
    with pytest.raises(NotPhysical, match="sizes of masses and inertias are unknown"):
        export(currents, tmp_path / "arm.urdf")
    facts = currents.facts()
    units = {row["unit"] for row in facts["parameters"]}
    assert units <= {"A s^2/m^2", "A s^2/m", "A s^2/rad^2", "A", "A s/rad"}
    noise = result.expected.noise / (1.0, 2.0)
    np.testing.assert_allclose(facts["expected_torque_error"]["noise_a"], noise)


def test_a_file_that_disagrees_is_said(result, tmp_path, monkeypatch):
    """W408 with the engine and the difference; the export does not agree then."""
    right = FORMATS["python"]
    wrong = replace(right, text=lambda arm: right.text(replace(arm, theta=1.01 * arm.theta)))
    monkeypatch.setitem(FORMATS, "python", wrong)
    made = export(result, tmp_path / "arm.py")
    assert not made.agrees
    (finding,) = made.files[0].findings()
    assert finding.code == "W408"
    assert "NumPy differs by" in finding.text


def test_draws_are_possible_arms_that_a_seed_repeats_and_whose_known_numbers_stay(result):
    """Masses exist, friction is positive, and what the logs determine spreads as the posterior says."""
    drawn = result.draws(400, seed=3)
    np.testing.assert_array_equal(drawn.x, result.draws(400, seed=3).x)
    columns = constraints_of(result.base).bodies
    assert smallest_eigenvalues(drawn.x[:, columns]).min() > 0
    friction = [k for k, name in enumerate(drawn.names) if name.startswith(("fv", "fc"))]
    assert (drawn.x[:, friction] >= 0).all()
    K, covariance = result.reduction.K, result.physical.covariance
    spread = np.sqrt(np.diagonal(K @ covariance @ K.T))
    best = np.argsort(spread / np.abs(K @ result.physical.x))[:3]
    np.testing.assert_allclose(drawn.theta.std(axis=0)[best], spread[best], rtol=0.2)


def test_a_band_of_draws_holds_their_torques(result):
    q, qd, qdd = np.random.default_rng(0).normal(size=(3, 30, result.robot.n))
    drawn = result.draws(300)
    low, high = drawn.band(q, qd, qdd)
    tau = drawn.torques(q, qd, qdd)
    assert tau.shape == (300, 30, result.robot.n)
    inside = (tau + drawn.noise * np.random.default_rng(1).normal(size=tau.shape) > low).mean()
    assert inside == pytest.approx(0.95, abs=0.02)
    assert (high > low).all()


@pytest.mark.parametrize("count", [0, -1, 2.5, "many"])
def test_a_number_of_draws_that_is_none_is_refused(result, count):
    with pytest.raises(WrongUsage, match="cannot be drawn"):
        result.draws(count)


def test_draws_are_written_as_models_that_mujoco_loads_and_one_file_of_ranges(result, tmp_path):
    made = export(result, tmp_path, draws=3, formats=("mjcf", "c"), seed=5)
    assert [path.name for path in made.drawn] == [
        "arm_1.xml",
        "arm_2.xml",
        "arm_3.xml",
        "draws.json",
    ]
    models = [mujoco.MjModel.from_xml_path(str(path)) for path in made.drawn[:-1]]
    assert len({float(model.body_mass.sum()) for model in models}) == 3
    facts = json.loads(made.drawn[-1].read_text())
    assert (facts["schema"], facts["draws"], facts["seed"]) == ("dynid/draws/1", 3, 5)
    assert len(facts["correlation"]) == len(facts["correlated"])
    assert [each["joint"] for each in facts["random_torque_nm"]] == list(result.robot.joint_names)
    with pytest.raises(WrongUsage, match="URDF or MJCF"):
        export(result, tmp_path, draws=3, formats=("c",))
