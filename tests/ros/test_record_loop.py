"""Loops 2 and 3 on simulated arms behind a real master: nothing lost, and the model found from what was recorded."""

import json
import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from lab import ROOT, store

from dynid.files.artifact import sha256
from dynid.files.logs import read_log
from dynid.files.npzlog import read_npz_log
from dynid.files.robotfile import load_robot
from dynid.sim.plant import read_plant
from dynid.sim.sines import SineSpec, sines

KINOVA, LWR = "kinova_gen2", "kuka_lwr4plus"
TRUTH = {KINOVA: "kinova_gen2_truth.yaml", LWR: "lwr4plus_truth.yaml"}
SHARES = {
    KINOVA: {"reach": 0.5, "speed": 0.85, "acceleration": 0.8},
    LWR: {"reach": 0.6, "speed": 0.5, "acceleration": 0.5},
}


def exciting(path, robot, seconds, period):
    spec = SineSpec(duration=seconds, period=period, floor=0.1, **SHARES[robot])
    return store(path, robot, sines(load_robot(robot), spec, 0.01, np.random.default_rng(0)))


def recorded(lab, robot, name, seconds, period, rate):
    """Record one exciting motion; return its folder and what the driver received."""
    trajectory = exciting(lab.folder / f"{name}.npz", robot, seconds, period)
    driver = lab.driver(robot, "--pose", trajectory, "--rate", rate)
    done = lab.record(robot, trajectory, "--move", robot, "--out", name, "--json")
    assert done.status == 0, done.err
    return lab.folder / name, done.facts, lab.finish(driver)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "rate"), [(KINOVA, 100), (LWR, 200)])
def test_a_model_identified_from_a_recording_predicts_another_within_the_noise(lab, robot, rate):
    runs = [("identify", 20.0, 16.0), ("validate", 9.0, 8.0)]
    (train, facts, sent), (unseen, _, _) = (recorded(lab, robot, *run, rate) for run in runs)
    assert facts["lost"] == 0
    assert facts["rate_hz"] == pytest.approx(rate, rel=0.01)
    assert sent["violations"] == [], "the commands keep the limits at the receiving end"
    assert sent["velocity_share"] <= 1
    assert sent["acceleration_share"] <= 1

    bag, text = (read_log(train / part, robot=load_robot(robot)) for part in ("log.bag", "log"))
    where = [bag.names.index(name) for name in text.names]
    np.testing.assert_array_equal(text.q, bag.q[:, where])
    np.testing.assert_array_equal(text.qd, bag.qd[:, where])
    np.testing.assert_array_equal(text.tau, bag.tau[:, where])
    np.testing.assert_allclose(text.t, bag.t, atol=1e-9)
    np.testing.assert_array_equal(read_npz_log(train / "log.npz").tau, bag.tau)
    # Why: the driver samples without a miss, so a lost message would be a gap of two periods.
    np.testing.assert_allclose(np.diff(bag.t), 1 / rate, atol=1e-6)

    manifest = yaml.safe_load((train / "manifest.yaml").read_text())
    assert manifest["verdict"] == "clean"
    assert manifest["log"]["sha256"] == sha256(train / "log.bag")
    assert manifest["trajectory"]["sha256"] == sha256(lab.folder / "identify.npz")

    lab.env |= {"OMP_NUM_THREADS": "2"}
    done = lab.start("identify", robot, train / "log.bag", "--holdout", "none", "--out", "found", "-q").end()
    assert done.status == 0, done.err
    done = lab.start("validate", "found/parameters.npz", unseen / "log.bag", "--json").end()
    assert done.status == 0, done.err
    noise = read_plant(ROOT / "trajectories" / TRUTH[robot]).sensors.torque_noise
    errors = [joint["rms_nm"] for joint in json.loads(done.out)["joints"]]
    assert all(error <= 1.2 * added for error, added in zip(errors, noise, strict=True)), (errors, noise)


def test_nothing_is_lost_at_1_khz(lab, plan):
    trajectory = plan(LWR, 5.0)
    driver = lab.driver(LWR, "--pose", trajectory, "--rate", "1000")
    done = lab.record(LWR, trajectory, "--move", LWR, "--json", "--no-convert")
    assert done.status == 0, done.err
    assert done.facts["lost"] == 0
    log = read_log(lab.folder / "out" / LWR / "log.bag", robot=load_robot(LWR))
    assert len(log) == done.facts["messages"] > 5000
    np.testing.assert_allclose(np.diff(log.t), 1e-3, atol=1e-6)
    assert lab.finish(driver)["violations"] == []


def test_another_program_may_move_the_arm_while_it_is_recorded(lab):
    driver = lab.driver(KINOVA, "--rate", "100")
    done = lab.record(KINOVA, "--listen-only", "--duration", "2", "--json")
    assert done.status == 0, done.err
    assert 190 <= done.facts["messages"] <= 215
    child = lab.start("record", KINOVA, "--listen-only", "--out", "until-stopped")
    child.wait_for("listening")
    time.sleep(0.5)
    child.send(signal.SIGTERM)
    assert child.end().status == 0
    assert lab.finish(driver)["commands"] == 0


def test_dropped_and_late_messages_are_survived_and_told(lab, plan):
    trajectory = plan(KINOVA, 3.0)
    lab.driver(KINOVA, "--pose", trajectory, "--drop", "0.05", "--latency", "0.02", "--jitter", "0.005")
    done = lab.record(KINOVA, trajectory, "--move", KINOVA, "--json", "--no-convert")
    assert done.status == 0, done.err
    log = read_log(Path(lab.folder) / "out" / KINOVA / "log.bag", robot=load_robot(KINOVA))
    assert np.diff(log.t).max() >= 0.0199, "a dropped message is a gap in the stamps"
