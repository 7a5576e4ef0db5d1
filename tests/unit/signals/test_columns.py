"""Columns become DH quantities by name, unit, sign, offset and coupling."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid import Log, Robot
from dynid.diagnose.diagnosis import driver_columns
from dynid.errors import LogLayout
from dynid.files.logs import read_log
from dynid.robot import Coupling, DriverSpec, Joint, JointMap, Limits, TorqueSource
from dynid.signals.checks import prepare
from dynid.signals.columns import in_si, robot_columns, take_samples, to_dh
from makelogs import gen2, gen2_log, lwr, lwr_log

TWO = Robot(
    "two", "standard", (Joint("a"), Joint("b", type="prismatic", limits=Limits((0.0, 0.3))))
)


def raw(n=2, **more):
    t = np.arange(5) / 100
    values = np.arange(5.0 * n).reshape(5, n)
    return Log(t, values, 10 * values, qd=3 * values, **more)


def converted(log, robot):
    return to_dh(in_si(robot_columns(log, robot), robot), robot)


def driver(**more):
    common = {"kind": "generic", "topic": None, "joint_names": ()}
    return DriverSpec(**common, **{"map": JointMap((1.0, 1.0), (0.0, 0.0)), **more})


def test_columns_are_taken_by_name_whatever_their_order():
    shuffled = [6, 0, 3, 2, 5, 1, 4]
    log = lwr_log()
    columns = {key: x[:, shuffled] for key, x in log.columns.items()}
    mixed = log.with_columns(columns, names=tuple(log.names[i] for i in shuffled))
    one, two = prepare(log, lwr()), prepare(mixed, lwr())
    assert_array_equal(one.q, two.q)
    assert_array_equal(one.tau, two.tau)


@pytest.mark.parametrize(
    ("changes", "scale", "offset"),
    [
        (
            {"driver": driver(map=JointMap((-1.0, 1.0), (0.5, 0.1)))},
            ([-1, 1], [-1, 1], [-1, 1]),
            [0.5, 0.1],
        ),
        (
            {"driver": driver(units={"position": "deg", "velocity": "deg/s", "effort": "mNm"})},
            ([np.pi / 180, 1], [np.pi / 180, 1], 1e-3),
            0.0,
        ),
        ({"torque": TorqueSource("motor_current", (2.0, 3.0))}, (1, 1, [2, 3]), 0.0),
    ],
)
def test_columns_are_converted_as_the_robot_file_says(changes, scale, offset):
    """Sign and offset; units, which leave the sliding joint alone; gains of currents."""
    log = raw(tau_unit="A" if "torque" in changes else "Nm")
    dh = converted(log, replace(TWO, **changes))
    assert_allclose(dh.q, log.q * scale[0] + offset)
    assert_allclose(dh.qd, log.qd * scale[1])
    assert_allclose(dh.tau, log.tau * scale[2])
    assert dh.tau_unit == "Nm"


def test_currents_without_gains_stay_currents():
    dh = converted(raw(), replace(TWO, torque=TorqueSource("motor_current", (2.0, None))))
    assert dh.tau_unit == "A"
    assert_array_equal(dh.tau, raw().tau)


def test_coupling_keeps_the_power():
    matrix = ((50.0, 0.0), (20.0, -80.0))
    robot = replace(TWO, coupling=Coupling(matrix))
    log = raw()
    dh = converted(log, robot)
    # Virtual work: what the motors do is what the joints do.
    assert_allclose(np.sum(dh.tau * dh.qd, axis=1), np.sum(log.tau * log.qd, axis=1))
    assert_allclose(dh.q @ np.array(matrix).T, log.q, atol=1e-12)


def test_motor_columns_without_gear_ratios_are_refused():
    with pytest.raises(LogLayout, match="no gear ratios"):
        converted(raw(motor_side=True), TWO)


def test_a_converted_log_is_not_converted_twice(tmp_path):
    robot = replace(gen2(), driver=replace(gen2().driver, map=JointMap((-1.0,) * 7, (0.3,) * 7)))
    once = prepare(
        gen2_log(), replace(robot, prior=None, torque=TorqueSource("gravity_free")), identify=False
    )
    once.save(tmp_path / "log.npz")
    free = replace(robot, torque=TorqueSource("gravity_free"))
    twice = prepare(read_log(tmp_path / "log.npz", robot=robot), free, identify=False)
    assert_array_equal(once.q, twice.q)
    assert_array_equal(once.tau, twice.tau)
    assert twice.names == robot.joint_names


@pytest.mark.parametrize("samples", [7, 500])
def test_a_checked_log_may_be_cut_by_hand(samples):
    """Also where it has as many samples as joints."""
    robot = gen2()
    log = prepare(gen2_log(), robot)
    inside = np.arange(len(log)) < samples
    extra = {key: x[inside] if isinstance(x, np.ndarray) else x for key, x in log.extra.items()}
    cut = replace(log, t=log.t[inside], q=log.q[inside], tau=log.tau[inside], qd=None, extra=extra)
    whole, names = driver_columns(log, robot)
    found, same = driver_columns(take_samples(cut, np.arange(3)), robot)
    assert (len(names), same) == (robot.n, names)
    assert_array_equal(found.q, whole.q[:3])
    with pytest.raises(LogLayout, match=r"array '(clipped|qd_reported)' is \(3000, 7\)"):
        replace(cut, extra=log.extra)
