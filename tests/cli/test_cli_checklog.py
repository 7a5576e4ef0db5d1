"""check on logs: what it says, what it writes, what it refuses."""

import json
from pathlib import Path

import numpy as np
import pytest

from dynid.files.logs import read_npz_log

ROOT = Path(__file__).parents[2]
BAG = ROOT / "trajectories/lwr4plus_identify.bag"
ROBOT = """name: arm
convention: standard
joints:
  - {name: shoulder, twist: 90 deg, limits: {velocity: 3, torque: 40}}
  - {name: elbow, a: 0.4, limits: {velocity: 3, torque: 40}}
"""


@pytest.fixture
def arm(dynid):
    """A folder with a two-joint arm and a way to write logs of it."""
    (dynid.folder / "arm.yaml").write_text(ROBOT)
    t = np.arange(0, 30, 0.01)
    q = np.column_stack(
        [
            0.8 * np.sin(1.1 * t) + 0.3 * np.sin(2.7 * t),
            0.7 * np.cos(1.3 * t) + 0.3 * np.sin(2.1 * t),
        ]
    )
    tau = 4 * np.cos(q) + 0.3 * np.gradient(q, t, axis=0)

    def write(change=None, name="log.csv"):
        values = {"t": t.copy(), "q": q.copy(), "tau": tau.copy()}
        if change:
            change(values)
        columns = np.column_stack([values["t"], values["q"], values["tau"]])
        header = "t,q_shoulder,q_elbow,tau_shoulder,tau_elbow"
        np.savetxt(
            dynid.folder / name, columns, delimiter=",", header=header, comments="", fmt="%.9g"
        )

    dynid.write = write
    return dynid


@pytest.mark.slow
def test_check_describes_a_bag(dynid):
    done = dynid("check", str(BAG), "--robot", "kuka_lwr4plus", "--json")
    assert done.status == 0, done.err
    (checked,) = json.loads(done.out)["checked"]
    assert (checked["kind"], checked["samples"]) == ("log", 8000)
    assert checked["rate_hz"] == pytest.approx(200, rel=0.01)
    assert checked["duration_s"] == pytest.approx(40, rel=0.01)
    assert len(checked["position_span_rad"]) == len(checked["torque_max_nm"]) == 7


def test_a_log_without_a_robot_says_what_it_holds(dynid):
    done = dynid("check", str(BAG))
    assert done.status == 0, done.err
    assert "/lwr/joint_states  sensor_msgs/JointState, " in done.out
    assert "joint_names: [lwr_0_joint, lwr_1_joint" in done.out


def test_the_robot_file_among_the_paths_serves_the_logs(arm):
    arm.write()
    done = arm("check", "arm.yaml", "log.csv")
    assert done.status == 0, done.err
    assert "matched by name: shoulder, elbow" in done.out


@pytest.mark.slow
def test_convert_writes_a_log_that_reads_back_and_is_reused(dynid):
    words = ("check", str(BAG), "--robot", "kuka_lwr4plus", "--convert")
    done = dynid(*words)
    assert done.status == 0, done.err
    path = dynid.folder / "out/kuka_lwr4plus/log.npz"
    assert f"wrote      {path.relative_to(dynid.folder)}" in done.err
    assert len(read_npz_log(path)) == 8000
    assert dynid(*words).err.startswith("reused")
    again = dynid("check", str(path), "--robot", "kuka_lwr4plus", "--json")
    assert json.loads(again.out)["checked"][0]["samples"] == 8000


def test_fix_repairs_without_loss_and_lists_each_repair(arm):
    def turn(values):
        values["q"][1500:, 1] += 2 * np.pi

    arm.write(turn)
    done = arm("check", "arm.yaml", "log.csv", "--fix")
    assert done.status == 0, done.err
    assert "warning[W315]" in done.err
    log = read_npz_log(arm.folder / "out/arm/log.npz")
    assert np.abs(np.diff(log.q[:, 1])).max() < 0.1


@pytest.mark.parametrize(
    ("change", "code"),
    [
        (lambda v: v["tau"].__setitem__((slice(300, 312), 1), np.nan), "E306"),
        (lambda v: v["t"].__setitem__(slice(1500, None), v["t"][1500:] - 5), "E311"),
        (lambda v: v["tau"].__setitem__((slice(None), 0), v["tau"][:, 0] * 1000), "E318"),
        (lambda v: v["q"].__setitem__((slice(None), 1), 0.3), "E401"),
    ],
)
def test_a_faulty_log_gives_its_code_and_writes_nothing(arm, change, code):
    arm.write(change)
    done = arm("check", "arm.yaml", "log.csv", "--convert")
    assert done.out == ""
    assert done.err.startswith(f"error[{code}]"), done.err
    assert done.status == (4 if code[1] == "4" else 3)
    assert len(done.err.splitlines()) <= 6
    assert not (arm.folder / "out").exists()


def test_exclude_leaves_the_fault_out(arm):
    arm.write(lambda v: v["tau"].__setitem__((slice(300, 312), 1), np.nan))
    assert arm("check", "arm.yaml", "log.csv", "--exclude", "2.9-3.2").status == 0


@pytest.mark.parametrize("word", ["5-3", "now", "3.2", "1-nan"])
def test_a_stretch_that_is_none_is_wrong_usage(arm, word):
    arm.write()
    assert arm("check", "arm.yaml", "log.csv", "--exclude", word).status == 2


def test_a_missing_log_names_what_is_near(arm):
    arm.write(name="log2.csv")
    done = arm("check", "log1.csv", "--robot", "arm.yaml")
    assert done.status == 3
    assert done.err.startswith("error[E301]")
    assert "nearby: log2.csv" in done.err
    assert arm("check", "log1.csv").status == 3


def test_a_wrong_topic_lists_those_of_the_bag(dynid):
    done = dynid("check", str(BAG), "--robot", "kuka_lwr4plus", "--topic", "/lwr/joint_state")
    assert done.status == 3
    assert done.err.startswith("error[E303]")
    assert "/lwr/joint_states" in done.err
