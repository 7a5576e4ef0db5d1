"""The likeliest mistakes, one row each: code, exit status, nothing on stdout, few lines, and a fix that works.

Rows of motions and of the arm itself stand with the commands that can make them.
"""

import re
import shutil
import struct
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import twolink
from dynid.npz import write_artifact
from makelogs import kinova, state_messages, write_bag

ROOT = Path(__file__).parents[2]
BAG = ROOT / "trajectories/lwr4plus_validate.bag"
CHECK = ("check", "arm.yaml", "log.csv")
ROBOT = ("check", "arm.yaml")
IDENTIFY = ("identify", "arm.yaml", "log.csv")
DRIVER = "driver: {kind: generic, units: {%s}}\n"


@dataclass(frozen=True)
class Mistake:
    """One row: what is spoilt, what is said, what repairs it.

    Attributes:
        code: of the error.
        says: pattern that the first line matches.
        words: command line.
        status: of the exit.
        robot: (old, new) text of arm.yaml that spoils it.
        log: spoils the columns of log.csv.
        fix: what the printed advice comes to: (old, new) text of arm.yaml, or words to add; None when only a new
            recording helps.
        advice: pattern of the fix line.
    """

    code: str
    says: str
    words: tuple[str, ...] = CHECK
    status: int = 3
    robot: tuple[str, str] | None = None
    log: object = None
    fix: tuple[str, ...] | None = None
    advice: str = "."


def spoil(key, change):
    """Return a function that replaces one kind of column."""

    def spoilt(columns):
        columns[key] = change(columns[key].copy())

    return spoilt


def put(rows, column, value):
    def change(values):
        values[(rows, column) if values.ndim == 2 else rows] = value
        return values

    return change


def scaled(column, factor):
    def change(values):
        values[:, column] *= factor
        return values

    return change


def keep(rows):
    """Return a function that keeps some rows of all columns."""
    return lambda columns: {key: values[rows] for key, values in columns.items()}


def jump_back(t):
    t[1500:] -= 5
    return t


def poses(gravity=1.0, zero=0.0):
    """Return a change to a log of forty poses with rests between, with weight or without, a sensor zeroed or not."""

    def change(columns):
        t = np.arange(0, 80, 0.01)
        place = np.random.default_rng(4).uniform(-1, 1, (41, 2))
        part, way = np.divmod(t, 2.0)
        x = np.clip(way, 0, 1)[:, None]
        step = place[part.astype(int) + 1] - place[part.astype(int)]
        q = place[part.astype(int)] + step * (10 * x**3 - 15 * x**4 + 6 * x**5)
        qd = step * (30 * x**2 - 60 * x**3 + 30 * x**4)
        qdd = step * (60 * x - 180 * x**2 + 120 * x**3)
        weight = twolink.torque(q, 0 * q, 0 * q)
        return {
            "t": t,
            "q": q,
            "qd": qd,
            "tau": twolink.torque(q, qd, qdd) - (1 - gravity) * weight + zero,
        }

    return change


ROBOT_FILE = [
    Mistake(
        "E201",
        r"arm.yaml:2: unknown key 'convetion'; did you mean 'convention'\?",
        words=ROBOT,
        robot=("convention", "convetion"),
        fix=("convetion", "convention"),
    ),
    Mistake(
        "E202",
        r"arm.yaml:\d+: joints\[0\].twist = 90 rad is more than a full turn",
        words=ROBOT,
        robot=("shoulder, a: 0.4", "shoulder, twist: 90, a: 0.4"),
        fix=("convention:", "angle_unit: deg\nconvention:"),
        advice="angle_unit: deg",
    ),
    Mistake(
        "E203",
        r"joints\[1\].a = '3e-1' is text in YAML; write 3.0e-1",
        words=ROBOT,
        robot=("a: 0.3", "a: 3e-1"),
        fix=("3e-1", "3.0e-1"),
    ),
    Mistake(
        "E203",
        r"joints\[1\].a",
        words=ROBOT,
        robot=("a: 0.3", "a: 0x"),
        fix=("0x", "0.3"),
    ),
    Mistake(
        "E204",
        "standard or modified",
        words=ROBOT,
        robot=("convention: standard\n", ""),
        fix=("name: arm", "name: arm\nconvention: standard"),
        advice="convention: standard",
    ),
    Mistake(
        "E205",
        r"no robot 'kinova_gen'; did you mean 'kinova_gen2'\?",
        words=("model", "kinova_gen"),
        status=2,
    ),
    Mistake(
        "E206",
        r"981 m/s\^2",
        words=ROBOT,
        robot=("-9.81", "-981"),
        fix=("-981", "-9.81"),
    ),
    Mistake(
        "E207",
        "arm.yaml:2: key 'name' is given twice",
        words=ROBOT,
        robot=("name: arm\n", "name: arm\nname: arm\n"),
        fix=("name: arm\nname: arm\n", "name: arm\n"),
    ),
]

LOGS = [
    Mistake(
        "E301", r"no such file logg.csv; nearby: log.csv", words=("check", "arm.yaml", "logg.csv")
    ),
    Mistake(
        "E301",
        r"no such file logg.csv; nearby: log.csv",
        words=("identify", "arm.yaml", "logg.csv"),
    ),
    Mistake(
        "E306",
        r"elbow torque is not a number in 12 samples, first at t = 3.000 s \(row 301\)",
        log=spoil("tau", put(slice(300, 312), 1, np.nan)),
        fix=("--exclude", "2.999-3.111"),
        advice="--exclude 2.999-3.111",
    ),
    Mistake(
        "E307",
        r"position spans .*degrees\? limits are \+-3.00 rad",
        log=lambda c: {**c, "q": np.degrees(c["q"]), "qd": np.degrees(c["qd"])},
        fix=("joints:", DRIVER % "position: deg, velocity: deg/s" + "joints:"),
        advice="position: deg, velocity: deg/s",
    ),
    Mistake(
        "E308",
        r"shoulder velocity is 57.\d x the change of position: deg/s",
        log=spoil("qd", np.degrees),
        fix=("joints:", DRIVER % "velocity: deg/s" + "joints:"),
        advice="velocity: deg/s",
    ),
    Mistake(
        "E308",
        "elbow velocity has the opposite sign",
        words=IDENTIFY,
        log=spoil("qd", scaled(1, -1)),
        fix=("--velocity", "derived"),
        advice="--velocity derived",
    ),
    Mistake(
        "E309",
        "log.csv names shoulder, elbow; the robot file expects schulter, elbow",
        robot=("name: shoulder", "name: schulter"),
        fix=("joints:", "driver: {kind: generic, joint_names: [shoulder, elbow]}\njoints:"),
        advice=r"joint_names: \[shoulder, elbow\]",
    ),
    Mistake(
        "E309",
        r"shoulder and elbow look swapped \(correlation",
        words=IDENTIFY,
        log=spoil("qd", lambda v: v[:, ::-1]),
        fix=("--velocity", "derived"),
        advice="--velocity derived",
    ),
    Mistake(
        "E311",
        r"time goes back 4.99 s at row 1501 \(t = 14.99 s\): two recordings joined\?",
        log=spoil("t", jump_back),
        fix=("--exclude", "10.000-14.990"),
        advice="--exclude 10.000-14.990",
    ),
    Mistake(
        "E312",
        r"\d+ % of the samples are missing \(9 gaps",
        log=keep(np.flatnonzero(np.arange(2000) % 200 < 180)),
    ),
    Mistake(
        "E313", "s of motion; about 18 parameters need about", status=4, log=keep(slice(0, 60))
    ),
    Mistake(
        "E314",
        r"joint states arrive at 5.0 Hz",
        status=4,
        log=keep(slice(None, None, 20)),
        advice="rate",
    ),
    Mistake(
        "E317",
        "gravity was already removed",
        log=poses(gravity=0),
        fix=("joints:", "torque: {source: gravity_free}\njoints:"),
        advice="gravity_free",
    ),
    Mistake(
        "E318",
        r"torque reaches .*: mNm\? rating 60 Nm",
        log=spoil("tau", lambda v: 1000 * v),
        fix=("joints:", DRIVER % "effort: mNm" + "joints:"),
        advice="effort: mNm",
    ),
    Mistake(
        "E401",
        "elbow moves 0 rad: its 4 own parameters cannot be found",
        status=4,
        log=lambda c: {
            **c,
            "q": put(slice(None), 1, 0.3)(c["q"]),
            "qd": put(slice(None), 1, 0.0)(c["qd"]),
        },
    ),
]


def names(row):
    return f"{row.code}-{row.words[0]}"


@pytest.mark.parametrize("row", ROBOT_FILE + LOGS, ids=names)
def test_a_mistake_gives_its_code_its_status_and_advice_that_works(arm, row):
    file = arm.folder / "arm.yaml"
    if row.robot:
        file.write_text(file.read_text().replace(*row.robot, 1))
    if row.log:
        twolink.write_log(arm.folder / "log.csv", 1, row.log)
    refused(arm(*row.words), row.code, row.status, row.says, row.advice)
    if row.fix is None:
        return
    words = row.words
    if row.fix[0].startswith("--"):
        words = (*words, *row.fix)
    else:
        file.write_text(file.read_text().replace(*row.fix, 1))
    again = arm(*words)
    assert f"error[{row.code}]" not in again.err
    assert again.status == 0, again.err


def refused(run, code, status, says=".", advice="."):
    assert run.err.startswith(f"error[{code}] ") or f"\nerror[{code}] " in run.err, run.err
    assert (run.status, run.out) == (status, "")
    lines = run.err[run.err.index("error[") :].splitlines()
    assert len(run.err.splitlines()) <= 6
    assert re.search(says, lines[0]), lines[0]
    fixes = [line for line in lines if line.startswith("  fix ")]
    assert len(fixes) == 1
    assert re.search(advice, fixes[0]), fixes[0]
    return run


# ---------------------------------------------------------------- warnings: said, and the work goes on
WARNINGS = [
    (
        "W312",
        keep(np.r_[0:600, 630:2000]),
        r"log.csv: 1 gap, longest 310 ms at 5.99 s: cut there, not bridged",
    ),
    (
        "W319",
        spoil("tau", lambda v: np.clip(v, -12, 12)),
        r"shoulder torque sits at 12 Nm .*clipped samples are left out",
    ),
]


@pytest.mark.parametrize(("code", "change", "says"), WARNINGS, ids=lambda v: str(v)[:4])
def test_a_warning_is_said_and_the_log_is_used(arm, code, change, says):
    twolink.write_log(arm.folder / "log.csv", 1, change)
    run = arm(*CHECK)
    assert run.status == 0
    assert re.search(rf"warning\[{code}\] {says}", run.err), run.err
    assert arm(*CHECK, "--strict").status == 1


def test_a_jump_by_a_full_turn_is_unwrapped(arm):

    def turn(columns):
        columns["q"][1500:, 1] += 2 * np.pi

    twolink.write_log(arm.folder / "log.csv", 1, turn)
    assert re.search(
        r"warning\[W315\] elbow jumps by 6.\d+ rad at 15.00 s; unwrapped", arm(*CHECK).err
    )


def test_gravity_that_points_up_is_a_warning_when_the_mount_is_not_said(arm):
    file = arm.folder / "arm.yaml"
    file.write_text(file.read_text().replace("[0, -9.81, 0]", "[0, 0, 9.81]"))
    run = arm("check", "arm.yaml")
    assert run.status == 0
    assert "warning[W206]" in run.err
    file.write_text(file.read_text() + "mount: ceiling\n")
    assert "W206" not in arm("check", "arm.yaml").err


def test_an_inertia_that_no_body_has_is_said_before_a_log_is_recorded(arm):
    file = arm.folder / "arm.yaml"
    text = re.sub(r"\nprior:.*", "", file.read_text(), flags=re.DOTALL)
    bodies = [
        "{mass: 3, com: [-0.2, 0, 0]}",
        "{mass: 2, com: [-0.1, 0, 0], inertia_com: {ixx: 0.01, iyy: 0.01, izz: 0.05}}",
    ]
    file.write_text(f"{text}\nprior:\n  links:\n" + "".join(f"    - {body}\n" for body in bodies))
    run = arm("check", "arm.yaml")
    assert run.status == 0
    assert "warning[W207]" in run.err
    assert "0.01, 0.01, 0.05 kg m^2" in run.err
    assert run.err.count("W207") == 1


@pytest.mark.slow
def test_masses_and_centres_alone_are_a_prior(arm):
    twolink.write_log(arm.folder / "log.csv", 1)
    file = arm.folder / "arm.yaml"
    text = re.sub(r"\nprior:.*", "", file.read_text(), flags=re.DOTALL)
    file.write_text(
        f"{text}\nprior:\n  links:\n" + "    - {mass: 3, com: [-0.2, 0, 0]}\n    - {mass: 0}\n"
    )
    run = arm("identify", "arm.yaml", "log.csv", "--no-input", "--json")
    assert run.status == 0
    assert "E404" not in run.err


# ---------------------------------------------------------------- bags
def lwr(name, *words):
    return ("check", name, "--robot", "kuka_lwr4plus", *words)


def test_a_topic_that_is_not_there_lists_those_that_are(dynid):
    refused(
        dynid(*lwr(str(BAG), "--topic", "/joint_state")), "E303", 3, "/lwr/joint_states", "--topic"
    )
    assert dynid(*lwr(str(BAG), "--topic", "/lwr/joint_states")).status == 0


def test_a_topic_of_another_kind_names_its_type(dynid):
    stamps = [1_460_000_000 * 10**9 + i * 10**7 for i in range(50)]
    messages = [
        ("/arm/joint_angles", ns, kinova("kinova_msgs/msg/JointAngles", [0.0] * 7)) for ns in stamps
    ]
    write_bag(dynid.folder / "log.bag", messages)
    run = dynid("check", "log.bag", "--robot", "kinova_gen2", "--topic", "/arm/joint_angles")
    refused(run, "E304", 3, "kinova_msgs/(msg/)?JointAngles", "joint state")


@pytest.mark.parametrize("kept", [20, 600])
def test_a_bag_of_which_nothing_can_be_read_is_refused(dynid, kept):
    (dynid.folder / "log.bag").write_bytes(BAG.read_bytes()[:kept])
    run = dynid(*lwr("log.bag"))
    assert (run.status, run.out) == (3, "")
    assert re.match(r"error\[E30[15]\] ", run.err), run.err
    assert len(run.err.splitlines()) <= 6


def test_a_bag_that_ends_early_is_read_as_far_as_it_goes(dynid):
    content = BAG.read_bytes()
    (dynid.folder / "log.bag").write_bytes(content[: int(0.9 * len(content))])
    run = dynid(*lwr("log.bag"))
    assert run.status == 0, run.err
    assert "warning[W305]" in run.err


def test_a_log_of_fewer_joints_than_the_robot_is_counted(dynid):
    messages = state_messages(200, [f"lwr_{i}_joint" for i in range(6)], topic="/lwr/joint_states")
    write_bag(dynid.folder / "log.bag", messages)
    refused(
        dynid(*lwr("log.bag")),
        "E310",
        3,
        "log.bag has 6 joints .*, KUKA LWR4\\+ has 7",
        "robot file",
    )


def test_a_torque_at_rest_where_nothing_weighs_is_worth_zeroing(dynid):
    twolink.write_arm(dynid.folder, twolink.ROBOT.replace("[0, -9.81, 0]", "[0, 0, -9.81]"))
    for zero, warned in ((0.0, False), (np.array([4.0, 0.0]), True)):
        twolink.write_log(dynid.folder / "log.csv", 1, poses(gravity=0, zero=zero))
        run = dynid(*CHECK)
        assert run.status == 0, run.err
        assert ("warning[W316] shoulder reads +4 Nm with the arm at rest" in run.err) is warned


# ---------------------------------------------------------------- what the data can tell
@pytest.mark.slow
def test_joints_that_hardly_move_apart_are_refused_until_they_are_dropped(arm):
    """The elbow follows the shoulder but for a millirad: all parameters show, most of them in noise.

    Without noise the same motion, of the same condition number, tells them all.
    """

    def nearly(columns, noise=1.0):
        t = columns["t"]
        waves = (np.sin(2 * t), 2 * np.cos(2 * t), -4 * np.sin(2 * t))
        apart = (np.sin(3 * t), 3 * np.cos(3 * t), -9 * np.sin(3 * t))
        for key, wave, own in zip(("q", "qd", "qdd"), waves, apart, strict=True):
            columns[key] = 0.6 * np.column_stack([wave, wave]) + 0.001 * np.column_stack(
                [0 * own, own]
            )
        columns["tau"] = twolink.torque(columns["q"], columns["qd"], columns.pop("qdd"))
        columns["tau"] += noise * np.random.default_rng(1).normal(size=columns["tau"].shape)
        return columns

    twolink.write_log(arm.folder / "clean.csv", 1, lambda columns: nearly(columns, 1e-6))
    run = arm("identify", "arm.yaml", "clean.csv", "-q", "--no-feasible", "-o", "clean")
    assert run.status == 0, run.err
    twolink.write_log(arm.folder / "log.csv", 1, nearly)
    refused(
        arm("identify", "arm.yaml", "log.csv", "-q", "--no-feasible"),
        "E402",
        4,
        r"condition number \d+ \(good: below 100\)",
        "dynid trajectory",
    )
    for more in (("--no-feasible", "--drop-weak"), ("--force",)):
        run = arm("identify", "arm.yaml", "log.csv", *more)
        assert run.status == 0, run.err
        assert "W402" in run.err


@pytest.mark.slow
def test_joints_that_move_together_leave_parameters_open_until_they_are_dropped(arm):
    """Both joints follow one sine: accelerations, speeds and poses are tied to each other."""

    def together(columns):
        t = columns["t"]
        for key, wave in (
            ("q", np.sin(2 * t)),
            ("qd", 2 * np.cos(2 * t)),
            ("qdd", -4 * np.sin(2 * t)),
        ):
            columns[key] = 0.6 * np.column_stack([wave, wave])
        columns["tau"] = twolink.torque(columns["q"], columns["qd"], columns.pop("qdd"))
        return columns

    twolink.write_log(arm.folder / "log.csv", 1, together)
    run = arm("identify", "arm.yaml", "log.csv")
    assert run.status in (0, 4)
    assert re.search(r"error\[E40[23]\]|warning\[W40[236]\]", run.err), run.err


@pytest.mark.slow
def test_the_training_log_is_no_validation_log(arm):
    assert arm("identify", "arm.yaml", "log.csv").status == 0
    words = ("validate", "out/arm/parameters.npz", "log.csv", "--no-plot")
    refused(arm(*words), "E405", 2, "log.csv was used to identify", "--allow-training-data")
    shutil.copy(arm.folder / "log.csv", arm.folder / "copy.csv")
    refused(arm(*words[:2], "copy.csv"), "E405", 2)
    assert arm(*words, "--allow-training-data").status == 0
    assert arm(*words[:2], "unseen.csv", "--no-plot").status == 0


# ---------------------------------------------------------------- decisions and versions
def test_a_result_of_a_newer_arm_is_not_guessed_at(arm):
    write_artifact(arm.folder / "p.npz", "dynid/identification/99", {"dynid": "9.9"}, {})
    refused(
        arm("validate", "p.npz", "unseen.csv"),
        "E320",
        3,
        r"written by dynid 9.9 \(schema 99\); this is",
        "upgrade",
    )


def test_a_result_that_is_none_is_refused(arm):
    (arm.folder / "p.npz").write_bytes(struct.pack("64x"))
    refused(arm("validate", "p.npz", "unseen.csv"), "E321", 3)
    refused(arm("validate", "nowhere.npz", "unseen.csv"), "E321", 3, "no such file")


@pytest.mark.parametrize("word", ["", " ", "[", "x" * 300, "\x00"[:0] + "ä/../ö"])
@pytest.mark.parametrize("words", [("model",), ("identify", "arm.yaml"), ("validate",), ("check",)])
def test_no_word_makes_a_traceback(arm, words, word):
    run = arm(*words, word, *(("log.csv",) if words == ("validate",) else ()))
    assert run.status in (2, 3, 6)
    assert "error[" in run.err
    assert len(run.err.splitlines()) <= 6
