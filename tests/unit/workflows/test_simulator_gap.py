"""Exported files driven along a log: what a model lacks shows as strayed positions, and goes when it is added."""

from dataclasses import replace

import numpy as np
import pytest

import dynid
from dynid.errors import WrongUsage
from dynid.robot import EffectSpec
from dynid.sim.arm import SimulatedArm, track
from dynid.sim.plant import plant_of
from dynid.sim.sines import SineSpec, sines
from dynid.workflows.simulator_gap import save_figure


@pytest.fixture(scope="module")
def results():
    """The LWR4+ with a spring of 12 N m/rad on joint 4: identified without it and with it, and an unseen log."""
    arm, rng = dynid.load_robot("kuka_lwr4plus"), np.random.default_rng(2)
    plant, spec, logs = plant_of(arm), SineSpec(12.0, 12.0, 0.5, 0.6, 0.4, 0.05), []
    with SimulatedArm(
        arm, plant.bodies, plant.friction, plant.rotor_inertia, dt=1.25e-3
    ) as simulated:
        simulated.extra = lambda t, q, v: np.array([0, 0, 0, 12.0 * q[3], 0, 0, 0])
        for _ in range(3):
            done = track(simulated, sines(arm, spec, 1.25e-3, rng), 4)
            logs.append(replace(plant.sensors.measure(done, arm.joint_names, rng), dh=True))
    spring = EffectSpec("spring", (arm.joint_names[3],), {"order": 1.0, "constant": 0.0})
    arms = arm, replace(arm, effects=(spring,))
    return [dynid.identify(each, logs[:2]) for each in arms], logs[2]


@pytest.mark.parametrize("engine", ["mujoco", pytest.param("pybullet", marks=pytest.mark.slow)])
def test_the_gap_shrinks_in_the_simulator_when_the_effect_is_added(results, engine, tmp_path):
    """The physics of the log is PyBullet's with a spring by hand; what is loaded are the exported files."""
    found = dynid.compare_in_simulator(*results, engine=engine)
    before, after = found.position_rms[:, 3]
    assert after < 0.5 * before
    assert found.torque_rms[1, 3] < 0.5 * found.torque_rms[0, 3]
    facts = found.facts()
    assert [model["name"] for model in facts["models"]] == ["before", "after"]
    assert "->" in repr(found)
    assert save_figure(found, tmp_path / "gap.png").stat().st_size > 10_000


def test_wrong_engines_and_names_are_refused(results):
    with pytest.raises(WrongUsage, match="engine"):
        dynid.compare_in_simulator(*results, engine="gazebo")
    with pytest.raises(WrongUsage, match="3 names for 2 results"):
        dynid.compare_in_simulator(*results, names=("a", "b", "c"))
