"""Time and memory of reading recordings: dynid's own containers against those of rosbags and mcap.

    python benchmarks/read_bag.py [SECONDS]

Seven joints at 1 kHz as ``long_logs.py`` makes them. The libraries only yield raw messages, 4096 at a time, which the
same decoders of dynid turn into columns; then what is cut, damaged or larger than it looks is given to all of them.
"""

from __future__ import annotations

import os
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from itertools import islice
from pathlib import Path

ROOT = Path(__file__).parents[1]
sys.path[:0] = [str(ROOT / "src"), str(ROOT / "tests" / "attack")]
STATE, TOPIC = "sensor_msgs/JointState", "/lwr/joint_states"
WAYS = {
    "log.bag": ("dynid", "rosbags"),
    "log.db3": ("dynid", "rosbags"),
    "log.mcap": ("dynid", "rosbags", "mcap"),
    "cut.bag": ("dynid", "rosbags"),
    "cut.mcap": ("dynid", "rosbags", "mcap"),
    "bomb.mcap": ("dynid", "rosbags", "mcap"),
    "pages.db3": ("dynid", "rosbags"),
}
#: A reader that takes longer is stopped [s].
PATIENCE = 120


def make(folder: Path, seconds: float) -> None:
    """Write the recordings, a half of two of them, and two that hold more than they look like."""
    from containers import pages_without_end
    from mcap.writer import CompressionType, Writer

    import long_logs

    robot = long_logs.load_robot(long_logs.ROBOT)
    for kind in ("bag", "db3", "mcap"):
        long_logs.WRITERS[kind](folder / f"log.{kind}", robot, seconds)
    for kind in ("bag", "mcap"):
        with (folder / f"log.{kind}").open("rb") as stream:
            (folder / f"cut.{kind}").write_bytes(stream.read(20 << 20))
    with (folder / "bomb.mcap").open("wb") as stream:
        writer = Writer(stream, compression=CompressionType.LZ4)
        writer.start("ros2", "x")
        schema = writer.register_schema("sensor_msgs/msg/JointState", "ros2msg", b"")
        channel = writer.register_channel(TOPIC, "cdr", schema)
        for k in range(3):
            writer.add_message(channel, k, bytes(1500 << 20), k)
        writer.finish()
    pages_without_end(folder / "pages.db3")


def messages(way: str, path: Path) -> Iterator[tuple[str, int, bytes]]:
    """Yield encoding, time of arrival and bytes of each message, as a library reads them."""
    if way == "mcap":
        from mcap.reader import make_reader

        with path.open("rb") as stream:
            for _, channel, message in make_reader(stream).iter_messages():
                yield channel.message_encoding, message.log_time, message.data
        return
    if path.suffix == ".bag":
        from rosbags.rosbag1 import Reader
    else:
        from rosbags.rosbag2 import Reader
    with Reader(path) as reader:
        for _, arrival, raw in reader.messages():
            yield "ros1" if path.suffix == ".bag" else "cdr", arrival, raw


def read(way: str, path: Path) -> int:
    """Return the number of samples."""
    import numpy as np

    from dynid.files import logs
    from dynid.files.messages import CHECKSUMS, Collector, Connection

    if way == "dynid":
        found, _ = logs.container_of(logs.format_of(path)).read_topics(path, [TOPIC])
        return sum(len(log) for some in found.values() for log in some)
    every, collector = messages(way, path), None
    while block := list(islice(every, 4096)):
        connection = Connection(TOPIC, STATE, "", CHECKSUMS[STATE], block[0][0])
        collector = collector or Collector(connection)
        table = np.frombuffer(b"".join(raw for _, _, raw in block), np.uint8).reshape(
            len(block), -1
        )
        collector.add(np.array([arrival for _, arrival, _ in block]), table)
    return sum(map(len, collector.logs())) if collector else 0


def main() -> None:
    seconds = float(sys.argv[1]) if len(sys.argv) == 2 else 3600.0
    if len(sys.argv) == 4:
        make(Path(sys.argv[3]), float(sys.argv[2]))
    elif len(sys.argv) == 3:
        start = time.process_time()
        try:
            text = f"{read(sys.argv[1], Path(sys.argv[2]))} samples"
        except Exception as error:  # noqa: BLE001
            text = f"{type(error).__name__}: {str(error)[:60]}"
        took = time.process_time() - start
        print(
            f"{took:.1f} s, {resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024:.0f} MB, {text}"
        )
    else:
        with tempfile.TemporaryDirectory() as folder:
            # Why children: each has a peak of memory of its own.
            call, quiet = [sys.executable, __file__], {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
            subprocess.run([*call, "make", str(seconds), folder], check=True)
            for name, ways in WAYS.items():
                size = (Path(folder) / name).stat().st_size / 1e6
                for way in ways:
                    try:
                        found = subprocess.run(
                            [*call, way, f"{folder}/{name}"],
                            capture_output=True,
                            text=True,
                            timeout=PATIENCE,
                            env=quiet,
                        ).stdout.strip()
                    except subprocess.TimeoutExpired:
                        found = f"stopped after {PATIENCE} s"
                    print(f"| {name}, {size:.1f} MB | {way} | {found or 'killed'} |", flush=True)


if __name__ == "__main__":
    main()
