"""``dynid sim-driver`` that notes every command, and goes wrong on purpose: ``ROBOT ... [--fault KIND[@S]]``.

S is the time from the first command [s]. What came, and how much of the arm's limits it used, joins the JSON answer.
"""

import os
import sys

import numpy as np

from dynid.cli.main import main
from dynid.drivers.follow_joint_trajectory import ABORTED
from dynid.sim import ros_drivers
from dynid.sim.driver_loop import DriverLoop
from dynid.sim.follow import PointFollower, VelocityFollower

#: Time between two commands that the driver expects [s].
PERIOD = 0.01


class Watch:
    """The fault, and the commands in DH quantities."""

    fault, begin, loop, first = "", 0.0, None, None
    velocities, accelerations = [], []

    def command(self, qd, qdd):
        if self.first is None:
            self.first = self.loop.now
        self.velocities.append(qd)
        self.accelerations.append(qdd)

    def has(self, fault):
        """Return whether a fault has begun."""
        begun = self.first is not None and self.loop.now - self.first >= self.begin
        return self.fault == fault and begun

    def facts(self, robot):
        """Return how many commands came, and how much of each limit they used."""
        found = {"commands": len(self.velocities), "violations": []}
        for name, rows in (("velocity", self.velocities), ("acceleration", self.accelerations)):
            limits = np.array([getattr(joint.limits, name) or np.inf for joint in robot.joints])
            shares = np.abs(rows or np.zeros((1, robot.n))).max(axis=0) / limits
            found[f"{name}_share"] = shares.max()
            found["violations"] += [
                f"{joint}: {name} at {100 * share:.0f} % of its limit"
                for joint, share in zip(robot.joint_names, shares, strict=True)
                if share > 1
            ]
        return found


WATCH = Watch()


def wraps(kind, name):
    """Put a function in the place of a method, which is its first argument."""

    def put(function):
        method = getattr(kind, name)
        setattr(kind, name, lambda *args: function(method, *args))
        return function

    return put


@wraps(DriverLoop, "facts")
def facts(method, loop):
    return {**method(loop), **WATCH.facts(loop.robot)}


# ---------------------------------------------------------------- commands
@wraps(VelocityFollower, "push")
def velocity(method, follower, speed):
    before = WATCH.velocities[-1] if WATCH.velocities else np.zeros_like(speed)
    WATCH.command(speed, (speed - before) / PERIOD)
    if not WATCH.has("deaf"):
        method(follower, speed)


@wraps(PointFollower, "push")
def point(method, follower, command):
    if not WATCH.has("deaf"):
        method(follower, command)


@wraps(ros_drivers.SimulatedController, "points")
def points(method, driver, trajectory):
    names, columns = trajectory.joint_names, driver.columns
    where = [names.index(name) for name in columns.names]
    for each in trajectory.points:
        speeds = (np.array(values)[where] for values in (each.velocities, each.accelerations))
        WATCH.command(*(columns.velocities_dh(values) for values in speeds))
    return method(driver, trajectory)


# ---------------------------------------------------------------- what is measured
@wraps(DriverLoop, "run")
def run(method, loop, publish, alive):
    WATCH.loop = loop

    def spoilt(measured):
        if WATCH.has("dies"):
            os._exit(1)
        if WATCH.fault == "gravity-free":
            still = np.zeros_like(measured.q)
            measured.tau = measured.tau - loop.arm.inverse_dynamics(measured.q, still, still)
        if WATCH.has("torque"):
            measured.tau[1] = 0.95 * (loop.robot.joints[1].limits.torque or 100.0)
        if not WATCH.has("silent"):
            publish(measured)

    method(loop, spoilt, alive)


@wraps(ros_drivers.SimulatedActionServer, "_look")
def look(method, driver):
    if WATCH.has("deaf"):
        driver.follower.hold()
    elif WATCH.has("gives-up"):
        driver.follower.hold()
        driver._end(ABORTED, "a joint left its path tolerance")
    else:
        method(driver)


# ---------------------------------------------------------------- stops
@wraps(ros_drivers.SimulatedKinova, "_serve")
def service(method, driver, kind, *rest):
    if kind == "Stop" and WATCH.has("stop-fails"):
        raise driver.node.rospy.ServiceException("no connection to the arm")
    return method(driver, kind, *rest)


@wraps(ros_drivers.SimulatedLwr, "_stop")
@wraps(ros_drivers.SimulatedActionServer, "_cancel")
def stop(method, driver, message):
    if not WATCH.has("stop-fails"):
        method(driver, message)


@wraps(ros_drivers.SimulatedDriver, "subscribe")
def subscribe(method, driver, topic, kind, callback):
    if not (WATCH.fault == "no-stop" and topic.endswith(("/emergency_stop", "/cancel"))):
        method(driver, topic, kind, callback)


@wraps(ros_drivers.SimulatedKinova, "__init__")
def kinova(method, driver, node, loop, topic):
    service = node.rospy.Service
    if WATCH.fault == "no-stop":
        node.rospy.Service = lambda name, *args: name.endswith("/stop") or service(name, *args)
    method(driver, node, loop, topic)
    gravity = f"{driver.namespace}/torque_parameters/publish_torque_with_gravity_compensation"
    node.rospy.set_param(gravity, WATCH.fault == "gravity-free")


if __name__ == "__main__":
    if "--fault" in sys.argv:
        k = sys.argv.index("--fault")
        WATCH.fault, _, seconds = sys.argv[k + 1].partition("@")
        WATCH.begin = float(seconds or 0)
        del sys.argv[k : k + 2]
    sys.argv[1] = "sim-driver"
    main()
