"""Time and memory of reading a long bag: rosbags' own decoder, dynid, dynid without the index.

PYTHONPATH=src python benchmarks/read_bag.py [MESSAGES]
"""

from __future__ import annotations

import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

TOPIC = "/joint_states"
WAYS = ("rosbags", "dynid", "dynid, index destroyed")


def make(folder: Path, messages: int) -> None:
    sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
    from rosbags.rosbag1 import Writer

    from makelogs import START, STORE, joint_state

    names = [f"joint_{i}" for i in range(1, 8)]
    with Writer(folder / "log.bag") as writer:
        connection = writer.add_connection(TOPIC, "sensor_msgs/msg/JointState", typestore=STORE)
        for i in range(messages):
            ns = START + i * 10**6
            state = joint_state(ns, names, [0.1 * i] * 7, [0.2] * 7, [0.3] * 7, seq=i)
            writer.write(connection, ns, STORE.serialize_ros1(state, "sensor_msgs/msg/JointState"))
    content = bytearray((folder / "log.bag").read_bytes())
    index = int.from_bytes(content[content.index(b"index_pos=") + 10 :][:8], "little")
    content[index:] = b"\xff" * (len(content) - index)
    (folder / "broken.bag").write_bytes(content)


def read(way: str, folder: Path) -> int:
    if way == "rosbags":
        import numpy as np
        from rosbags.highlevel import AnyReader

        with AnyReader([folder / "log.bag"]) as reader:
            states = (reader.deserialize(raw, connection.msgtype) for connection, _, raw in reader.messages())
            return len(np.array([np.concatenate([s.position, s.velocity, s.effort]) for s in states]))
    from dynid.files.bag import read_topics

    name = "log.bag" if way == "dynid" else "broken.bag"
    return len(read_topics(folder / name, [TOPIC])[0][TOPIC][0])


def main() -> None:
    if len(sys.argv) == 4:
        if sys.argv[2] == "make":
            make(Path(sys.argv[3]), int(sys.argv[1]))
            return
        before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        start = time.perf_counter()
        count = read(sys.argv[2], Path(sys.argv[3]))
        seconds = time.perf_counter() - start
        grown = (resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) / 1024
        speed = f"{seconds:7.2f} s {count / seconds / 1000:7.0f} k/s"
        print(f"{sys.argv[2]:25s} {count:9d} messages {speed} {grown:7.0f} MB more")
        return
    messages = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    with tempfile.TemporaryDirectory() as folder:
        # Why: a child inherits the peak memory of its parent, so the bag is made by a child too.
        for way in ("make", *WAYS):
            subprocess.run([sys.executable, __file__, str(messages), way, folder], check=True)


if __name__ == "__main__":
    main()
