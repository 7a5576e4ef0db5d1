"""Make the logs that ship with dynid: simulated arms in PyBullet, with the truth of ``*_truth.yaml``.

    python trajectories/make_logs.py            all logs, half a minute
    python trajectories/make_logs.py lwr4plus   those of one truth file

The same truth file gives the same logs; every seed is in it and is printed.
"""

import sys
from pathlib import Path

import numpy as np
import yaml

from dynid.files.robotfile import load_robot
from dynid.log import Log
from dynid.robot import Robot
from dynid.sim.arm import track
from dynid.sim.plant import Plant, read_plant
from dynid.sim.sines import SineSpec, sines

HERE = Path(__file__).parent
#: Stamps count from 1 March 2022, 12:00 UTC.
START = 1_646_136_000 * 10**9
TORQUE_SHARE = 0.9
FINGERS = [f"j2s7s300_joint_{part}_{i}" for part in ("finger", "finger_tip") for i in (1, 2, 3)]


def main(wanted: list[str]) -> None:
    """Make the logs of the truth files whose names are given, of all without one."""
    for path in sorted(HERE.glob("*_truth.yaml")):
        if wanted and path.name.removesuffix("_truth.yaml") not in wanted:
            continue
        plant, text = read_plant(path), yaml.safe_load(path.read_text(encoding="utf-8"))
        robot = load_robot(plant.robot)
        for entry in text["logs"]:
            make_log(plant, robot, text["motion"], entry)


def make_log(plant: Plant, robot: Robot, limits: dict[str, float], entry: dict[str, float]) -> None:
    """Simulate one motion and write its bag."""
    rng = np.random.default_rng(entry["seed"])
    arm = plant.arm(robot)
    motion = sines(
        robot,
        SineSpec(duration=entry["duration"], period=entry["period"], **limits),
        arm.dt,
        rng,
    )
    truth = track(arm, motion, every=round(1 / entry["rate"] / arm.dt))
    check_torques(robot, truth.tau)
    log = as_published(robot, plant.sensors.measure(truth, robot.log_names, rng))
    path = HERE / str(entry["file"])
    write_bag(log, path, robot.driver.topic)
    lag = np.degrees(np.abs(truth.q - truth.q_ref).max())
    print(  # noqa: T201
        f"{path.name}: seed {entry['seed']}, {len(log)} samples, {entry['rate']} Hz, "
        f"{path.stat().st_size / 1e6:.2f} MB, largest tracking error {lag:.2f} deg"
    )


def write_bag(log: Log, path: Path, topic: str) -> None:
    """Write a log as a bz2-compressed bag of ROS 1 with sensor_msgs/JointState; equal logs give equal bytes."""
    from rosbags.rosbag1 import Writer
    from rosbags.typesys import Stores, get_typestore

    store, kind = get_typestore(Stores.ROS1_NOETIC), "sensor_msgs/msg/JointState"
    header, time = (
        store.types[name] for name in ("std_msgs/msg/Header", "builtin_interfaces/msg/Time")
    )
    velocity = np.empty((len(log), 0)) if log.qd is None else log.qd
    columns = [np.ascontiguousarray(x) for x in (log.q, velocity, log.tau)]
    path.unlink(missing_ok=True)
    writer = Writer(path)
    writer.set_compression(Writer.CompressionFormat.BZ2)
    with writer:
        channel = writer.add_connection(topic, kind, typestore=store)
        for i, stamp in enumerate((START + np.round(log.t * 1e9).astype(np.int64)).tolist()):
            message = store.types[kind](
                header(i, time(*divmod(stamp, 10**9)), ""),
                list(log.names),
                *(x[i] for x in columns),
            )
            writer.write(channel, stamp, bytes(store.serialize_ros1(message, kind)))


def check_torques(robot: Robot, tau: np.ndarray) -> None:
    """Refuse a motion that asks a drive for more than its share of the rating."""
    for joint, largest in zip(robot.joints, np.abs(tau).max(axis=0), strict=True):
        if largest > TORQUE_SHARE * joint.limits.torque:
            raise SystemExit(
                f"{joint.name} needs {largest:.1f} N m of {joint.limits.torque:g}: choose another seed"
            )


def as_published(robot: Robot, log: Log) -> Log:
    """Return the log as the arm's driver publishes it: FRI sends 32-bit numbers, Kinova lists its fingers too."""
    order = np.argsort(log.names)
    names, q, tau = tuple(np.array(log.names)[order].tolist()), log.q[:, order], log.tau[:, order]
    qd = None if log.qd is None else log.qd[:, order]
    if robot.driver.kind == "kinova_gen2":
        still = np.zeros((len(log), len(FINGERS)))
        names, q, tau, qd = (
            (*names, *FINGERS),
            np.hstack([q, still]),
            np.hstack([tau, still]),
            np.hstack([qd, still]),
        )
    single = [
        None if part is None else part.astype(np.float32).astype(float) for part in (q, tau, qd)
    ]
    return Log(log.t, single[0], single[1], names, single[2])


if __name__ == "__main__":
    main(sys.argv[1:])
