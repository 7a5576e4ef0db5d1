"""Loops 2 and 3 on simulated arms behind a real master: plan, accept, record, and the model found from that."""

import signal
import time
from pathlib import Path

import numpy as np
import pytest
import yaml
from lab import ROOT

from dynid.files.artifact import sha256
from dynid.files.logs import read_log
from dynid.files.npzlog import read_npz_log
from dynid.files.robotfile import load_robot
from dynid.files.trajectoryfile import read_trajectory
from dynid.sim.plant import read_plant

KINOVA, LWR = "kinova_gen2", "kuka_lwr4plus"
TRUTH = {KINOVA: "kinova_gen2_truth.yaml", LWR: "lwr4plus_truth.yaml"}
#: The motion that is identified from is searched for a few seconds, the one that is predicted is any other.
PLANS = {
    "identify": ("--duration", "16", "--segments", "8", "--seconds", "3", "--restarts", "1"),
    "validate": ("--duration", "7", "--segments", "4", "--no-optimise", "--seed", "1"),
}


def done(child):
    ended = child.end()
    assert ended.status == 0, ended.err
    return ended


def planned(lab, robot):
    """Plan both motions, look at their pictures unattended, and accept them; return their paths."""
    paths = {name: lab.folder / name / "trajectory.npz" for name in PLANS}
    for name, words in PLANS.items():
        done(lab.start("trajectory", robot, *words, "--alpha", "1", "--preview", "picture", "--out", name, "-q"))
        assert (lab.folder / name / "preview.png").stat().st_size > 10_000
        assert not read_trajectory(paths[name]).reviewed, "nobody has said yes"
    for path in paths.values():
        done(lab.start("trajectory", robot, "--review", path, "--accept", "--preview", "none", "-q"))
        assert read_trajectory(path).reviewed
    return paths


def recorded(lab, robot, trajectory, rate, *words):
    """Record a motion; return its folder, the command's answer and what the driver received."""
    driver = lab.driver(robot, "--pose", trajectory, "--rate", rate)
    folder = trajectory.parent / "recording"
    answer = done(lab.start("record", robot, trajectory, "--move", robot, "--out", folder, *words, "--json")).facts
    return folder, answer, lab.finish(driver)


@pytest.mark.slow
@pytest.mark.parametrize(("robot", "rate"), [(KINOVA, 100), (LWR, 200), (LWR, 1000)])
def test_a_model_identified_from_a_recording_predicts_another_within_the_noise(lab, robot, rate):
    plans = planned(lab, robot)
    train, facts, sent = recorded(lab, robot, plans["identify"], rate)
    assert facts["lost"] == 0
    assert facts["rate_hz"] == pytest.approx(rate, rel=0.01)
    assert sent["violations"] == [], "the commands keep the limits at the receiving end"
    assert sent["velocity_share"] <= 1
    assert sent["acceleration_share"] <= 1
    same_numbers(train, robot, rate)
    manifest = yaml.safe_load((train / "manifest.yaml").read_text())
    assert manifest["verdict"] == "clean"
    assert manifest["log"]["sha256"] == sha256(train / "log.bag")
    assert manifest["trajectory"]["sha256"] == sha256(plans["identify"])

    done(lab.start("model", robot, "--out", "found", "-q"))
    done(lab.start("parameters", robot, train / "log.npz", "--out", "found", "-q"))
    done(lab.start("identify", robot, train / "log.npz", "--holdout", "none", "--out", "found", "-q"))
    unseen, facts, _ = recorded(lab, robot, plans["validate"], rate, "--parameters", "found/parameters.npz")
    assert facts["foreseen"]["torque_share"] == pytest.approx(facts["largest_torque_share"], abs=0.02)
    answer = done(lab.start("validate", "found/parameters.npz", unseen / "log.npz", "--no-plot", "--json")).facts
    noise = read_plant(ROOT / "trajectories" / TRUTH[robot]).sensors.torque_noise
    errors = [joint["rms_nm"] for joint in answer["joints"]]
    assert all(error <= 1.2 * added for error, added in zip(errors, noise, strict=True)), (errors, noise)



def same_numbers(folder, robot, rate):
    """Bag, text files and log.npz hold the same numbers, and no sample is missing."""
    bag, text = (read_log(folder / part, robot=load_robot(robot)) for part in ("log.bag", "log"))
    where = [bag.names.index(name) for name in text.names]
    np.testing.assert_array_equal(text.q, bag.q[:, where])
    np.testing.assert_array_equal(text.qd, bag.qd[:, where])
    np.testing.assert_array_equal(text.tau, bag.tau[:, where])
    np.testing.assert_allclose(text.t, bag.t, atol=1e-9)
    np.testing.assert_array_equal(read_npz_log(folder / "log.npz").tau, bag.tau)
    # Why: the driver samples without a miss, so a lost message would be a gap of two periods.
    np.testing.assert_allclose(np.diff(bag.t), 1 / rate, atol=1e-6)


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
