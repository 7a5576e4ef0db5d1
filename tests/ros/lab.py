"""Processes of the tests with ROS: a master, simulated drivers, recordings; and small motions for them."""

import json
import os
import signal
import socket
import subprocess
import time
from pathlib import Path

import numpy as np
import yaml

from dynid import load_robot
from dynid.files.logs import read_log
from dynid.files.trajectoryfile import Review, StoredTrajectory, motion_hash, write_trajectory
from motions import there_and_back
from runner import Ended, Runner, split

#: A process that has not ended by then hangs [s].
LIMIT = 90
KINOVA, LWR, UR = "kinova_gen2", "kuka_lwr4plus", "ur10"
#: The controller of the third arm, and where motions go when they are sent as one goal.
CONTROLLER = "/joint_trajectory_controller"
ACTION = f"{CONTROLLER}/follow_joint_trajectory"


class Child:
    """A dynid process; what it says is read when it has ended."""

    def __init__(self, lab, words, stdin=None):
        self.said, self.log = (
            lab.folder / f"{name}-{time.monotonic_ns()}.txt" for name in ("stdout", "stderr")
        )
        with (
            self.said.open("w") as out,
            self.log.open("w") as err,
            Path(os.devnull).open() as nothing,
        ):
            streams = [each.fileno() for each in (stdin or nothing, out, err)]
            self.process = lab.forked(words, streams, {})

    def running(self):
        return not self.process.ended()

    def wait_for(self, text):
        end = time.monotonic() + LIMIT
        while text not in self.log.read_text():
            assert self.running(), f"ended before it said '{text}':\n{self.log.read_text()}"
            assert time.monotonic() < end, f"never said '{text}':\n{self.log.read_text()}"
            time.sleep(0.02)

    def send(self, number):
        if self.running():
            os.kill(self.process.pid, number)

    def end(self):
        return Ended(self.process.wait(LIMIT), self.said.read_text(), self.log.read_text())


class Lab(Runner):
    """One folder, one master, any number of processes."""

    ros = True

    def __init__(self, folder, uri):
        super().__init__(folder, folder / "home")
        self.children = []
        self.env |= {"ROS_MASTER_URI": uri, "OMP_NUM_THREADS": "1", "TERM": ""}

    def begin(self, *words, **options):
        """Start a process; text is a line as a person types it."""
        line = [part for each in words for part in (split(each) if each is str(each) else [each])]
        self.children.append(Child(self, line, **options))
        return self.children[-1]

    def driver(self, robot, *words):
        """Start a simulated driver and wait until it publishes."""
        child = self.begin(f"watched-driver {robot} --json", *words)
        child.wait_for("stop ")
        return child

    def plan(self, robot, seconds=3.0, name="", **options):
        """Write a trajectory that was reviewed."""
        return store(
            self.folder / (name or f"{robot}.npz"), robot, swing(robot, seconds), **options
        )

    def ready(self, robot, seconds=3.0, fault="", *words):
        """Return a driver, which may have a fault, with its arm at the begin of a trajectory, and the trajectory."""
        path = self.plan(robot, seconds)
        return self.driver(robot, "--pose", path, f"--fault {fault}" if fault else "", *words), path

    def record(self, robot, *words, **options):
        return self.begin(f"record {robot}", *words, **options).end()

    def move(self, robot, trajectory, *words):
        return self.record(robot, trajectory, f"--move {robot}", *words)

    def moving(self, robot, trajectory, *words, **options):
        """Start a recording and wait until the arm moves."""
        child = self.begin(f"record {robot} --move {robot}", trajectory, *words, **options)
        child.wait_for("stops the arm")
        time.sleep(1.0)
        return child

    def log(self, robot):
        return read_log(self.folder / "out" / robot / "log.bag", robot=load_robot(robot))

    def manifest(self, robot):
        return yaml.safe_load((self.folder / "out" / robot / "manifest.yaml").read_text())

    def finish(self, driver):
        """End a simulated driver and return what it was sent."""
        driver.send(signal.SIGINT)
        ended = driver.end()
        assert ended.out, ended.err
        return json.loads(ended.out)

    def close(self):
        for child in self.children:
            if child.running():
                child.send(signal.SIGKILL)
                child.end()


def start_master(folder):
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    env = {**os.environ, "ROS_IP": "127.0.0.1", "ROS_LOG_DIR": str(folder), "ROS_HOME": str(folder)}
    env.pop("PYTHONPATH", None)
    process = subprocess.Popen(
        ["rosmaster", "--core", "-p", str(port)],
        env=env,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    end = time.monotonic() + 20
    while True:
        try:
            socket.create_connection(("127.0.0.1", port), timeout=1).close()
            return process, f"http://127.0.0.1:{port}"
        except OSError:
            assert time.monotonic() < end, "the master did not start"
            assert process.poll() is None, "the master ended"
            time.sleep(0.05)


#: Poses about which the arms may swing: joints bent, nothing near the floor or another link.
MIDDLE = {
    KINOVA: np.array([0.0, 2.6, 0.0, 2.2, 0.0, 3.6, 0.0]),
    LWR: np.array([0.0, 0.5, 0.0, 0.9, 0.0, -0.7, 0.0]),
    UR: np.array([0.0, -1.2, 1.2, 0.3, 0.5, 0.0]),
}


def swing(robot, seconds, size=0.15):
    """One slow swing of all joints, from rest to rest."""
    t, far = np.arange(round(seconds * 100) + 1) / 100, np.arange(1, len(MIDDLE[robot]) + 1)
    return there_and_back(t, size * np.sqrt(far), MIDDLE[robot])


def store(path, robot, motion, reviewed=True):
    arm = load_robot(robot)
    review = Review("a person", "2026-01-01T12:00:00", motion_hash(motion)) if reviewed else None
    plan = np.zeros((1, len(arm.joint_names)))
    write_trajectory(
        path, StoredTrajectory(arm.name, arm.joint_names, motion, 1.0, {}, plan, review)
    )
    return path
