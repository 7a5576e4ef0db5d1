"""The one place that imports ROS 1: found in apt's or Noetic's folder, reached only after its master has answered.

rospy waits without end for a master that is not there, so a socket knocks first; every later wait has a limit too.
"""

from __future__ import annotations

import atexit
import importlib
import importlib.machinery
import os
import shutil
import sys
import threading
from collections.abc import Callable
from concurrent.futures import Future, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar
from urllib.parse import urlsplit

from dynid.errors import MasterSilent, RosMissing
from dynid.xdg import cache_folder

T = TypeVar("T")

#: Address of the master by default.
DEFAULT_MASTER = "http://localhost:11311"
#: A master in the same laboratory answers in milliseconds; longer means there is none [s].
PATIENCE = 2.0
#: Where Ubuntu 20.04's Noetic and Debian 12's own packages put their Python modules.
FOLDERS = ("/opt/ros/noetic/lib/python3/dist-packages", "/usr/lib/python3/dist-packages")
#: What ``dynid record`` imports.
MODULES = (
    "rospy",
    "rosgraph",
    "rosbag",
    "genpy",
    "genmsg",
    "sensor_msgs",
    "std_msgs",
    "trajectory_msgs",
)
#: The line that installs all of it on Debian 12.
APT = (
    "apt-get install -y --no-install-recommends python3-rospy python3-rosbag python3-rosmaster python3-roslaunch "
    "python3-sensor-msgs python3-trajectory-msgs python3-std-msgs"
)
#: Lowest real-time priority: before all usual programs, after those that the system itself runs in real time.
REAL_TIME = 1
#: Niceness where real time is not allowed.
NICENESS = -10


def ros_folders() -> list[str]:
    """Return the folders that may hold rospy, DYNID_ROS_PATH first."""
    own = os.environ.get("DYNID_ROS_PATH", "")
    return [
        folder for folder in (*own.split(os.pathsep), *FOLDERS) if folder and Path(folder).is_dir()
    ]


def missing_modules() -> list[str]:
    """Return which of the needed ROS modules cannot be found, without importing any of them."""
    places = [*sys.path, *ros_folders()]
    finder = importlib.machinery.PathFinder
    return [name for name in MODULES if finder.find_spec(name, places) is None]


def master_uri(given: str | None = None) -> str:
    """Return the address of the master: the given one, ROS_MASTER_URI, or the usual one."""
    return given or os.environ.get("ROS_MASTER_URI") or DEFAULT_MASTER


def import_ros(name: str) -> Any:  # noqa: ANN401 - ROS has no types
    """Import a module of ROS.

    Why: the folders go to the *end* of the search path. In front (or in PYTHONPATH) the system's numpy would hide the
    one that dynid was installed with.

    Raises:
        RosMissing: it is not installed.
    """
    sys.path.extend(folder for folder in ros_folders() if folder not in sys.path)
    try:
        return importlib.import_module(name)
    except ImportError as error:
        raise RosMissing(f"{name} cannot be imported: {error}", fix=APT) from error


def message_classes(kind: str, definition: str) -> dict[str, Any]:
    """Return the classes that a message definition of dynid makes, by the names of their types.

    Why not by genpy alone: it removes its temporary folder when Python ends, which an interrupted or killed program
    never does in that way. The module is in memory once it is imported, so the folder goes at once.
    """
    try:
        classes: dict[str, Any] = import_ros("genpy.dynamic").generate_dynamic(kind, definition)
    finally:
        for folder in [each for each in sys.path if Path(each).name.startswith("genpy_")]:
            sys.path.remove(folder)
            shutil.rmtree(folder, ignore_errors=True)
        atexit.unregister(shutil.rmtree)
    return classes


def within(seconds: float, function: Callable[[], T]) -> T:
    """Return what a function returns, or give up on it.

    Raises:
        TimeoutError: it did not return in time; its thread is left behind.
    """
    answer: Future[T] = Future()

    def work() -> None:
        try:
            answer.set_result(function())
        except BaseException as error:  # noqa: BLE001 - handed to the caller
            answer.set_exception(error)

    threading.Thread(target=work, daemon=True).start()
    if not wait([answer], seconds).done:
        raise TimeoutError(f"no answer within {seconds:g} s")
    return answer.result()


def ping_master(uri: str, patience: float = PATIENCE) -> str:
    """Open and close a connection to a master and return this machine's address on the way there.

    Raises:
        OSError: nothing answers; also when the name cannot be resolved in time, or the address is none.
    """

    def connect() -> str:
        import socket  # here and below: what only reads recordings asks no master

        try:
            place = urlsplit(uri)
            where = (place.hostname or "", place.port or 11311)
        except ValueError as error:
            raise OSError(str(error)) from error
        if place.scheme != "http" or not where[0]:
            raise OSError("not an address like http://HOST:11311")
        with socket.create_connection(where, timeout=patience) as connection:
            return str(connection.getsockname()[0])

    return within(patience, connect)


@dataclass(frozen=True)
class Node:
    """This process as a ROS node.

    Attributes:
        rospy: the module.
        uri: address of the master.
    """

    rospy: Any
    uri: str

    def ask(self, question: str, *words: str) -> Any:  # noqa: ANN401
        """Return what the master answers to a question such as ``"getSystemState"``.

        Raises:
            MasterSilent: it does not within a limit.
        """
        master = import_ros("rosgraph").Master(self.rospy.get_name())
        try:
            return within(PATIENCE, lambda: getattr(master, question)(*words))
        except OSError as error:
            text = f"the ROS master at {self.uri} no longer answers ({error})"
            raise MasterSilent(text) from error

    def parameter(self, name: str) -> Any:  # noqa: ANN401
        """Return a parameter; None where the master has none of that name."""
        return self.ask("getParam", name) if self.ask("hasParam", name) else None

    def close(self) -> None:
        """Leave the graph; a master that died meanwhile is not waited for."""
        with suppress(TimeoutError):
            within(PATIENCE, lambda: self.rospy.signal_shutdown("done"))


def connect(name: str, given: str | None = None, patience: float = PATIENCE) -> Node:
    """Become a node of the graph.

    Args:
        name: node name; a number is appended.
        given: address of the master, None for ROS_MASTER_URI or the usual one.
        patience: how long to wait for it [s].

    Raises:
        RosMissing: ROS is not installed.
        MasterSilent: no master answers.
    """
    uri = master_uri(given)
    if missing := missing_modules():
        raise RosMissing(f"not found: {', '.join(missing)}", fix=APT)
    try:
        address = ping_master(uri, patience)
    except OSError as error:
        reason = error.strerror or str(error)
        raise MasterSilent(f"no ROS master at {uri} ({reason.lower()})", where=uri) from error
    _environment(uri, address)
    rospy = import_ros("rospy")
    switches = dict.fromkeys(("disable_signals", "disable_rosout", "disable_rostime"), True)
    try:
        within(5 * patience, lambda: rospy.init_node(name, argv=[], anonymous=True, **switches))
    except (OSError, rospy.ROSException) as error:
        raise MasterSilent(
            f"the master at {uri} did not take this node ({error})", where=uri
        ) from error
    _silence()
    return Node(rospy, uri)


def _environment(uri: str, address: str) -> None:
    """Tell ROS what it reads from variables only, before it is imported."""
    os.environ["ROS_MASTER_URI"] = uri
    if not os.environ.get("ROS_IP") and not os.environ.get("ROS_HOSTNAME"):
        # Why: a host name that others cannot resolve is the usual reason why topics are listed but publish nothing.
        os.environ["ROS_IP"] = address
    os.environ.setdefault("ROS_LOG_DIR", str(cache_folder() / "ros"))


def _silence() -> None:
    """Keep ROS from writing to stdout, which belongs to the answer."""
    import logging

    for name in ("rosout", "rospy", "rospy.internal"):
        handlers = logging.getLogger(name).handlers
        handlers[:] = [each for each in handlers if isinstance(each, logging.FileHandler)]


def raise_priority() -> str:
    """Raise the priority of this thread and those it starts later; return what was granted.

    Why: a late command jerks the arm, a late reader loses its state.
    """
    with suppress(OSError, AttributeError):
        os.sched_setscheduler(0, os.SCHED_RR, os.sched_param(REAL_TIME))
        return "real time"
    with suppress(OSError, AttributeError):
        os.setpriority(os.PRIO_PROCESS, 0, NICENESS)
        return f"nice {NICENESS}"
    return "usual"
