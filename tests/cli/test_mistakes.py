"""The likeliest mistakes, one row each: code, exit status, nothing on stdout, few lines, and a fix that works.

Rows of motions and of the arm itself stand with the commands that can make them.
"""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml

import twolink
from dynid.npz import write_artifact
from makelogs import state_messages, write_bag
from motions import pose_to_pose

ROOT = Path(__file__).parents[2]
BAG = ROOT / "trajectories/lwr4plus_validate.bag"
CHECK = "check arm.yaml log.csv"
IDENTIFY = "identify arm.yaml log.csv"


def spoil(key, change):
    """Return a function that replaces one kind of column."""
    return lambda columns: {**columns, key: change(columns[key])}


def keep(some):
    """Return a function that keeps some rows of all columns."""
    return lambda columns: {key: values[some] for key, values in columns.items()}


def without_twelve_torques(columns):
    columns["tau"][300:312, 1] = np.nan


def poses(gravity=1.0, zero=0.0):
    """Return a change to a log of forty poses with rests between, with weight or without, a sensor zeroed or not."""

    def change(columns):
        t, q, qd, qdd = pose_to_pose(np.random.default_rng(4).uniform(-1, 1, (41, 2)))
        weight = twolink.torque(q, 0 * q, 0 * q)
        tau = twolink.torque(q, qd, qdd) - (1 - gravity) * weight + zero
        return {"t": t, "q": q, "qd": qd, "tau": tau}

    return change


SPOILT = {
    "holes": without_twelve_torques,
    "degrees": lambda c: {**c, "q": np.degrees(c["q"]), "qd": np.degrees(c["qd"])},
    "speeds in degrees": spoil("qd", np.degrees),
    "a speed reversed": spoil("qd", lambda v: v * [1, -1]),
    "speeds swapped": spoil("qd", lambda v: v[:, ::-1]),
    "joined": spoil("t", lambda t: t - 5 * (np.arange(len(t)) >= 1500)),
    "a tenth lost": keep(np.flatnonzero(np.arange(2000) % 200 < 180)),
    "short": keep(slice(0, 60)),
    "slow": keep(slice(None, None, 20)),
    "weightless": poses(gravity=0),
    "poses alone": spoil("q", lambda q: np.repeat(q[50::100], 100, axis=0)),
    "thousandfold": spoil("tau", lambda v: 1000 * v),
    "elbow stands": lambda c: {**c, "q": c["q"] * [1, 0] + [0, 0.3], "qd": c["qd"] * [1, 0]},
    "a gap": keep(np.r_[0:600, 630:2000]),
    "clipped": spoil("tau", lambda v: np.clip(v, -12, 12)),
}
MISTAKES = yaml.safe_load(Path(__file__).with_name("mistakes.yaml").read_text())


@pytest.mark.parametrize("row", MISTAKES, ids=lambda row: row["code"])
def test_a_mistake_gives_its_code_and_advice_that_works_and_a_warning_lets_the_work_go_on(arm, row):
    file, line, fix = arm.folder / "arm.yaml", row.get("line", CHECK), row.get("fix", "")
    file.write_text(file.read_text().replace(*row.get("robot", ("", "")), 1))
    if "log" in row:
        twolink.write_log(arm.folder / "log.csv", 1, SPOILT[row["log"]])
    words, edit = (fix, ("", "")) if isinstance(fix, str) else ("", fix)
    run, code, says, advice = arm(line), row["code"], row["says"], row.get("advice", words)
    if code.startswith("E"):
        refused(run, code, row.get("status", 3), says, advice)
    else:
        assert re.search(rf"warning\[{code}\] {says}", run.good.err), run.err
        assert arm(f"{line} --strict").status == 1
    file.write_text(file.read_text().replace(*edit, 1))
    if fix:
        assert f"[{code}]" not in arm(f"{line} {words}").good.err


def refused(run, code, status=3, says=".", advice=""):
    assert run.err.startswith(f"error[{code}] ") or f"\nerror[{code}] " in run.err, run.err
    assert (run.status, run.out) == (status, "")
    lines = run.err[run.err.index("error[") :].splitlines()
    assert len(run.err.splitlines()) <= 6
    assert re.search(says, lines[0]), lines[0]
    (fix,) = [line for line in lines if line.startswith("  fix ")]
    assert advice in fix


# ---------------------------------------------------------------- warnings: said, and the work goes on
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
