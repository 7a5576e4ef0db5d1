"""Check, identify, validate and search recordings of minutes and hours; print processor time and peak memory.

    python benchmarks/long_logs.py [--seconds 60 600 3600] [--format bag mcap db3 npz] [--commands check identify validate gap]

The arm is the bundled KUKA LWR4+ with positions, velocities and torques of seven joints (305 bytes a message) at 1 kHz, in
.npz files positions and torques at 200 Hz. The motion is a sum of sines with torques of random bodies and noise: it is
here for its length, not for accuracy. The bags are written chunk by chunk with their index, as a recorder writes them.
"""

from __future__ import annotations

import argparse
import os
import sqlite3
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import numpy as np
from rosbags.typesys import Stores, get_typestore

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "tests" / "physics"), str(ROOT / "src")]
from arms import random_bodies  # noqa: E402

from dynid.files.robotfile import load_robot  # noqa: E402
from dynid.log import Log  # noqa: E402
from dynid.model import build_model  # noqa: E402
from dynid.scratch import Growing  # noqa: E402

ROBOT, RATE, START = "kuka_lwr4plus", 1000.0, 1_460_000_000 * 10**9
#: Rate of .npz logs, which are without velocities [Hz].
NPZ_RATE = 200.0
#: Messages of a chunk, and samples that are made at once.
CHUNK, BLOCK = 2000, 50_000


# ---------------------------------------------------------------- the motion
class Motion:
    """Sums of five sines a joint, torques of random bodies, and noise of encoders and torque sensors."""

    def __init__(self, robot):
        random = np.random.default_rng(1)
        model = build_model(robot)
        rigid = np.concatenate(
            [np.append(body.parameters(), 0.1) for body in random_bodies(random, robot.n)]
        )
        self.gamma = np.concatenate([rigid, random.uniform(0.2, 1.0, model.size - len(rigid))])
        self.observer, self.noise = model.observer(), np.random.default_rng(2)
        self.waves = np.random.default_rng(0).uniform(
            [0.05, 0.0, 0.4], [0.8, 2 * np.pi, 1.0], (robot.n, 5, 3)
        )

    def at(self, t):
        """Return measured positions, velocities and torques, (N, n) each."""
        w, phase, a = (2 * np.pi * self.waves[..., 0], self.waves[..., 1], self.waves[..., 2])
        a = a * np.minimum(0.25, 0.5 / w)
        angle = t[:, None, None] * w + phase
        q, qd, qdd = (
            (f(angle) * s).sum(axis=2)
            for f, s in ((np.sin, a), (np.cos, a * w), (np.sin, -a * w**2))
        )
        tau = self.observer.torque(self.gamma, q, qd, qdd)
        return tuple(
            x + size * self.noise.standard_normal(q.shape)
            for x, size in ((q, 2e-6), (qd, 1e-3), (tau, 0.05))
        )


# ---------------------------------------------------------------- the bag
def fields(**values):
    return b"".join(
        struct.pack("<I", len(k) + 1 + len(v)) + k.encode() + b"=" + v for k, v in values.items()
    )


def record(header, data):
    return struct.pack("<I", len(header)) + header + struct.pack("<I", len(data)) + data


def number(value, size="I"):
    return struct.pack(f"<{size}", value)


def message(names):
    """Return a JointState with zeros for its numbers, and where its three arrays begin."""
    content = (
        bytes(16)
        + number(len(names))
        + b"".join(number(len(name)) + name.encode() for name in names)
    )
    places = []
    for _ in range(3):
        content += number(len(names))
        places.append(len(content))
        content += bytes(8 * len(names))
    return content, places


def write_bag(path, robot, seconds):
    motion, names = Motion(robot), robot.log_names
    definition, md5 = get_typestore(Stores.ROS1_NOETIC).generate_msgdef(
        "sensor_msgs/msg/JointState", ros_version=1
    )
    topic = robot.driver.topic.encode()
    facts = fields(
        topic=topic,
        type=b"sensor_msgs/JointState",
        md5sum=md5.encode(),
        message_definition=definition.encode(),
    )
    connection = record(fields(op=b"\x07", conn=number(0), topic=topic), facts)
    content, places = message(names)
    header = fields(op=b"\x02", conn=number(0), time=bytes(8))
    alike = record(header, content)
    time, body, infos = alike.index(b"time=") + 5, 8 + len(header), []

    def bag_header(place):
        said = fields(
            op=b"\x03",
            index_pos=number(place, "Q"),
            conn_count=number(1),
            chunk_count=number(len(infos)),
        )
        return record(said, b" " * (4096 - 8 - len(said)))

    with path.open("wb") as stream:
        stream.write(b"#ROSBAG V2.0\n" + bag_header(0))
        for first in range(0, round(seconds * RATE), BLOCK):
            index = np.arange(first, min(first + BLOCK, round(seconds * RATE)))
            numbers, ns = (
                motion.at(index / RATE),
                START + np.round(index * 1e9 / RATE).astype(np.int64),
            )
            stamps = np.column_stack(np.divmod(ns, 10**9)).astype("<u4")
            for at in range(0, len(index), CHUNK):
                part = slice(at, at + CHUNK)
                some = stamps[part]
                table = np.tile(np.frombuffer(alike, np.uint8), (len(some), 1))
                table[:, time : time + 8] = table[:, body + 4 : body + 12] = some.view(np.uint8)
                for place, x in zip(places, numbers, strict=True):
                    table[:, body + place : body + place + 8 * len(names)] = np.ascontiguousarray(
                        x[part]
                    ).view(np.uint8)
                data, place = (b"" if infos else connection) + table.tobytes(), stream.tell()
                stream.write(
                    record(fields(op=b"\x05", compression=b"none", size=number(len(data))), data)
                )
                offsets = (len(data) - table.size + np.arange(len(some)) * len(alike)).astype("<u4")
                entries = np.column_stack([some, offsets]).astype("<u4").tobytes()
                stream.write(
                    record(
                        fields(op=b"\x04", ver=number(1), conn=number(0), count=number(len(some))),
                        entries,
                    )
                )
                infos.append((place, some[0].tobytes(), some[-1].tobytes(), len(some)))
        end = stream.tell()
        stream.write(connection)
        for place, begin, last, count in infos:
            said = fields(
                op=b"\x06",
                ver=number(1),
                chunk_pos=number(place, "Q"),
                start_time=begin,
                end_time=last,
                count=number(1),
            )
            stream.write(record(said, number(0) + number(count)))
        stream.seek(13)
        stream.write(bag_header(end))


# ---------------------------------------------------------------- ROS 2
def cdr(names):
    """Return a JointState in CDR with zeros for its numbers, and where its stamp and its three arrays begin."""
    store = get_typestore(Stores.ROS2_HUMBLE)
    State, Header, Time = (
        store.types[kind]
        for kind in (
            "sensor_msgs/msg/JointState",
            "std_msgs/msg/Header",
            "builtin_interfaces/msg/Time",
        )
    )
    marks = [np.full(len(names), mark) for mark in (1.0, 2.0, 3.0)]
    content = bytes(
        store.serialize_cdr(State(Header(Time(0, 0), ""), list(names), *marks), State.__msgtype__)
    )
    return content, [content.index(mark.tobytes()) for mark in marks]


def messages(robot, seconds):
    """Yield stamps [ns], (N,), and JointStates in CDR, (N, length)."""
    motion, (content, places) = Motion(robot), cdr(robot.log_names)
    for first in range(0, round(seconds * RATE), BLOCK):
        index = np.arange(first, min(first + BLOCK, round(seconds * RATE)))
        numbers, ns = motion.at(index / RATE), START + np.round(index * 1e9 / RATE).astype(np.int64)
        table = np.tile(np.frombuffer(content, np.uint8), (len(index), 1))
        table[:, 4:12] = np.column_stack(np.divmod(ns, 10**9)).astype("<u4").view(np.uint8)
        for place, x in zip(places, numbers, strict=True):
            table[:, place : place + 8 * robot.n] = np.ascontiguousarray(x).view(np.uint8)
        yield ns, table


def write_db3(path, robot, seconds):
    with sqlite3.connect(path) as base:
        base.execute(
            "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT, type TEXT, serialization_format TEXT, "
            "offered_qos_profiles TEXT)"
        )
        base.execute(
            "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER, timestamp INTEGER, data BLOB)"
        )
        base.execute(
            "INSERT INTO topics VALUES(1, ?, 'sensor_msgs/msg/JointState', 'cdr', '')",
            [robot.driver.topic],
        )
        for ns, table in messages(robot, seconds):
            rows = zip(ns.tolist(), map(bytes, table), strict=True)
            base.executemany(
                "INSERT INTO messages(topic_id, timestamp, data) VALUES(1, ?, ?)", rows
            )


def write_mcap(path, robot, seconds):
    def text(word):
        return number(len(word)) + word.encode()

    def entry(op, data):
        return bytes([op]) + number(len(data), "Q") + data

    definition = get_typestore(Stores.ROS2_HUMBLE).generate_msgdef(
        "sensor_msgs/msg/JointState", ros_version=2
    )[0]
    schema = (
        number(1, "H") + text("sensor_msgs/msg/JointState") + text("ros2msg") + text(definition)
    )
    channel = number(1, "H") + number(1, "H") + text(robot.driver.topic) + text("cdr") + number(0)
    known, infos, count = entry(3, schema) + entry(4, channel), [], 0
    with path.open("wb") as stream:
        stream.write(b"\x89MCAP0\r\n" + entry(1, text("ros2") + text("long_logs")))
        for stamps, contents in messages(robot, seconds):
            for at in range(0, len(stamps), CHUNK):
                ns, table = stamps[at : at + CHUNK], contents[at : at + CHUNK]
                head = np.frombuffer(
                    b"\x05" + number(22 + table.shape[1], "Q") + number(1, "H"), np.uint8
                )
                number_of = (
                    np.arange(count, count + len(ns))
                    .astype("<u4")
                    .view(np.uint8)
                    .reshape(len(ns), 4)
                )
                times = np.column_stack([ns, ns]).astype("<u8").view(np.uint8)
                body = np.hstack([np.tile(head, (len(ns), 1)), number_of, times, table]).tobytes()
                body, place, count = (
                    (b"" if infos else known) + body,
                    stream.tell(),
                    count + len(ns),
                )
                span = number(int(ns[0]), "Q") + number(int(ns[-1]), "Q")
                packed = number(len(body), "Q")
                stream.write(entry(6, span + packed + number(0) + text("") + packed + body))
                offsets = number(10) + number(1, "H") + number(0, "Q")
                infos.append(
                    span
                    + number(place, "Q")
                    + number(stream.tell() - place, "Q")
                    + offsets
                    + number(0, "Q")
                    + text("")
                    + packed
                    + packed
                )
        stream.write(entry(15, number(0)))
        summary, span = stream.tell(), number(START, "Q") + number(START, "Q")
        counts = number(10) + number(1, "H") + number(count, "Q")
        statistics = (
            number(count, "Q")
            + number(1, "H")
            + number(1)
            + number(0)
            + number(0)
            + number(len(infos))
        )
        stream.write(
            known
            + entry(11, statistics + span + counts)
            + b"".join(entry(8, info) for info in infos)
        )
        stream.write(entry(2, number(summary, "Q") + number(0, "Q") + number(0)) + b"\x89MCAP0\r\n")


def write_npz(path, robot, seconds):
    """Write positions and torques alone, at a rate of their own: 5000 s are a million samples."""
    motion, columns = Motion(robot), (Growing(0), Growing(robot.n), Growing(robot.n))
    for first in range(0, round(seconds * NPZ_RATE), BLOCK):
        t = np.arange(first, min(first + BLOCK, round(seconds * NPZ_RATE))) / NPZ_RATE
        q, _, tau = motion.at(t)
        for column, x in zip(columns, (t, q, tau), strict=True):
            column.append(x)
    t, q, tau = (column.whole() for column in columns)
    Log(t=t, q=q, tau=tau, names=robot.joint_names, units={"position": "rad", "effort": "Nm"}).save(
        path
    )


WRITERS = {"bag": write_bag, "mcap": write_mcap, "db3": write_db3, "npz": write_npz}


# ---------------------------------------------------------------- the commands
def measured(folder, *words):
    """Run dynid; return processor time [s] and peak memory [MB]."""
    # Why without: an installed dynid has its byte code, which a source tree may keep from the second run on.
    own = {
        "PYTHONPATH": str(ROOT / "src"),
        "OPENBLAS_NUM_THREADS": "1",
        "PYTHONDONTWRITEBYTECODE": "",
    }
    environment = {**os.environ, **own}
    quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
    child = subprocess.Popen(
        [sys.executable, "-m", "dynid", *words], cwd=folder, env=environment, **quiet
    )
    _, status, usage = os.wait4(child.pid, 0)
    if status:
        raise SystemExit(f"dynid {' '.join(words)} failed")
    return usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024


def main():
    parser = argparse.ArgumentParser()
    parser.add_argument("--seconds", type=int, nargs="+", default=[60, 600, 3600])
    parser.add_argument("--format", nargs="+", choices=WRITERS, default=["bag"])
    parser.add_argument("--commands", nargs="+", default=["check", "identify", "validate", "gap"])
    given, robot = parser.parse_args(), load_robot(ROBOT)
    print("| recording |", " | ".join(given.commands), "|\n|", "--- | " * (1 + len(given.commands)))
    for kind in given.format:
        for seconds in given.seconds:
            with tempfile.TemporaryDirectory() as folder:
                log = Path(folder) / f"log.{kind}"
                WRITERS[kind](log, robot, seconds)
                runs = {
                    "check": (ROBOT, log.name),
                    "identify": (ROBOT, log.name, "-o", "out"),
                    "validate": ("out/parameters.npz", log.name, "--allow-training-data"),
                    "gap": ("out/parameters.npz", log.name, "--no-apply"),
                }
                took = (measured(folder, word, *runs[word]) for word in given.commands)
                cells = [f"{seconds:.1f} s, {memory:.0f} MB" for seconds, memory in took]
                print(
                    f"| {kind}, {seconds} s, {log.stat().st_size / 1e6:.0f} MB | {' | '.join(cells)} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
