"""Broken inputs that somebody thought of: each once went wrong, and is answered with the message beside it."""

from __future__ import annotations

import json
import os
import re
import resource
import shutil
import sqlite3
import tempfile
from collections.abc import Callable
from contextlib import closing
from dataclasses import replace
from pathlib import Path

import containers
import numpy as np
import pytest
from forked import contents, faults, run
from inputs import BATCH, PLAN, ROBOT, URDF, motion

import dynid
from dynid.errors import NotAnArtifact

LOG = motion(3)
RING = "".join(
    f"<link name='{a}'/><joint name='to_{a}' type='revolute'><parent link='{b}'/><child link='{a}'/></joint>"
    for a, b in ("ab", "ba")
)


def hole(size: int) -> Callable[[Path], None]:
    """Return what makes a file of a size that takes no room."""

    def write(path: Path) -> None:
        with path.open("wb") as stream:
            stream.truncate(size)

    return write


def silent(path: Path) -> None:
    """A log in which one joint moves and says that it needs no torque."""
    tau = LOG.tau.copy()
    tau[:, 1] = 0
    replace(LOG, tau=tau).save(path)


def hardly_silent(path: Path) -> None:
    """A log in which one joint moves and says that it needs 1e-150 N m."""
    tau = LOG.tau.copy()
    tau[:, 1] *= 1e-150
    replace(LOG, tau=tau).save(path)


def with_command(path: Path) -> None:
    """A log with what was commanded."""
    replace(LOG, extra={"q_ref": LOG.q}).save(path)


def numbered(value: str) -> Callable[[Path], None]:
    """Return what makes a store whose only topic has such a number."""

    def write(path: Path) -> None:
        path.unlink(missing_ok=True)
        with closing(sqlite3.connect(path)) as base:
            base.executescript(
                "CREATE TABLE topics(id, name, type, serialization_format); CREATE TABLE messages(id, topic_id, timestamp, data);"
                f"INSERT INTO topics VALUES ({value}, '/joint_states', 'sensor_msgs/msg/JointState', 'cdr');"
                f"INSERT INTO messages VALUES (1, {value}, 1, x'00010000')"
            )

    return write


def meshes(made: Callable[[Path], object]) -> Callable[[Path], None]:
    """Return what makes a mesh and a URDF that shows it."""

    def write(path: Path) -> None:
        shape = f'<collision><geometry><mesh filename="{path.name}"/></geometry></collision>'
        path.with_name("meshes.urdf").write_text(
            URDF.replace("</inertial></link>", f"</inertial>{shape}</link>")
        )
        made(path)

    return write


def executable(text: str) -> Callable[[Path], None]:
    """Return what writes a program."""

    def write(path: Path) -> None:
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)

    return write


def a_pause(seconds: float) -> Callable[[Path], None]:
    """A log that was stopped in the middle and went on later."""

    def write(path: Path) -> None:
        t = LOG.t.copy()
        t[len(t) // 2 :] += seconds
        replace(LOG, t=t).save(path)

    return write


def one_stamp(path: Path) -> None:
    """A table in which one sample is repeated with its stamp."""
    path.write_text("t;q_shoulder;q_elbow;tau_shoulder;tau_elbow\n" + "0,1;1;2;3;4\n" * 50)


def fast_and_short(path: Path) -> None:
    """A log of 50 kHz that ends after 24 ms, in which the arm moves a little."""
    replace(LOG, t=2e-3 * LOG.t, q=3e-3 * LOG.q, qd=None).save(path)


def held_by(kp: str) -> Callable[[Path], None]:
    """An arm whose controller has a stiffness, and a log with what was commanded."""

    def write(path: Path) -> None:
        path.write_text(f"{ROBOT}controller: {{kp: {kp}, kd: 5}}\n")
        replace(LOG, extra={"q_ref": LOG.q}).save(path.with_name("log.npz"))

    return write


def half_a_name(path: Path) -> None:
    """A log whose first joint is called by half a character."""
    with np.load(path.with_name("other.npz")) as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays["header"] = np.array(str(arrays["header"]).replace('"shoulder"', '"\\ud800"'))
    np.savez(path, **arrays)


def effects(*some: str) -> str:
    return f"{ROBOT}effects:\n" + "".join(f"  - {{{one}, joints: [elbow]}}\n" for one in some)


def job(**keys: object) -> str:
    return json.dumps({"jobs": [{"name": "one", "robot": "arm.yaml", "logs": ["log.npz"], **keys}]})


def wide(path: Path) -> None:
    """A log of ten samples of a hundred thousand joints."""
    q = np.zeros((10, 100_000))
    np.savez(path, t=np.arange(10.0), q=q, tau=q)


def poses(count: int) -> str:
    return "\n".join(f"{k % 3 * 0.1},{k % 5 * 0.1}" for k in range(count))


#: What is wrong: file, content or what makes it, command, status, part of the message.
CASES = {
    "a million columns": (
        "log.csv",
        "t," + ",".join(f"q_{k}" for k in range(10**6)),
        "check log.csv --robot arm.yaml",
        3,
        "one line of a text log",
    ),
    "512 columns of 40 numbers each": (
        "log.csv",
        "t,"
        + ",".join(f"{'q' if k % 2 else 'tau'}_{k // 2}{'_1_2' * 20}" for k in range(511))
        + ("\n" + "1," * 511 + "1") * 30,
        "check log.csv",
        0,
        "",
    ),
    "an angle of 1e308": (
        "arm.urdf",
        URDF.replace('rpy="1.5708 0 0"', 'rpy="1e308 0 0"'),
        "import arm.urdf --out out/a.yaml",
        3,
        "finite numbers below",
    ),
    "a line of 1 GB": (
        "log.csv",
        hole(1 << 30),
        "check log.csv --robot arm.yaml",
        3,
        "one line of a text log",
    ),
    "a motion of 1 TB": (
        "motion.npz",
        hole(1 << 40),
        "simulate arm.yaml motion.npz --out out",
        3,
        "may expand",
    ),
    "waypoints of 1 TB": (
        "way.csv",
        hole(1 << 40),
        "trajectory arm.yaml --from-waypoints way.csv --preview none --out out",
        3,
        "E323",
    ),
    "an earlier result of 1 TB": (
        "earlier.npz",
        hole(1 << 40),
        "trajectory arm.yaml --earlier earlier.npz --seconds 1 --preview none --out out/x",
        3,
        "E3",
    ),
    "a log of 1 TB": (
        "log.npz",
        hole(1 << 40),
        "parameters arm.yaml log.npz --out out",
        3,
        "may expand",
    ),
    "a megabyte of aliases": (
        "arm.yaml",
        ROBOT + "effects: [&w {effect: x}, " + "*w, " * 300_000 + "]",
        "check arm.yaml",
        3,
        "bytes for a YAML",
    ),
    "aliases that double forty times": (
        "arm.yaml",
        ROBOT
        + "x0: &x0 [a, a]\n"
        + "".join(f"x{k}: &x{k} [*x{k - 1}, *x{k - 1}]\n" for k in range(1, 40)),
        "check arm.yaml",
        3,
        "unknown key 'x0'",
    ),
    "a number of 5000 digits": (
        "arm.yaml",
        ROBOT.replace("0.4", "9" * 5000, 1),
        "check arm.yaml",
        3,
        "not finite",
    ),
    "a length of 1e-300 m": (
        "arm.yaml",
        ROBOT.replace("a: 0.4", "a: 1.0e-300"),
        "model arm.yaml --out out",
        3,
        "beyond what can be measured",
    ),
    "UTF-16": ("arm.yaml", ROBOT.encode("utf-16"), "check arm.yaml", 3, "not a text file"),
    "90 000 waypoints": (
        "way.csv",
        poses(90_000),
        "trajectory arm.yaml --from-waypoints way.csv --preview none --out out",
        3,
        "90 000 waypoints",
    ),
    "waypoints in degrees": (
        "plan.yaml",
        "alpha: 0.3\nduration: 4\nwaypoints: [[0,0],[40,-30],[90,20],[-60,50],[0,0]]\n",
        "trajectory arm.yaml plan.yaml --preview none --out out",
        3,
        "angle_unit: deg",
    ),
    "waypoints 1e-12 s apart": (
        "plan.yaml",
        PLAN.replace("[0, 2, 4]", "[0, 1.0e-12, 4]"),
        "trajectory arm.yaml plan.yaml --preview none --out out",
        3,
        "0.001 s later",
    ),
    "a motion of 1e302 s": (
        "plan.yaml",
        PLAN.replace("alpha: 0.3", "alpha: 1.0e-29"),
        "trajectory arm.yaml plan.yaml --preview none --out out",
        3,
        "a planned motion",
    ),
    "5000 jobs": (
        "batch.yaml",
        "defaults: {robot: arm.yaml}\njobs:\n"
        + "".join(f"- {{name: j{k}, logs: [x]}}\n" for k in range(5000)),
        "run batch.yaml --out out",
        3,
        "5 000 jobs",
    ),
    "a log called --force": (
        "batch.yaml",
        BATCH.replace("log.csv", "--force"),
        "run batch.yaml --out out",
        3,
        "no such file",
    ),
    "a joint that needs no torque": (
        "log.npz",
        silent,
        "identify arm.yaml log.npz --out out",
        3,
        "effort is 0 in every sample of elbow",
    ),
    "a joint that needs 1e-150 N m": (
        "log.npz",
        hardly_silent,
        "identify arm.yaml log.npz --out out",
        3,
        "effort is 0 in every sample of elbow",
    ),
    "a log with its command beside one without": (
        "log.npz",
        with_command,
        "identify arm.yaml other.npz log.npz --out out",
        0,
        "wrote",
    ),
    "a ring of links": (
        "arm.urdf",
        URDF.replace("</robot>", RING + "</robot>"),
        "import arm.urdf --tip a --out out/a.yaml",
        3,
        "is its own parent",
    ),
    "300 000 elements inside each other": (
        "arm.urdf",
        "<a>" * 300_000,
        "import arm.urdf --out out/a.yaml",
        3,
        "not XML",
    ),
    "entities that multiply": (
        "arm.urdf",
        "<!DOCTYPE r [<!ENTITY a 'lol'>"
        + "".join(
            f"<!ENTITY {b} '{f'&{a};' * 10}'>"
            for a, b in zip("abcdefghi", "bcdefghij", strict=True)
        )
        + "]><robot>&j;</robot>",
        "import arm.urdf --out out/a.yaml",
        3,
        "not XML",
    ),
    "a pipe": ("log.npz", os.mkfifo, "identify arm.yaml log.npz --out out", 3, "no regular file"),
    "1500 chunks of 15 MB in 1 MB": (
        "log.mcap",
        containers.many_chunks,
        "check log.mcap",
        3,
        "may expand",
    ),
    "500 chunks of 60 MB in 30 kB": (
        "log.bag",
        containers.many_bag_chunks,
        "check log.bag",
        3,
        "may expand",
    ),
    "messages after the year 2262": (
        "log.mcap",
        containers.stamped_late(LOG),
        "check log.mcap --robot arm.yaml",
        0,
        "W305",
    ),
    "10^15 rows in 300 kB": (
        "log.db3",
        containers.pages_without_end,
        "identify arm.yaml log.db3 --out out",
        3,
        "E3",
    ),
    "10^15 rows in 300 kB, looked at": (
        "log.db3",
        containers.pages_without_end,
        "check log.db3",
        0,
        "",
    ),
    **{
        f"5200 rows that share their {what}": (
            "log.db3",
            containers.shared_pages(what, text=text),
            "check log.db3",
            status,
            said,
        )
        for what, text, status, said in (
            ("topic_id", False, 0, "0 messages"),
            ("topic_id", True, 0, "0 messages"),
            ("timestamp", False, 0, "0 messages"),
            ("pad", False, 3, "no tables of rosbag2"),
        )
    },
    "5200 rows that share their data": (
        "log.db3",
        containers.shared_pages("data"),
        "check log.db3",
        0,
        "pages are used twice",
    ),
    "statistics of a third of a pair": (
        "log.mcap",
        containers.short_map(LOG, 11, 3),
        "check log.mcap --robot arm.yaml",
        0,
        "usable",
    ),
    "statistics of a billion pairs": (
        "log.mcap",
        containers.short_map(LOG, 11, 10**9),
        "check log.mcap --robot arm.yaml",
        0,
        "usable",
    ),
    "an index of chunks of a billion pairs": (
        "log.mcap",
        containers.short_map(LOG, 8, 10**9),
        "check log.mcap --robot arm.yaml",
        0,
        "usable",
    ),
    **{
        f"a topic whose number is {what}": (
            "log.db3",
            numbered(value),
            "check log.db3",
            3,
            "names no topic",
        )
        for what, value in (
            ("text", "'text'"),
            ("none", "NULL"),
            ("endless", "9e999"),
            ("of 5000 digits", f"'{'9' * 5000}'"),
            ("a blob", "x'00'"),
        )
    },
    "a journal that is a pipe": (
        "log.db3",
        containers.with_journal(LOG, "pipe"),
        "check log.db3",
        0,
        "",
    ),
    "a journal that is a device": (
        "log.db3",
        containers.with_journal(LOG, "device"),
        "check log.db3",
        0,
        "",
    ),
    "a journal of debris": (
        "log.db3",
        containers.with_journal(LOG, "debris"),
        "check log.db3 --robot arm.yaml",
        0,
        "",
    ),
    "one sample 50 times": (
        "log.csv",
        one_stamp,
        "check log.csv --robot arm.yaml",
        4,
        "1 samples are too few",
    ),
    "half a character as a name": (
        "log.npz",
        half_a_name,
        "convert log.npz --to out/x.bag",
        3,
        "E301",
    ),
    "a zero byte in a path": (
        "batch.yaml",
        job(baseline="a\0b"),
        "run batch.yaml --out out",
        3,
        "invalid character",
    ),
    "merged mappings that double 24 times": (
        "out/run.yaml",
        "a: &a {x: 1, y: 2}\n"
        + "".join(
            f"{b}: &{b} {{<<: [*{a}, *{a}]}}\n"
            for a, b in zip("abcdefghijklmnopqrstuvwx", "bcdefghijklmnopqrstuvwxy", strict=True)
        ),
        "model arm.yaml --out out",
        0,
        "",
    ),
    "a prior of no possible body": (
        "arm.yaml",
        ROBOT.replace("izz: 0.015", "izz: 50"),
        "trajectory arm.yaml plan.yaml --preview none --out out",
        1,
        "the prior of link 2 is not a physically possible body",
    ),
    "one effect twice": (
        "arm.yaml",
        effects("effect: viscous", "effect: viscous"),
        "check arm.yaml",
        3,
        "viscous is given twice on elbow",
    ),
    "two waves of one joint": (
        "arm.yaml",
        effects(
            "effect: torque_ripple, parameters: {k: 7}",
            "effect: torque_ripple, parameters: {k: 14}",
        ),
        "identify arm.yaml log.npz --out out",
        0,
        "parameters.npz",
    ),
    "an arm with effects": (
        "arm.yaml",
        effects(
            "effect: torque_ripple, parameters: {k: 7}", "effect: backlash, parameters: {b: 0.01}"
        ),
        "trajectory arm.yaml --seconds 1 --preview none --out out",
        0,
        "planned without",
    ),
    "terms that are one": (
        "arm.yaml",
        effects("effect: formula, formula: a q + b q + c q"),
        "identify arm.yaml log.npz --out out",
        0,
        "not determined",
    ),
    "a formula on no joint": (
        "arm.yaml",
        ROBOT + "effects:\n  - {effect: formula, formula: a q, joints: []}\n",
        "model arm.yaml --out out",
        3,
        "acts on no joint",
    ),
    "a speed to the power of 1000": (
        "arm.yaml",
        effects("effect: nonlinear_viscous, parameters: {p: 1000}"),
        "identify arm.yaml log.npz --out out",
        3,
        "no finite torque",
    ),
    "a simulated time constant of zero": (
        "x",
        b"",
        "simulate arm.yaml out/trajectory.npz --effect torque_drift@elbow:tc=0,a=1 --out out/x",
        2,
        "--effect",
    ),
    "torques that are an hour late": (
        "arm.yaml",
        effects("effect: torque_delay, parameters: {delay: 3600}"),
        "identify arm.yaml log.npz --out out",
        3,
        "3600 s is longer",
    ),
    "100 000 columns without names": ("log.npz", wide, "check log.npz", 3, "columns of a log"),
    "2000 effects": (
        "arm.yaml",
        effects(*(f"effect: torque_ripple, parameters: {{k: {k}}}" for k in range(1, 2000))),
        "model arm.yaml --out out",
        3,
        "columns for the torque effects",
    ),
    "an empty plan": (
        "out/trajectory.npz",
        b"",
        "simulate arm.yaml out/trajectory.npz --out out/x",
        3,
        "E3",
    ),
    "a cell of two numbers": (
        "log.csv",
        "t,q_shoulder,q_elbow,tau_shoulder,tau_elbow\n" + "0.1,1 2,0,0,0\n" * 30,
        "check log.csv",
        3,
        "'1 2' is not a number",
    ),
    "a filter of 60 years": (
        "x",
        b"",
        "identify arm.yaml log.npz --cutoff 1e-9 --out out",
        4,
        "the filters at 1e-09 Hz need",
    ),
    "a seed below zero": (
        "x",
        b"",
        "export out/parameters.npz --format python --seed -1",
        2,
        "--seed",
    ),
    "a pause of 1e6 s": (
        "log.npz",
        a_pause(1e6),
        "identify arm.yaml other.npz log.npz --out out",
        0,
        "the recording pauses",
    ),
    "a pause of 1e9 s": (
        "log.npz",
        a_pause(1e9),
        "identify arm.yaml other.npz log.npz --out out",
        0,
        "the recording pauses",
    ),
    "a pause of 1e6 s before a gap": (
        "log.npz",
        a_pause(1e6),
        "gap out/parameters.npz log.npz --no-apply --out out",
        0,
        "the recording pauses",
    ),
    "a log of 50 kHz that is simulated": (
        "log.npz",
        fast_and_short,
        "simulate arm.yaml log.npz --out out",
        0,
        "wrote",
    ),
    "a tool that hardly moves": (
        "x",
        b"",
        "trajectory arm.yaml plan.yaml --tool-speed 1e-12 --preview none --out out",
        5,
        "tool moves at",
    ),
    "a motion that never ends": (
        "x",
        b"",
        "trajectory arm.yaml plan.yaml --alpha 1e-308 --preview none --out out",
        3,
        "inf samples",
    ),
    "a sensor finer than numbers": (
        "x",
        b"",
        "simulate arm.yaml out/trajectory.npz --resolution 1e-308 --out out",
        2,
        "--resolution",
    ),
    "a heavy point": (
        "x",
        b"",
        "simulate arm.yaml out/trajectory.npz --payload 1e12 --out out",
        0,
        "wrote",
    ),
    "noise that is none": (
        "x",
        b"",
        "simulate arm.yaml out/trajectory.npz --noise nan --out out",
        2,
        "--noise",
    ),
    "waypoints of an hour": (
        "way.csv",
        "t,q_shoulder,q_elbow\n0,0,0\n2000,0.4,-0.3\n4000,0,0\n",
        "trajectory arm.yaml --from-waypoints way.csv --preview none --out out",
        3,
        "a planned motion",
    ),
    "waypoints of a quarter of an hour": (
        "way.csv",
        "t,q_shoulder,q_elbow\n0,0,0\n400,0.4,-0.3\n990,0,0\n",
        "trajectory arm.yaml --from-waypoints way.csv --preview none --alpha 1 --out out",
        0,
        "wrote",
    ),
    "waypoints after the end of time": (
        "way.csv",
        "t,q_shoulder,q_elbow\n0,0,0\n2e300,0.4,-0.3\n4e300,0,0\n",
        "trajectory arm.yaml --from-waypoints way.csv --preview none --out out",
        3,
        "numbers up to",
    ),
    "a controller without stiffness": (
        "arm.yaml",
        held_by("0"),
        "identify arm.yaml log.npz --method idim-iv --out out",
        4,
        "E407",
    ),
    "a controller that is endlessly stiff": (
        "arm.yaml",
        held_by("1.0e+11"),
        "identify arm.yaml log.npz --method idim-iv --out out",
        3,
        "the simulated closed loop",
    ),
    "a sign that changes at 1e-29 rad/s": (
        "arm.yaml",
        f"{ROBOT}coulomb: {{velocity: 1.0e-29}}\n",
        "check arm.yaml",
        3,
        "at least 1e-12",
    ),
    "an arm as long as the universe": (
        "arm.yaml",
        ROBOT.replace("a: 0.4", "a: 1.0e+27"),
        "check arm.yaml",
        3,
        "beyond what can be measured",
    ),
    "a name that steers the terminal": (
        "batch.yaml",
        job(logs="\x1b[31m\u202e.npz", name="\x1b]0;x\x07"),
        "run batch.yaml --out out --junit out/j.xml --log-file out/said.log",
        3,
        "no such file",
    ),
    "a robot that steers the terminal": (
        "arm.yaml",
        ROBOT.replace("a: 0.4", 'a: "\\e[31m"'),
        "check arm.yaml --log-file out/said.log",
        3,
        "E2",
    ),
    **{
        f"a compiler in the folder, called {name}": (
            name,
            executable("touch HACKED"),
            "export out/parameters.npz --format c --format matlab",
            0,
            "wrote",
        )
        for name in ("cc", "gcc", "as", "octave-cli")
    },
    "a folder that lends its shell's start file": (
        "dynid.yaml",
        "log_file: started\n",
        "check log.csv --robot arm.yaml",
        2,
        "only you may set",
    ),
    "a run with a scheduler of somebody": (
        "dynid.yaml",
        "run: {scheduler: 'tcp://127.0.0.1:1'}\n",
        "run batch.yaml --out out/b",
        2,
        "only you may set",
    ),
    "a run that writes elsewhere": (
        "out/run.yaml",
        "identify: {arguments: [arm.yaml, log.npz, --out, /tmp/elsewhere]}\n",
        "identify --from out/run.yaml",
        2,
        "leads out of the folder",
    ),
    **{
        f"a mesh that is {what}": (
            "mesh.stl",
            made,
            "trajectory arm.yaml plan.yaml --urdf meshes.urdf --preview none --out out",
            3,
            said,
        )
        for what, made, said in (
            ("a pipe", meshes(os.mkfifo), "no regular file"),
            ("a device", meshes(lambda path: path.symlink_to("/dev/zero")), "no regular file"),
            ("a hole of 1 TB", meshes(hole(1 << 40)), "may expand"),
        )
    },
    "a log file that nobody reads": (
        "said",
        os.mkfifo,
        "check arm.yaml --log-file said",
        6,
        "a pipe that nobody reads",
    ),
    "an output that is a pipe": (
        "pipe.csv",
        os.mkfifo,
        "convert log.npz --to pipe.csv",
        6,
        "no regular file",
    ),
}


@pytest.mark.parametrize("case", CASES)
def test_a_broken_input_is_answered_with_its_message(case, originals, tmp_path):
    name, content, command, status, message = CASES[case]
    folder = tmp_path / "work"
    shutil.copytree(originals, folder)
    path = folder / name
    path.unlink(missing_ok=True)
    if callable(content):
        content(path)
    else:
        path.write_bytes(content if isinstance(content, bytes) else content.encode())
    before = contents(folder)
    ended = run([*command.split(), "--no-input", "--force"], folder)
    assert faults(ended, folder, before) == []
    assert ended.status == status, ended
    assert message in ended.err + ended.out


def no_folder() -> None:
    os.chdir(gone := tempfile.mkdtemp())
    Path(gone).rmdir()


def no_programs() -> None:
    """Let the compiler be one that makes nothing."""
    place = Path(tempfile.mkdtemp())
    executable("exit 0")(place / "cc")
    os.environ["PATH"] = f"{place}:/usr/bin:/bin"


#: Environments: what is changed, command, statuses.
ENVIRONMENTS = {
    "the folder is gone": (no_folder, "doctor", {6}),
    "no home": (lambda: os.environ.pop("HOME"), "model arm.yaml --out out", {0}),
    "a home that is full": (
        lambda: os.environ.update(HOME="/dev/full"),
        "model arm.yaml --out out --rebuild",
        {0},
    ),
    "no folder for temporary files": (
        lambda: os.environ.update(TMPDIR="/nowhere"),
        "convert log.npz --to out/x.mcap",
        {0, 6},
    ),
    "an address that is none": (
        lambda: os.environ.update(ROS_MASTER_URI="http://[::bad"),
        "doctor",
        {0},
    ),
    "a locale that nobody has": (
        lambda: os.environ.update(LC_ALL="xx_YY.bogus"),
        "check arm.yaml",
        {0},
    ),
    "an option that is no text": (
        lambda: os.environ.update(DYNID_OUT="\udcff", DYNID_LIMIT="samples=1"),
        "check log.csv --robot arm.yaml",
        {2, 3},
    ),
    "programs of the current folder": (
        lambda: os.environ.update(PATH=f".:{os.environ['PATH']}"),
        "export out/parameters.npz --format c",
        {0},
    ),
    "temporary files that are no programs": (
        no_programs,
        "export out/parameters.npz --format c",
        {0},
    ),
    "twelve open files": (
        lambda: resource.setrlimit(resource.RLIMIT_NOFILE, (12, 12)),
        "identify arm.yaml log.npz --out out",
        {0, 6},
    ),
}


@pytest.mark.parametrize("case", ENVIRONMENTS)
def test_a_strange_environment_is_no_crash(case, originals, tmp_path):
    prepare, command, statuses = ENVIRONMENTS[case]
    shutil.copytree(originals, tmp_path / "work")
    ended = run(
        [*command.split(), *([] if command == "doctor" else ["--no-input", "--force"])],
        tmp_path / "work",
        prepare=prepare,
    )
    assert ended.status in statuses, ended
    assert "internal error" not in ended.err


def damaged(path: Path, change: Callable[[dict[str, np.ndarray]], None]) -> None:
    """Write a result file again with other arrays; "header" is one of them."""
    with np.load(path) as archive:
        arrays = {name: archive[name] for name in archive.files}
    change(arrays)
    np.savez(path, **arrays)


def header_with(pattern: str, new: str) -> Callable[[dict[str, np.ndarray]], None]:
    """Return what puts other text into a header."""

    def change(arrays: dict[str, np.ndarray]) -> None:
        text, count = re.subn(pattern, new, str(arrays["header"]))
        assert count, pattern
        arrays["header"] = np.array(text)

    return change


def answer(
    originals: Path, tmp_path: Path, file: str, change: Callable[..., None], command: str
) -> tuple[int, bool]:
    """Return the status of a command beside a damaged result, and whether that is called damaged."""
    folder = tmp_path / "work"
    shutil.copytree(originals, folder)
    damaged(folder / file, change)
    before = contents(folder)
    ended = run([*command.split(), "--no-input"], folder)
    assert faults(ended, folder, before) == []
    return ended.status, "error[E321]" in ended.err


@pytest.mark.parametrize("fact", ["cutoff", "rate", "delay", "first_step"])
@pytest.mark.parametrize("value", ["Infinity", "NaN", "-1e300", "1e300"])
def test_a_stack_with_a_filter_that_is_none_is_damaged(fact, value, originals, tmp_path):
    change = header_with(rf'"{fact}": [^,}}]+', f'"{fact}": {value}')
    file, command = "out/fullnumericregressor.npz", "identify arm.yaml --out out --force"
    assert answer(originals, tmp_path, file, change, command) == (3, True)


REVIEW = "trajectory arm.yaml --review out/trajectory.npz --accept --preview none"


@pytest.mark.parametrize(
    "knots", ["[[]]", '"x"', "[0, Infinity]", "[1, 0]", "[]", "null", f"[{'0, ' * 5000}1]"]
)
def test_a_plan_with_knots_that_are_none_is_damaged(knots, originals, tmp_path):
    change = header_with(r'"knots": \[[^]]*\]', f'"knots": {knots}')
    assert answer(originals, tmp_path, "out/trajectory.npz", change, REVIEW) == (3, True)


@pytest.mark.parametrize(
    "command",
    [REVIEW, "trajectory arm.yaml --from-trajectory out/trajectory.npz --out out/x --preview none"],
)
@pytest.mark.parametrize("value", [1e300, np.inf, np.nan])
def test_a_plan_with_coefficients_that_are_none_is_damaged(value, command, originals, tmp_path):
    def change(arrays):
        arrays["coefficients"][0, 0] = value

    assert answer(originals, tmp_path, "out/trajectory.npz", change, command) == (3, True)


@pytest.mark.parametrize(
    "command",
    [
        "report out",
        "trajectory arm.yaml --for-gap out/gap.npz --seconds 1 --preview none --out out",
    ],
)
@pytest.mark.parametrize("key", ["std_errors", "units"])
def test_a_gap_with_errors_of_other_names_is_damaged(key, command, originals, tmp_path):
    change = header_with(rf'"{key}": \[\["', f'"{key}": [["x')
    assert answer(originals, tmp_path, "out/gap.npz", change, command + " --force") == (3, True)


@pytest.mark.parametrize("name", ["t", "q", "qdd"])
@pytest.mark.parametrize(
    "change", [lambda x: x[:, None], lambda x: x[:0], lambda x: x * np.nan, np.atleast_3d]
)
def test_a_plan_with_samples_that_are_none_is_damaged(name, change, originals, tmp_path):
    def changed(arrays):
        arrays[name] = change(arrays[name])

    assert answer(originals, tmp_path, "out/trajectory.npz", changed, REVIEW) == (3, True)


#: What somebody may have done to an array of a residual model.
DAMAGE = {
    "another shape": lambda x: x[..., :1],
    "text": lambda x: x.astype(str),
    "NaN": lambda x: x * np.nan,
    "endless": lambda x: x * 1e300 + 1e300,
    "whole numbers": lambda x: x.astype("i1"),
    "half": lambda x: x.astype("f2"),
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize(
    "name", ["speed", "reference", "scale", "projection", "mean", "root", "slope", "size", "rms"]
)
def test_a_residual_model_that_is_none_is_damaged(name, damage, originals, tmp_path):
    path = tmp_path / "parameters.npz"
    shutil.copy(originals / "out" / "parameters.npz", path)
    damaged(
        path,
        lambda arrays: arrays.update({f"error_{name}": DAMAGE[damage](arrays[f"error_{name}"])}),
    )
    with pytest.raises(NotAnArtifact, match=f"error_{name}"):
        dynid.load(path)


@pytest.mark.parametrize(
    "name", ["error_root", "error_scale", "error_speed", "noise", "plain_covariance"]
)
def test_a_load_beside_a_result_of_nothing_is_not_looked_for(name, originals, tmp_path):
    def change(arrays):
        arrays[name] = (
            -np.eye(*arrays[name].shape) if name == "plain_covariance" else 0 * arrays[name]
        )

    command = "identify arm.yaml other.npz --payload-from out/parameters.npz --out out/x"
    assert answer(originals, tmp_path, "out/parameters.npz", change, command) == (3, True)


@pytest.mark.parametrize(
    "words",
    [
        "identify arm.yaml log.npz --out --json",
        "check log.npz --log-file --json",
        "convert log.npz --to --force",
        "identify arm.yaml log.npz -o -f",
    ],
)
def test_an_option_is_no_folder_and_no_file(words, originals, tmp_path):
    folder = tmp_path / "work"
    shutil.copytree(originals, folder)
    before = contents(folder)
    ended = run([*words.split(), "--no-input"], folder)
    assert faults(ended, folder, before) == []
    assert (ended.status, "is an option" in ended.err) == (2, True)


@pytest.mark.parametrize("columns", ["²", "9" * 5000, "-5", "0", "x"])
def test_a_width_of_the_terminal_that_is_no_number_is_passed_over(
    columns, originals, tmp_path, monkeypatch
):
    monkeypatch.setenv("COLUMNS", columns)
    shutil.copytree(originals, tmp_path / "work")
    assert run(["compare", "out/parameters.npz"], tmp_path / "work").status == 0
