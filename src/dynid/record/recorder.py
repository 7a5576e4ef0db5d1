"""What the driver publishes -> log.bag and the paper's text files, in real time, losing nothing.

The subscriber's callback only notes the time and puts the bytes into a queue; one thread writes. The bag is
uncompressed and flushed fifty times a second, so that a killed recorder leaves all but its last messages readable.
"""

from __future__ import annotations

import threading
import time
from collections.abc import Iterable
from dataclasses import dataclass, field, replace
from pathlib import Path
from queue import SimpleQueue
from types import SimpleNamespace
from typing import Any

import numpy as np

from dynid.drivers.joint_state import Columns, Sample
from dynid.drivers.ros import Node, import_ros
from dynid.errors import CannotWrite
from dynid.record import tuning

#: Topic, arrival on the wall clock [ns], bytes, header of the connection, message where it was read.
Queue = SimpleQueue[tuple[str, int, bytes, dict[str, str], Any]]

#: The paper's files and the fields of a joint state they hold.
TEXTS = {"position": "position", "velocity": "velocity", "torque": "effort"}


@dataclass
class Tally:
    """What came in on the topic of the joint states.

    Attributes:
        messages: how many.
        lost: gaps in the publisher's own count.
        first: arrival of the first one, monotonic [s].
        last: arrival of the last one, monotonic [s].
        longest_gap: between arrivals [s].
    """

    messages: int = 0
    lost: int = 0
    first: float = 0.0
    last: float = 0.0
    longest_gap: float = 0.0
    _seq: dict[str, int] = field(default_factory=dict, repr=False)

    @property
    def rate(self) -> float:
        """Mean rate of arrival [Hz]."""
        return (self.messages - 1) / (self.last - self.first) if self.messages > 1 else 0.0

    def add(self, arrival: float, seq: int, publisher: str) -> None:
        """Count a message."""
        self.lost += max(0, seq - self._seq.get(publisher, seq) - 1)
        self._seq[publisher] = seq
        if self.messages:
            self.longest_gap = max(self.longest_gap, arrival - self.last)
        else:
            self.first = arrival
        self.messages, self.last = self.messages + 1, arrival


class Listener:
    """Subscribes to the joint states and remembers the newest; hands everything on to a recorder once there is one.

    Args:
        node: this process in the graph.
        columns: the robot's columns.
        topic: topic of the joint states.
        others: further topics to record.
    """

    def __init__(
        self, node: Node, columns: Columns, topic: str, others: Iterable[str] = ()
    ) -> None:
        self.columns, self.topic = columns, topic
        self.tally = Tally()
        self.names: tuple[str, ...] = ()
        self.latest: Sample | None = None
        self._keep: Queue | None = None
        self._lock = threading.Lock()
        self._state = import_ros("sensor_msgs.msg").JointState
        options = {"queue_size": None, "tcp_nodelay": True, "buff_size": 1 << 20}
        heard = [(topic, self._joint_state), *((other, self._other) for other in others)]
        self._subscribers = [
            node.rospy.Subscriber(name, node.rospy.AnyMsg, callback, name, **options)
            for name, callback in heard
        ]

    def begin(self, queue: Queue) -> None:
        """Put everything from now on into a queue, and count it."""
        with self._lock:
            self.tally, self._keep = Tally(), queue

    def end(self) -> Tally:
        """Keep nothing from now on, and return the count of what was kept."""
        with self._lock:
            self._keep = None
            return replace(self.tally)

    def close(self) -> None:
        """Stop listening."""
        for subscriber in self._subscribers:
            subscriber.unregister()

    def _joint_state(self, raw: Any, topic: str) -> None:  # noqa: ANN401
        wall, arrival = time.time_ns(), time.monotonic()
        message = self._state()
        message.deserialize(raw._buff)
        sample = self.columns.sample(message, arrival)
        if sample is None and self.names:
            return
        self.names = tuple(message.name)
        with self._lock:
            if sample is not None:
                self.latest, publisher = sample, raw._connection_header.get("callerid", "")
                self.tally.add(arrival, message.header.seq, publisher)
            if self._keep is not None:
                self._keep.put((topic, wall, raw._buff, raw._connection_header, message))

    def _other(self, raw: Any, topic: str) -> None:  # noqa: ANN401
        with self._lock:
            if self._keep is not None:
                self._keep.put((topic, time.time_ns(), raw._buff, raw._connection_header, None))


class LogRecorder:
    """Writes what a listener hears, and the commands that are sent.

    Args:
        listener: where messages come from.
        folder: where ``log.bag`` and the folder ``log`` of text files go.
    """

    def __init__(self, listener: Listener, folder: Path) -> None:
        self.listener = listener
        self.bag_path, self.text_folder = folder / "log.bag", folder / "log"
        self.failure: CannotWrite | None = None
        self.written = 0
        self._queue: Queue = SimpleQueue()
        self._end = threading.Event()
        self._first_stamp: int | None = None
        self._thread = threading.Thread(target=self._write_all, name="recorder", daemon=True)

    def start(self) -> None:
        """Open the files and begin.

        Raises:
            CannotWrite: they cannot be opened.
        """
        try:
            self.text_folder.mkdir(parents=True, exist_ok=True)
            self._file = self.bag_path.open("w+b")
            self._texts = {
                name: (self.text_folder / f"{name}.txt").open("w") for name in (*TEXTS, "time")
            }
            for name in TEXTS:
                self._texts[name].write(" ".join(self.listener.columns.names) + "\n")
            self._texts["time"].write("t\n")
            self._bag = import_ros("rosbag").Bag(self._file, "w")
        except OSError as error:
            text = f"cannot write {self.bag_path}: {error.strerror}"
            raise CannotWrite(text, where=self.bag_path) from error
        self._time = import_ros("genpy").Time
        self.listener.begin(self._queue)
        self._thread.start()

    def command(self, topic: str, message: Any) -> None:  # noqa: ANN401
        """Keep a command that was sent."""
        self._queue.put((topic, time.time_ns(), b"", {}, message))

    def close(self) -> Tally:
        """Write the rest, close the files, and return what came in; what is on the disk stays whatever happens."""
        tally = self.listener.end()
        self._end.set()
        self._thread.join(10.0)
        # Why the file twice: a close that could not write what was left closes it the second time.
        for each in (self._bag, self._file, *self._texts.values(), self._file):
            try:
                each.close()
            except OSError as error:
                self.failure = self.failure or self._unwritten(error)
        return tally

    def _unwritten(self, error: OSError) -> CannotWrite:
        return CannotWrite(
            f"cannot write {self.bag_path}: {error.strerror}; {self.written} messages are in it",
            where=self.bag_path,
            fix="make room, or record elsewhere with --out",
        )

    def _write_all(self) -> None:
        while not (self._end.is_set() and self._queue.empty()):
            self._end.wait(tuning.WRITER_PERIOD_S)
            try:
                self._drain()
            except OSError as error:
                self.failure = self._unwritten(error)
                return

    def _drain(self) -> None:
        while not self._queue.empty():
            topic, wall, raw, header, message = self._queue.get()
            content = _raw(raw, header) if raw else message
            self._bag.write(topic, content, self._time(*divmod(wall, 10**9)), raw=bool(raw))
            if raw and message is not None:
                self._write_texts(message)
                self.written += 1
        for stream in (self._file, *self._texts.values()):
            stream.flush()

    def _write_texts(self, message: Any) -> None:  # noqa: ANN401
        """Write one row of each file: the robot's joints in chain order, the driver's numbers as they are."""
        where = self.listener.columns.indices(message.name) or []
        stamp = message.header.stamp.secs * 10**9 + message.header.stamp.nsecs
        self._first_stamp = stamp if self._first_stamp is None else self._first_stamp
        self._texts["time"].write(f"{(stamp - self._first_stamp) / 1e9:.9f}\n")
        for name, key in TEXTS.items():
            values = getattr(message, key) or [np.nan] * len(message.name)
            self._texts[name].write(" ".join(repr(float(values[i])) for i in where) + "\n")


def _raw(raw: bytes, header: dict[str, str]) -> tuple[str, bytes, str, Any]:
    """Return a message as rosbag takes it unread: with type, checksum and definition from the connection."""
    kind = SimpleNamespace(
        _md5sum=header["md5sum"], _full_text=header.get("message_definition", "")
    )
    return header["type"], raw, header["md5sum"], kind
