"""Where ROS 1 lies on this machine, found without importing any of it, and the line that installs it."""

from __future__ import annotations

import importlib.machinery
import os
import sys
from pathlib import Path

#: Where Ubuntu 20.04's Noetic and Debian 12's own packages put their Python modules.
FOLDERS = ("/opt/ros/noetic/lib/python3/dist-packages", "/usr/lib/python3/dist-packages")
#: What ``dynid record`` imports.
MODULES = ("rospy", "rosgraph", "rosbag", "genpy", "genmsg", "sensor_msgs", "std_msgs", "trajectory_msgs")
#: The line that installs all of it on Debian 12.
APT = (
    "apt-get install -y --no-install-recommends python3-rospy python3-rosbag python3-rosmaster python3-roslaunch "
    "python3-sensor-msgs python3-trajectory-msgs python3-std-msgs"
)


def ros_folders() -> list[str]:
    """Return the folders that may hold rospy, DYNID_ROS_PATH first."""
    own = os.environ.get("DYNID_ROS_PATH", "")
    return [folder for folder in (*own.split(os.pathsep), *FOLDERS) if folder and Path(folder).is_dir()]


def missing_modules() -> list[str]:
    """Return which of the needed ROS modules cannot be found, without importing any of them."""
    places = [*sys.path, *ros_folders()]
    finder = importlib.machinery.PathFinder
    return [name for name in MODULES if finder.find_spec(name, places) is None]
