"""What keeps an arm from moving: nobody typed its name, or something is not in order. Every refusal sends nothing."""

import os
import pty
import signal
import subprocess
import sys
import time
from dataclasses import replace

import numpy as np
from lab import LIMIT, MIDDLE, Ended, store, swing

from dynid.files.trajectoryfile import read_trajectory, write_trajectory
from dynid.motion import Motion

KINOVA, LWR = "kinova_gen2", "kuka_lwr4plus"


def test_nothing_moves_unless_a_person_or_the_option_names_the_robot(lab, plan):
    trajectory = plan(KINOVA)
    driver = lab.driver(KINOVA, "--pose", trajectory)
    words = ("record", KINOVA, trajectory)
    typed_yes = typed(lab, trajectory, b"\ny\nyes\n", "--yes")
    runs = [lab.start(*words, "--yes").end(), lab.start(*words).end()]
    closed = subprocess.Popen(
        [sys.executable, "-m", "dynid", *map(str, words)],
        cwd=lab.folder,
        env=lab.env,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: os.close(0),
    )
    out, err = closed.communicate(timeout=LIMIT)
    yes = subprocess.Popen(["yes", KINOVA], stdout=subprocess.PIPE)
    runs.append(lab.start(*words, "--yes", stdin=yes.stdout).end())
    yes.kill()
    yes.communicate()
    lab.env |= dict.fromkeys(("DYNID_MOVE", "DYNID_RECORD_MOVE"), KINOVA)
    lab.env |= {"DYNID_YES": "1", "DYNID_NO_INPUT": "0"}
    runs.append(lab.start(*words).end())
    for done in [*runs, Ended(closed.returncode, out, err)]:
        assert (done.status, done.out) == (7, ""), done.err
        assert "error[E703]" in done.err
        assert f"--move {KINOVA}" in done.err
    assert typed_yes[0] == 7, "not even a person's yes on a terminal stands for the name"
    assert "error[E704]" in typed_yes[1]
    assert lab.finish(driver)["commands"] == 0


def test_a_file_of_the_folder_answers_nothing_and_moves_nothing(lab, plan):
    trajectory = plan(KINOVA)
    keys = ("accept_unreviewed: true", "max_deviation: 90", "zero_torques: true")
    for text in ("yes: true", *(f"record: {{{key}}}" for key in keys)):
        (lab.folder / "dynid.yaml").write_text(f"{text}\n")
        done = lab.record(KINOVA, trajectory)
        assert done.status in (2, 3)
        assert "which only you may set" in done.err or "unknown key" in done.err
    (lab.folder / "dynid.yaml").write_text(f"record: {{move: {KINOVA}}}\n")
    done = lab.record(KINOVA, trajectory)
    assert done.status != 0
    assert "unknown key 'move'" in done.err


def typed(lab, trajectory, line, *words):
    """Run on a pseudo-terminal and type a line when the robot's name is asked for."""
    master, slave = pty.openpty()
    process = subprocess.Popen(
        [sys.executable, "-m", "dynid", "record", KINOVA, str(trajectory), "--no-convert", *words],
        cwd=lab.folder,
        env=lab.env,
        stdin=slave,
        stderr=slave,
        stdout=subprocess.DEVNULL,
        start_new_session=True,
    )
    os.close(slave)
    shown, end = b"", time.monotonic() + 60
    while time.monotonic() < end:
        try:
            shown += os.read(master, 65536)
        except OSError:
            break
        if line and b"name to start:" in shown:
            os.write(master, line)
            line = b""
    os.close(master)
    return process.wait(timeout=10), shown.decode()


def test_a_wrong_name_moves_nothing_and_the_right_one_does(lab, plan):
    trajectory = plan(KINOVA, 3.0)
    driver = lab.driver(KINOVA, "--pose", trajectory)
    status, shown = typed(lab, trajectory, b"kinova\n")
    assert status == 7
    assert "error[E704]" in shown
    assert "the arm was not moved" in shown
    status, shown = typed(lab, trajectory, b"kinova_gen2\n")
    assert status == 0, shown
    assert "moved " in shown
    assert 300 < lab.finish(driver)["commands"] < 330


def test_a_wrong_name_in_the_option_is_wrong_usage(lab, plan):
    done = lab.record(KINOVA, plan(KINOVA), "--move", "kinova")
    assert done.status == 2
    assert "--move names 'kinova'" in done.err


def test_what_preflight_refuses_is_not_sent(lab, plan):
    trajectory = plan(KINOVA)
    driver = lab.driver(KINOVA, "--pose", trajectory)
    stored = read_trajectory(trajectory)
    slower = replace(
        stored.motion,
        t=stored.motion.t * 1.5,
        qd=stored.motion.qd / 1.5,
        qdd=stored.motion.qdd / 1.5**2,
    )
    write_trajectory(lab.folder / "changed.npz", replace(stored, motion=slower))
    store(
        lab.folder / "away.npz",
        KINOVA,
        replace(stored.motion, q=stored.motion.q + 0.4 * (np.arange(7) == 1)),
    )
    start = "error[E503] the arm is 0.40 rad from the start on j2s7s300_joint_2"
    expected = {
        (plan(KINOVA, name="unreviewed.npz", reviewed=False),): (5, "error[E505] nobody confirmed"),
        (lab.folder / "changed.npz",): (5, "was changed after a person confirmed it"),
        (lab.folder / "away.npz",): (5, start),
        (trajectory, "--speed", "400%"): (5, "--speed "),
        (trajectory, "--topic", "/nothing"): (3, "error[E303]"),
        (trajectory, "--dry-run"): (0, "nothing was sent"),
    }
    cases = list(expected.items())
    # Why: three at once, because each of them listens for two seconds; more would keep the driver from its rate.
    for some in (cases[:3], cases[3:]):
        running = [lab.start("record", KINOVA, *words, "--move", KINOVA) for words, _ in some]
        for (_, (status, said)), child in zip(some, running, strict=True):
            done = child.end()
            assert (done.status, done.out) == (status, ""), done.err
            assert said in done.err
    assert not list((lab.folder / "out").rglob("log.bag"))
    assert lab.finish(driver)["commands"] == 0


def test_the_default_rate_of_kinova_is_refused_with_the_launch_argument(lab, plan):
    trajectory = plan(KINOVA)
    lab.driver(KINOVA, "--pose", trajectory, "--rate", "10")
    done = lab.move(KINOVA, trajectory)
    assert done.status == 4
    assert "error[E314] joint states arrive at" in done.err
    assert "feedback_publish_rate:=0.01" in done.err


def test_torques_without_gravity_are_refused(lab, plan):
    plans = {robot: plan(robot, name=f"{robot}.npz") for robot in (KINOVA, LWR)}
    for robot, path in plans.items():
        lab.driver(robot, "--pose", path, "--fault", "gravity-free")
    topics = {KINOVA: "/j2s7s300_driver/out/joint_state", LWR: "/lwr/joint_states"}
    running = [
        lab.start("record", r, p, "--move", r, "--topic", topics[r]) for r, p in plans.items()
    ]
    for child in running:
        done = child.end()
        assert done.status == 3
        assert "error[E317]" in done.err


def test_the_arm_is_brought_to_the_start_when_asked(lab):
    motion = swing(KINOVA, 3.0)
    path = store(lab.folder / "trajectory.npz", KINOVA, motion)
    pose = ",".join(str(x) for x in MIDDLE[KINOVA] + 0.06 * (np.arange(7) == 3))
    driver = lab.driver(KINOVA, "--pose", pose)
    done = lab.move(KINOVA, path, "--go-to-start", "--json")
    assert done.status == 0, done.err
    assert done.facts["largest_deviation_rad"] < 0.03
    assert done.facts["seconds"] > 4.9
    assert lab.finish(driver)["violations"] == []


def test_without_a_master_it_ends(lab, plan):
    lab.env["ROS_MASTER_URI"] = "http://127.0.0.1:1"
    done = lab.move(KINOVA, plan(KINOVA))
    assert done.status == 6
    assert "error[E602] no ROS master at http://127.0.0.1:1 (connection refused)" in done.err


def test_a_silent_driver_is_told_from_an_absent_one(lab, plan):
    trajectory = plan(KINOVA)
    done = lab.move(KINOVA, trajectory)
    assert done.status == 6
    assert "error[E603] no node publishes anything" in done.err
    driver = lab.driver(KINOVA, "--drop", "1")
    done = lab.move(KINOVA, trajectory)
    assert done.status == 6
    assert "is advertised but silent for 2 s" in done.err
    driver.send(signal.SIGKILL)


def test_sensors_are_zeroed_at_the_candle_pose(lab):
    still = np.zeros((2, 7))
    candle = Motion(np.array([0.0, 1.0]), still + np.pi, still, still)
    path = store(lab.folder / "candle.npz", KINOVA, candle)
    lab.driver(KINOVA, "--torque-offset", "0.5", "--torque-noise", "0.01")
    done = lab.record(KINOVA, path, "--dry-run")
    assert "warning[W316]" in done.err
    assert "--zero-torques" in done.err
    done = lab.move(KINOVA, path, "--zero-torques")
    assert done.status == 0, done.err
    torque = np.loadtxt(lab.folder / "out" / KINOVA / "log" / "torque.txt", skiprows=1)
    assert np.abs(torque.mean(axis=0)).max() < 0.02


def test_a_recording_is_not_overwritten_unasked(lab, plan):
    trajectory = plan(LWR, 2.0)
    driver = lab.driver(LWR, "--pose", trajectory)
    bag = lab.folder / "out" / LWR / "log.bag"
    bag.write_bytes(b"precious")
    done = lab.move(LWR, trajectory)
    assert done.status == 7
    assert "error[E702]" in done.err
    assert bag.read_bytes() == b"precious"
    assert lab.finish(driver)["commands"] == 0
