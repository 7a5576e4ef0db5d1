"""Raw messages of ROS -> logs.

Only the layouts below are decoded, by rosbags: the definition that a recording carries is never interpreted.
"""

from __future__ import annotations

import hashlib
from dataclasses import dataclass
from typing import Any

import numpy as np

from dynid.arrays import Floats
from dynid.drivers.interface import JOINT_STATE
from dynid.errors import WrongMessageType
from dynid.files import tuning
from dynid.log import Log

FIELDS = ("position", "velocity", "effort")
MULTI_ARRAY = "std_msgs/Float64MultiArray"
KINOVA_TYPES = ("kinova_msgs/JointAngles", "kinova_msgs/JointTorque", "kinova_msgs/JointVelocity")
_SEVEN = [f"joint{i}" for i in range(1, 8)]
_SEVEN_FLOATS = "\n".join(f"float32 {name}" for name in _SEVEN)
#: Checksums of the definitions in ROS 1 that can be decoded.
CHECKSUMS = {
    JOINT_STATE: "3066dcd76a6cfaef579bd0f34173e9fd",
    MULTI_ARRAY: "4b7d974086d4060e7db4613a7e6c3ba4",
    **dict.fromkeys(
        KINOVA_TYPES, hashlib.md5(_SEVEN_FLOATS.encode(), usedforsecurity=False).hexdigest()
    ),
}
#: What a frame of zstd begins with.
_ZSTD = b"\x28\xb5\x2f\xfd"
#: Time of arrival and stamp [ns], 0 where a message has none; numbers of each of ``FIELDS``, (3, n), NaN where none.
Row = tuple[int, int, Floats]


class Broken(Exception):
    """A recording or a message is cut, or has damaged bytes; says what was met."""


@dataclass(frozen=True)
class Topic:
    """One topic of a recording.

    Attributes:
        name: topic name.
        type: message type as ROS 1 writes it, such as ``"sensor_msgs/JointState"``.
        cdr: whether messages are written as in ROS 2.
        md5: checksum of the definition in ROS 1.
        count: number of messages, where they were counted.
    """

    name: str
    type: str
    cdr: bool = False
    md5: str = ""
    count: int = 0

    def __str__(self) -> str:
        """Return it as the messages show it."""
        return f"{self.name} ({self.type.split('/')[-1]}, {self.count})"


class Collector:
    """Takes the messages of one topic, keeps their numbers.

    Attributes:
        reason: what was wrong with a message that was passed over, "" where none was.

    Raises:
        WrongMessageType: the layout is not known.
    """

    def __init__(self, topic: Topic) -> None:
        if topic.type not in CHECKSUMS or (topic.cdr and topic.type in KINOVA_TYPES):
            raise WrongMessageType(
                f"{topic.name} has messages of the type {topic.type}", where=topic.name
            )
        if not topic.cdr and topic.md5 != CHECKSUMS[topic.type]:
            raise WrongMessageType(
                f"the {topic.type} of {topic.name} differs from the standard definition (md5 {topic.md5[:40]})",
                where=topic.name,
                why="dynid decodes the standard layout only",
                fix="record with the standard definition of this message",
            )
        from rosbags.typesys import Stores, get_types_from_msg, get_typestore

        self.reason = ""
        self._topic = topic
        self._type = topic.type.replace("/", "/msg/")
        store = get_typestore(Stores.LATEST if topic.cdr else Stores.ROS1_NOETIC)
        if topic.type in KINOVA_TYPES:
            store.register(get_types_from_msg(_SEVEN_FLOATS, self._type))
        self._decode: Any = store.deserialize_cdr if topic.cdr else store.deserialize_ros1
        # By the joints that messages carry: names in the order of the first message, rows, fields with numbers.
        self._groups: dict[tuple[str, ...] | int, tuple[tuple[str, ...], list[Row], set[str]]] = {}

    def add(self, arrival: int, raw: bytes) -> None:
        """Take a message and its time of arrival [ns]."""
        if self._topic.cdr and raw[:4] == _ZSTD:
            raise WrongMessageType(
                "every message of the recording is compressed (zstd)",
                why="dynid reads messages as they were sent, and MCAP whose chunks are compressed",
                fix="ros2 bag convert without compression_mode, or record without --compression-mode message",
            )
        try:
            message = self._decode(raw, self._type)
        # Why all: of damaged bytes rosbags raises whatever it meets.
        except Exception as error:  # noqa: BLE001
            self.reason = f"a message is damaged: {str(error) or type(error).__name__}"
            return
        names: tuple[str, ...] = ()
        stamp = 0
        if self._topic.type == JOINT_STATE:
            names, time = tuple(message.name), message.header.stamp
            stamp = time.sec * 10**9 + time.nanosec
            fields = [message.position, message.velocity, message.effort]
        else:
            # Numbers alone: positions or torques, as whoever asks for their topic knows. Kinova's are all "angles".
            array = self._topic.type == MULTI_ARRAY
            numbers = message.data if array else np.array([getattr(message, x) for x in _SEVEN])
            fields = [numbers, np.zeros(0), numbers]
        width = len(names) or max(map(len, fields))
        first, rows, filled = self._groups.setdefault(
            tuple(sorted(names)) or width, (names, [], set())
        )
        order = [names.index(name) for name in first] or slice(None)
        # Why: a short field cannot be assigned to joints; NaN lets the checks name the samples.
        row = np.full((len(FIELDS), width), np.nan)
        for k, field in enumerate(fields):
            if len(field):
                filled.add(FIELDS[k])
            if len(field) == width:
                row[k] = field[order]
        rows.append((arrival, stamp, row))

    def logs(self) -> list[Log]:
        """Return one raw log for each set of joint names, the largest first: arm and gripper may share a topic."""
        logs = (_log(*group, self._topic.name) for group in self._groups.values())
        return sorted(logs, key=len, reverse=True)


def _log(names: tuple[str, ...], rows: list[Row], filled: set[str], topic: str) -> Log:
    """Return messages, put in the order of arrival, as a raw log.

    ``extra`` names the ``clock`` of its time and what it counts from, ``start_ns``, the first and last ``arrival_ns``,
    and as ``absent`` the fields that no message has; absent positions and efforts are NaN.
    """
    rows.sort(key=lambda row: row[0])
    arrival, stamp = (np.array([row[k] for row in rows]) for k in (0, 1))
    position, velocity, effort = np.stack([row[2] for row in rows], axis=1)
    # Why: a header stamp is taken where the sample is, so it is preferred; it may run on any epoch (some drivers stamp
    # with the monotonic clock), but must tick. One clock serves the topic: two are never mixed. Zero is where
    # the clock of a converted or simulated log begins; a driver without stamps writes zeros only.
    rising = len(stamp) > 1 and bool(np.all(np.diff(stamp) > 0))
    ticking = rising or len(np.unique(stamp)) >= max(2, tuning.LEAST_DISTINCT * len(stamp))
    stamped = (rising and stamp[0] >= 0) or (ticking and bool(np.all(stamp > 0)))
    ns = stamp if stamped else arrival
    return Log(
        t=(ns - ns[0]) * 1e-9,
        q=position,
        tau=effort,
        names=names,
        qd=velocity if "velocity" in filled else None,
        topic=topic,
        extra={
            "clock": "header" if stamped else "arrival",
            "start_ns": int(ns[0]),
            "arrival_ns": (int(arrival[0]), int(arrival[-1])),
            "absent": tuple(key for key in FIELDS if key not in filled),
        },
    )
