"""What keeps an arm from moving: nobody typed its name, or something is not in order. Every refusal sends nothing."""

import os
import subprocess
from dataclasses import replace

import numpy as np
import pytest
from lab import KINOVA, LWR, MIDDLE, store

from dynid.files.trajectoryfile import read_trajectory, write_trajectory
from motions import standing


def test_nothing_moves_unless_a_person_or_the_option_names_the_robot(lab):
    driver, trajectory = lab.ready(KINOVA)
    line = f"record {KINOVA}"
    asked = lab.typing(line, trajectory, "--no-convert", "--yes", keys=["\ny\nyes\n"])
    closed = lab.fresh(line, trajectory, preexec_fn=lambda: os.close(0))
    runs = [closed, lab.record(KINOVA, trajectory, "--yes"), lab.record(KINOVA, trajectory)]
    yes = subprocess.Popen(["yes", KINOVA], stdout=subprocess.PIPE)
    runs.append(lab.record(KINOVA, trajectory, "--yes", stdin=yes.stdout))
    yes.kill()
    yes.communicate()
    lab.env |= dict.fromkeys(("DYNID_MOVE", "DYNID_RECORD_MOVE"), KINOVA)
    lab.env |= {"DYNID_YES": "1", "DYNID_NO_INPUT": "0"}
    runs.append(lab.record(KINOVA, trajectory))
    for done in runs:
        done.failed(7, "error[E703]", f"--move {KINOVA}")
    assert asked.status == 7, "not even a person's yes on a terminal stands for the name"
    assert "error[E704]" in asked.err
    assert lab.finish(driver)["commands"] == 0


def test_a_file_of_the_folder_answers_nothing_and_moves_nothing(lab):
    trajectory = lab.plan(KINOVA)
    keys = "accept_unreviewed: true", "max_deviation: 90", "zero_torques: true", f"move: {KINOVA}"
    for text in ("yes: true", *(f"record: {{{key}}}" for key in keys)):
        (lab.folder / "dynid.yaml").write_text(f"{text}\n")
        done = lab.record(KINOVA, trajectory)
        assert done.status in (2, 3)
        assert "which only you may set" in done.err or "unknown key" in done.err
    assert "unknown key 'move'" in done.err


def test_a_wrong_name_moves_nothing_and_the_right_one_does(lab):
    driver, trajectory = lab.ready(KINOVA)
    line = f"record {KINOVA} --no-convert"
    wrong = lab.typing(line, trajectory, keys=["kinova\n"])
    assert wrong.status == 7
    assert "error[E704]" in wrong.err
    assert "the arm was not moved" in wrong.err
    assert "moved " in lab.typing(line, trajectory, keys=["kinova_gen2\n"]).good.err
    assert 300 < lab.finish(driver)["commands"] < 330


def test_a_wrong_name_in_the_option_is_wrong_usage(lab):
    done = lab.record(KINOVA, lab.plan(KINOVA), "--move kinova")
    assert done.status == 2
    assert "--move names 'kinova'" in done.err


def test_what_preflight_refuses_is_not_sent(lab):
    driver, trajectory = lab.ready(KINOVA)
    stored, folder = read_trajectory(trajectory), lab.folder
    motion = stored.motion
    slower = replace(motion, t=motion.t * 1.5, qd=motion.qd / 1.5, qdd=motion.qdd / 1.5**2)
    write_trajectory(folder / "changed.npz", replace(stored, motion=slower))
    away = replace(motion, q=motion.q + 0.4 * (np.arange(7) == 1))
    store(folder / "away.npz", KINOVA, away)
    start = "error[E503] the arm is 0.40 rad from the start on j2s7s300_joint_2"
    unreviewed = lab.plan(KINOVA, name="unreviewed.npz", reviewed=False)
    cases = [
        ([unreviewed], 5, "error[E505] nobody confirmed"),
        ([folder / "changed.npz"], 5, "was changed after a person confirmed it"),
        ([folder / "away.npz"], 5, start),
        ([trajectory, "--speed 400%"], 5, "--speed "),
        ([trajectory, "--topic /nothing"], 3, "error[E303]"),
        ([trajectory, "--dry-run"], 0, "nothing was sent"),
    ]
    # Why: three at once, because each of them listens for two seconds; more would keep the driver from its rate.
    for some in (cases[:3], cases[3:]):
        running = [lab.begin(f"record {KINOVA} --move {KINOVA}", *words) for words, *_ in some]
        for (_, status, said), child in zip(some, running, strict=True):
            child.end().failed(status, said)
    assert not list((folder / "out").rglob("log.bag"))
    assert lab.finish(driver)["commands"] == 0


@pytest.mark.parametrize(
    ("driver", "status", "said"),
    [
        ("--rate 10", 4, ("error[E314] joint states", "feedback_publish_rate:=0.01")),
        ("--drop 1", 6, ("is advertised but silent for 2 s",)),
        (None, 6, ("error[E603] no node publishes anything",)),
    ],
)
def test_a_driver_that_is_slow_silent_or_absent_is_told_apart(lab, driver, status, said):
    """The default rate of kinova-ros is too slow: its launch argument is said."""
    _, path = lab.ready(KINOVA, 3.0, "", driver) if driver else (None, lab.plan(KINOVA))
    lab.move(KINOVA, path).failed(status, *said)


def test_without_a_master_it_ends(lab):
    lab.env["ROS_MASTER_URI"] = "http://127.0.0.1:1"
    said = "error[E602] no ROS master at http://127.0.0.1:1 (connection refused)"
    lab.move(KINOVA, lab.plan(KINOVA)).failed(6, said)


def test_torques_without_gravity_are_refused(lab):
    topics, running = {KINOVA: "/j2s7s300_driver/out/joint_state", LWR: "/lwr/joint_states"}, []
    plans = {robot: lab.ready(robot, 3.0, "gravity-free")[1] for robot in topics}
    for robot, topic in topics.items():
        line = f"record {robot} --move {robot} --topic {topic}"
        running.append(lab.begin(line, plans[robot]))
    for child in running:
        child.end().failed(3, "error[E317]")


def test_the_arm_is_brought_to_the_start_when_asked(lab):
    path = lab.plan(KINOVA)
    pose = ",".join(str(x) for x in MIDDLE[KINOVA] + 0.06 * (np.arange(7) == 3))
    driver = lab.driver(KINOVA, "--pose", pose)
    facts = lab.move(KINOVA, path, "--go-to-start", "--json").facts
    assert facts["largest_deviation_rad"] < 0.03
    assert facts["seconds"] > 4.9
    assert lab.finish(driver)["violations"] == []


def test_sensors_are_zeroed_at_the_candle_pose(lab):
    path = store(lab.folder / "candle.npz", KINOVA, standing(np.full(7, np.pi)))
    lab.driver(KINOVA, "--torque-offset 0.5 --torque-noise 0.01")
    done = lab.record(KINOVA, path, "--dry-run")
    assert "warning[W316]" in done.err
    assert "--zero-torques" in done.err
    assert lab.move(KINOVA, path, "--zero-torques").good
    torque = np.loadtxt(lab.folder / "out" / KINOVA / "log" / "torque.txt", skiprows=1)
    assert np.abs(torque.mean(axis=0)).max() < 0.02


def test_a_recording_is_not_overwritten_unasked(lab):
    driver, trajectory = lab.ready(LWR, 2.0)
    bag = lab.folder / "out" / LWR / "log.bag"
    bag.write_bytes(b"precious")
    lab.move(LWR, trajectory).failed(7, "error[E702]")
    assert bag.read_bytes() == b"precious"
    assert lab.finish(driver)["commands"] == 0
