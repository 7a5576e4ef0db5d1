"""The likeliest mistakes, one row each: code, exit status, nothing on stdout, few lines, and a fix that works.

Rows of motions and of the arm itself stand with the commands that can make them.
"""

import re
import shutil
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

import twolink
from dynid.npz import write_artifact
from makelogs import kinova, state_messages, write_bag
from motions import pose_to_pose

ROOT = Path(__file__).parents[2]
BAG = ROOT / "trajectories/lwr4plus_validate.bag"
CHECK = "check arm.yaml log.csv"
IDENTIFY = "identify arm.yaml log.csv"


@dataclass(frozen=True)
class Mistake:
    """One row: what is spoilt, what is said, what repairs it.

    Attributes:
        code: of the error.
        says: pattern that the first line matches.
        line: the command.
        status: of the exit.
        robot: (old, new) text of arm.yaml that spoils it.
        log: spoils the columns of log.csv.
        fix: what the printed advice comes to: words to add, (old, new) text of arm.yaml, or None when only a new
            recording helps.
        advice: what the fix line holds; the words to add where there are any.
    """

    code: str
    says: str
    line: str = CHECK
    status: int = 3
    robot: tuple[str, str] | None = None
    log: object = None
    fix: str | tuple[str, str] | None = None
    advice: str = ""


def in_file(code, says, old, new, fix=None, advice=""):
    """Return a mistake in the robot file, which the old text repairs unless another fix is given."""
    line, fix = "check arm.yaml", fix or (new, old)
    return Mistake(code, says, line, robot=(old, new), fix=fix, advice=advice)


def above_joints(line):
    return "joints:", f"{line}\njoints:"


def in_units(code, says, units, log):
    """Return a mistake that the units of a driver repair."""
    fix = above_joints(f"driver: {{kind: generic, units: {{{units}}}}}")
    return Mistake(code, says, log=log, fix=fix, advice=units)


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


def keep(rows):
    """Return a function that keeps some rows of all columns."""
    return lambda columns: {key: values[rows] for key, values in columns.items()}


def poses(gravity=1.0, zero=0.0):
    """Return a change to a log of forty poses with rests between, with weight or without, a sensor zeroed or not."""

    def change(columns):
        t, q, qd, qdd = pose_to_pose(np.random.default_rng(4).uniform(-1, 1, (41, 2)))
        weight = twolink.torque(q, 0 * q, 0 * q)
        tau = twolink.torque(q, qd, qdd) - (1 - gravity) * weight + zero
        return {"t": t, "q": q, "qd": qd, "tau": tau}

    return change


ROWS = [
    in_file(
        "E201",
        r"arm.yaml:2: unknown key 'convetion'; did you mean 'convention'\?",
        "convention",
        "convetion",
    ),
    in_file(
        "E202",
        r"arm.yaml:\d+: joints\[0\].twist = 90 rad is more than a full turn",
        "shoulder, a: 0.4",
        "shoulder, twist: 90, a: 0.4",
        ("convention:", "angle_unit: deg\nconvention:"),
        "angle_unit: deg",
    ),
    in_file("E203", r"joints\[1\].a = '3e-1' is text in YAML; write 3.0e-1", "a: 0.3", "a: 3e-1"),
    in_file("E203", r"joints\[1\].a", "a: 0.3", "a: 0x"),
    in_file(
        "E204",
        "standard or modified",
        "convention: standard\n",
        "",
        ("name: arm", "name: arm\nconvention: standard"),
        "convention: standard",
    ),
    in_file("E206", r"981 m/s\^2", "-9.81", "-981"),
    in_file(
        "E207",
        "arm.yaml:2: key 'name' is given twice",
        "name: arm\n",
        "name: arm\nname: arm\n",
    ),
    Mistake("E205", r"no robot 'kinova_gen'; did you mean 'kinova_gen2'\?", "model kinova_gen", 2),
    Mistake("E301", r"no such file logg.csv; nearby: log.csv", "check arm.yaml logg.csv"),
    Mistake("E301", r"no such file logg.csv; nearby: log.csv", "identify arm.yaml logg.csv"),
    Mistake(
        "E306",
        r"elbow torque is not a number in 12 samples, first at t = 3.000 s \(row 301\)",
        log=spoil("tau", put(slice(300, 312), 1, np.nan)),
        fix="--exclude 2.999-3.111",
    ),
    in_units(
        "E307",
        r"position spans .*degrees\? limits are \+-3.00 rad",
        "position: deg, velocity: deg/s",
        lambda c: {**c, "q": np.degrees(c["q"]), "qd": np.degrees(c["qd"])},
    ),
    in_units(
        "E308",
        r"shoulder velocity is 57.\d x the change of position: deg/s",
        "velocity: deg/s",
        spoil("qd", np.degrees),
    ),
    Mistake(
        "E308",
        "elbow velocity has the opposite sign",
        IDENTIFY,
        log=spoil("qd", lambda v: v * [1, -1]),
        fix="--velocity derived",
    ),
    Mistake(
        "E309",
        "log.csv names shoulder, elbow; the robot file expects schulter, elbow",
        robot=("name: shoulder", "name: schulter"),
        fix=above_joints("driver: {kind: generic, joint_names: [shoulder, elbow]}"),
        advice="joint_names: [shoulder, elbow]",
    ),
    Mistake(
        "E309",
        r"shoulder and elbow look swapped \(correlation",
        IDENTIFY,
        log=spoil("qd", lambda v: v[:, ::-1]),
        fix="--velocity derived",
    ),
    Mistake(
        "E311",
        r"time goes back 4.99 s at row 1501 \(t = 14.99 s\): two recordings joined\?",
        log=spoil("t", lambda t: t - 5 * (np.arange(len(t)) >= 1500)),
        fix="--exclude 10.000-14.990",
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
        fix=above_joints("torque: {source: gravity_free}"),
        advice="gravity_free",
    ),
    in_units(
        "E318",
        r"torque reaches .*: mNm\? rating 60 Nm",
        "effort: mNm",
        spoil("tau", lambda v: 1000 * v),
    ),
    Mistake(
        "E401",
        "elbow moves 0 rad: its 4 own parameters cannot be found",
        status=4,
        log=lambda c: {**c, "q": c["q"] * [1, 0] + [0, 0.3], "qd": c["qd"] * [1, 0]},
    ),
]


@pytest.mark.parametrize("row", ROWS, ids=lambda row: f"{row.code}-{row.line.split()[0]}")
def test_a_mistake_gives_its_code_its_status_and_advice_that_works(arm, row):
    file, words = arm.folder / "arm.yaml", isinstance(row.fix, str)
    if row.robot:
        file.write_text(file.read_text().replace(*row.robot, 1))
    if row.log:
        twolink.write_log(arm.folder / "log.csv", 1, row.log)
    advice = row.fix if words else row.advice
    refused(arm(row.line), row.code, row.status, row.says, advice)
    if row.fix is None:
        return
    if not words:
        file.write_text(file.read_text().replace(*row.fix, 1))
    again = arm(f"{row.line} {row.fix if words else ''}")
    assert f"error[{row.code}]" not in again.err
    assert again.status == 0, again.err


def refused(run, code, status=3, says=".", advice=""):
    assert run.err.startswith(f"error[{code}] ") or f"\nerror[{code}] " in run.err, run.err
    assert (run.status, run.out) == (status, "")
    lines = run.err[run.err.index("error[") :].splitlines()
    assert len(run.err.splitlines()) <= 6
    assert re.search(says, lines[0]), lines[0]
    (fix,) = [line for line in lines if line.startswith("  fix ")]
    assert advice in fix


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
    run = arm(CHECK)
    assert run.status == 0
    assert re.search(rf"warning\[{code}\] {says}", run.err), run.err
    assert arm(f"{CHECK} --strict").status == 1


def test_gravity_that_points_up_is_a_warning_when_the_mount_is_not_said(arm):
    file = arm.folder / "arm.yaml"
    file.write_text(file.read_text().replace("[0, -9.81, 0]", "[0, 0, 9.81]"))
    run = arm("check arm.yaml")
    assert run.status == 0
    assert "warning[W206]" in run.err
    file.write_text(file.read_text() + "mount: ceiling\n")
    assert "W206" not in arm("check arm.yaml").err


def believed(arm, *bodies):
    """Write links to the robot file instead of its prior."""
    file = arm.folder / "arm.yaml"
    text = re.sub(r"\nprior:.*", "", file.read_text(), flags=re.DOTALL)
    file.write_text(f"{text}\nprior:\n  links:\n" + "".join(f"    - {body}\n" for body in bodies))


def test_an_inertia_that_no_body_has_is_said_before_a_log_is_recorded(arm):
    odd = "inertia_com: {ixx: 0.01, iyy: 0.01, izz: 0.05}"
    believed(arm, "{mass: 3, com: [-0.2, 0, 0]}", f"{{mass: 2, com: [-0.1, 0, 0], {odd}}}")
    run = arm("check arm.yaml")
    assert run.status == 0
    assert "0.01, 0.01, 0.05 kg m^2" in run.err
    assert run.err.count("warning[W207]") == run.err.count("W207") == 1


@pytest.mark.slow
def test_masses_and_centres_alone_are_a_prior(arm):
    believed(arm, "{mass: 3, com: [-0.2, 0, 0]}", "{mass: 0}")
    run = arm("identify arm.yaml log.csv --no-input --json")
    assert run.status == 0
    assert "E404" not in run.err


# ---------------------------------------------------------------- bags
def test_a_topic_that_is_not_there_lists_those_that_are(dynid):
    line = f"check {BAG} --robot kuka_lwr4plus --topic"
    refused(dynid(f"{line} /joint_state"), "E303", 3, "/lwr/joint_states", "--topic")
    assert dynid(f"{line} /lwr/joint_states").status == 0
    refused(dynid(f"check {BAG} --robot kinova_gen2"), "E303", 3, "/lwr/joint_states", "--topic")


def test_a_topic_of_another_kind_names_its_type(dynid):
    stamps = [1_460_000_000 * 10**9 + i * 10**7 for i in range(50)]
    messages = [
        ("/arm/joint_angles", ns, kinova("kinova_msgs/msg/JointAngles", [0.0] * 7)) for ns in stamps
    ]
    write_bag(dynid.folder / "log.bag", messages)
    run = dynid("check log.bag --robot kinova_gen2 --topic /arm/joint_angles")
    refused(run, "E304", 3, "kinova_msgs/(msg/)?JointAngles", "joint state")


@pytest.mark.parametrize(
    ("name", "content", "code"),
    [
        ("log.bag", BAG.read_bytes()[:20], "E305"),
        ("log.bag", BAG.read_bytes()[:600], "E305"),
        ("notes.txt", b"no log\n", "E301"),
        ("log.csv", b"t,q_shoulder,q_elbow\n0,1,2\n0.1,2,3\n", "E322"),
    ],
)
def test_a_file_of_which_nothing_can_be_read_is_refused(arm, name, content, code):
    (arm.folder / name).write_bytes(content)
    refused(arm(f"check {name} --robot arm.yaml"), code)


def test_a_bag_that_ends_early_is_read_as_far_as_it_goes(dynid):
    content = BAG.read_bytes()
    (dynid.folder / "log.bag").write_bytes(content[: int(0.9 * len(content))])
    run = dynid("check log.bag --robot kuka_lwr4plus")
    assert run.status == 0, run.err
    assert "warning[W305]" in run.err


def test_a_log_of_fewer_joints_than_the_robot_is_counted(dynid):
    messages = state_messages(200, [f"lwr_{i}_joint" for i in range(6)], topic="/lwr/joint_states")
    write_bag(dynid.folder / "log.bag", messages)
    refused(
        dynid("check log.bag --robot kuka_lwr4plus"),
        "E310",
        3,
        "log.bag has 6 joints .*, KUKA LWR4\\+ has 7",
        "robot file",
    )


def test_a_torque_at_rest_where_nothing_weighs_is_worth_zeroing(dynid):
    twolink.write_arm(dynid.folder, twolink.ROBOT.replace("[0, -9.81, 0]", "[0, 0, -9.81]"))
    for zero, warned in ((0.0, False), (np.array([4.0, 0.0]), True)):
        twolink.write_log(dynid.folder / "log.csv", 1, poses(gravity=0, zero=zero))
        run = dynid(CHECK)
        assert run.status == 0, run.err
        assert ("warning[W316] shoulder reads +4 Nm with the arm at rest" in run.err) is warned


# ---------------------------------------------------------------- what the data can tell
def waving(apart, noise=0.0):
    """Return a change to a log of joints that follow one sine, the elbow ``apart`` [rad] from it."""

    def change(columns):
        t, both, elbow = columns["t"], np.array([0.6, 0.6]), np.array([0, apart])
        for k, key in enumerate(("q", "qd", "qdd")):
            waves = ((w**k * np.sin(w * t + k * np.pi / 2))[:, None] for w in (2, 3))
            columns[key] = sum(wave * size for wave, size in zip(waves, (both, elbow), strict=True))
        columns["tau"] = twolink.torque(columns["q"], columns["qd"], columns.pop("qdd"))
        columns["tau"] += noise * np.random.default_rng(1).normal(size=columns["tau"].shape)
        return columns

    return change


@pytest.mark.slow
def test_joints_that_hardly_move_apart_are_refused_until_they_are_dropped(arm):
    """The elbow follows the shoulder but for a millirad: all parameters show, most of them in noise.

    Without noise the same motion, of the same condition number, tells them all.
    """
    twolink.write_log(arm.folder / "clean.csv", 1, waving(0.001, 1e-6))
    run = arm("identify arm.yaml clean.csv -q --no-feasible -o clean")
    assert run.status == 0, run.err
    twolink.write_log(arm.folder / "log.csv", 1, waving(0.001, 1.0))
    says = r"condition number \d+ \(good: below 100\)"
    refused(arm(f"{IDENTIFY} -q --no-feasible"), "E402", 4, says, "dynid trajectory")
    for more in ("--no-feasible --drop-weak", "--force"):
        run = arm(f"{IDENTIFY} {more}")
        assert run.status == 0, run.err
        assert "W402" in run.err


@pytest.mark.slow
def test_joints_that_move_together_leave_parameters_open_until_they_are_dropped(arm):
    """Both joints follow one sine: accelerations, speeds and poses are tied to each other."""
    twolink.write_log(arm.folder / "log.csv", 1, waving(0))
    run = arm(IDENTIFY)
    assert run.status in (0, 4)
    assert re.search(r"error\[E40[23]\]|warning\[W40[236]\]", run.err), run.err


@pytest.mark.slow
def test_the_training_log_is_no_validation_log(arm):
    assert arm(IDENTIFY).status == 0
    line, allowed = "validate out/arm/parameters.npz", "--allow-training-data"
    refused(arm(f"{line} log.csv"), "E405", 2, "log.csv was used to identify", allowed)
    shutil.copy(arm.folder / "log.csv", arm.folder / "copy.csv")
    refused(arm(f"{line} copy.csv"), "E405", 2)
    assert arm(f"{line} log.csv --no-plot {allowed}").status == 0
    assert arm(f"{line} unseen.csv --no-plot").status == 0


# ---------------------------------------------------------------- decisions and versions
def test_a_result_of_a_newer_dynid_or_of_none_is_not_guessed_at(arm):
    write_artifact(arm.folder / "p.npz", "dynid/identification/99", {"dynid": "9.9"}, {})
    says = r"written by dynid 9.9 \(schema 99\); this is"
    refused(arm("validate p.npz unseen.csv"), "E320", 3, says, "upgrade")
    (arm.folder / "p.npz").write_bytes(bytes(64))
    refused(arm("validate p.npz unseen.csv"), "E321")
    refused(arm("validate nowhere.npz unseen.csv"), "E321", 3, "no such file")


@pytest.mark.parametrize("word", ["", " ", "[", "x" * 300, "ä/../ö"])
@pytest.mark.parametrize("line", ["model", "identify arm.yaml", "validate", "check"])
def test_no_word_makes_a_traceback(arm, line, word):
    run = arm(line, word, *["log.csv"] * (line == "validate"))
    assert run.status in (2, 3, 6)
    assert "error[" in run.err
    assert len(run.err.splitlines()) <= 6
