"""``dynid gap`` from outside: its JSON keys, the copy of the robot file, and the effect that stays from then on."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest
import yaml

import hidden_effects as hidden
import twolink

ROOT = Path(__file__).parents[2]

#: One thread: several processes share the machine when all tests run.
ONE = {"OMP_NUM_THREADS": "1"}
KEYS = {"schema", "robot", "verdict", "where", "named", "alternatives", "gap", "advice", "wrote"}


@pytest.fixture(scope="module")
def shop(tmp_path_factory, runner):
    """A folder with logs of an LWR4+ with load-dependent friction on joint 4, its robot file and a first result."""
    folder = tmp_path_factory.mktemp("gap")
    (folder / "work").mkdir()
    (folder / "work" / "arm.yaml").write_text((ROOT / "robots" / "kuka_lwr4plus.yaml").read_text())
    case = hidden.Case("lwr4plus", "load_friction", 3, 3.0, 22)
    for k, (t, q, tau) in enumerate(hidden.simulate(case, seconds=15.0)):
        np.savez(folder / "work" / f"log{k + 1}.npz", t=t, q=q, tau=tau)
    run = runner(folder / "work", folder)
    assert (
        run(
            "identify", "arm.yaml", "log1.npz", "log3.npz", "-q", "-o", "before", "--no-report"
        ).status
        == 0
    )
    return run.folder


@pytest.fixture
def logs(dynid, shop):
    """Names of the logs, which stand in the working folder with what was identified from them."""
    shutil.copytree(shop, dynid.folder, dirs_exist_ok=True)
    return sorted(path.name for path in dynid.folder.glob("log*.npz"))


@pytest.mark.slow
def test_gap_names_adds_and_the_tool_has_it_from_then_on(dynid, logs):
    some = "load_friction,position_friction,stribeck,spring,torque_gain,torque_crosstalk"
    ended = dynid(
        "gap",
        "before/parameters.npz",
        *logs,
        "--json",
        "--apply",
        "best",
        "-o",
        "after",
        "--effects",
        some,
        **ONE,
    )
    assert ended.status == 0, ended.err
    answer = json.loads(ended.out)
    assert set(answer) >= KEYS
    assert answer["schema"] == "dynid/gap/1"
    assert answer["verdict"] == "named"
    (named,) = answer["named"]
    assert (named["effect"], named["joints"]) == ("load_friction", ["lwr_3_joint"])
    assert set(named["parameters"]["a"]) == {"value", "unit", "std_error"}
    assert named["heldout_rms_after_nm"] < 0.8 * named["heldout_rms_before_nm"]
    gap = answer["gap"]
    assert len(gap["heldout_before_nm"]) == len(gap["noise_floor_nm"]) == 7
    worst = max(answer["where"], key=lambda w: w["share"])
    assert worst["joint"] == "lwr_3_joint"
    copy = dynid.folder / "after" / "arm+load_friction4.yaml"
    (entry,) = yaml.safe_load(copy.read_text())["effects"]
    assert entry["effect"] == "load_friction"
    assert "# KUKA LWR4+" in copy.read_text(), "comments of the robot file stay"
    assert (dynid.folder / "before" / "gap" / "where.png").is_file()

    driven = answer["simulator"]
    (before, after) = (model["position_rms_rad"][3] for model in driven["models"])
    assert after < before, "the exported file with the effect strays less in the simulator"
    assert (dynid.folder / "before" / "gap" / "simulator.png").is_file()
    assert dynid("report", "before", "-q").status == 0
    page = (dynid.folder / "before" / "report.html").read_text()
    assert f"Position error in {driven['engine']}" in page

    own = f"after/{copy.name}"
    again = json.loads(
        dynid("identify", own, logs[0], logs[2], "--json", "-o", "with", "--no-report").out
    )
    values = {row["name"]: row["value"] for row in again["parameters"]}
    assert values["load_friction4_a"] == pytest.approx(entry["parameters"]["a"], rel=0.15)
    before = json.loads(
        dynid("validate", "before/parameters.npz", logs[4], "--json", "--no-plot").out
    )
    after = json.loads(dynid("validate", "with/parameters.npz", logs[4], "--json", "--no-plot").out)
    kept = json.loads(
        dynid(
            "validate",
            "after/parameters.npz",
            logs[4],
            "--json",
            "--no-plot",
            "--allow-training-data",
        ).out
    )
    rms = [answer["joints"][3]["rms_nm"] for answer in (before, after, kept)]
    assert rms[1] < 0.8 * rms[0]
    assert rms[2] < 0.8 * rms[0]


@pytest.mark.slow
def test_gap_without_a_terminal_reports_and_adds_nothing(dynid, logs):
    """What an earlier search left goes, what is somebody's own stays, and the page beside the result is made again."""
    before = dynid.folder / "before"
    (before / "gap").mkdir()
    old = [
        before / name
        for name in ("gap/effect_2_spring.png", "gap/simulator.png", "simulator_gap.npz")
    ]
    for path in (*old, before / "gap" / "own.png", before / "report.html"):
        path.write_text("old")
    ended = dynid(
        "gap",
        "before/parameters.npz",
        *logs,
        "--effects",
        "load_friction,stribeck",
        "--joints",
        "4",
        "--no-plot",
        **ONE,
    )
    assert ended.status == 0, ended.err
    assert ended.out.startswith("lwr_3_joint: friction that grows with the load")
    assert "(not asked: no terminal" in ended.err
    assert not list(dynid.folder.glob("arm+*"))
    assert not any(path.exists() for path in old)
    assert (before / "gap" / "own.png").read_text() == "old"
    assert "friction that grows with the load" in (before / "report.html").read_text()


def test_gap_with_an_unknown_effect_suggests_one(dynid, logs):
    ended = dynid("gap", "before/parameters.npz", logs[0], "--effects", "stribek")
    assert ended.status == 2
    assert "did you mean 'stribeck'" in ended.err


def test_gap_without_logs_says_what_is_needed(dynid):
    ended = dynid("gap")
    assert ended.status == 2
    assert "PARAMETERS" in ended.err


@pytest.mark.slow
def test_gap_with_a_kept_model_names_the_payload_that_is_new(dynid):
    (dynid.folder / "arm.yaml").write_text((ROOT / "robots" / "kuka_lwr4plus.yaml").read_text())

    def record(name, case, **options):
        for k, (t, q, tau) in enumerate(hidden.simulate(case, seconds=15.0, **options)):
            np.savez(dynid.folder / f"{name}{k + 1}.npz", t=t, q=q, tau=tau)

    record(
        "old",
        hidden.Case("lwr4plus", "payload", 2, 0.0, 40),
        trajectories=2,
        repeats=1,
        plan_seed=7,
    )
    record("new", hidden.Case("lwr4plus", "payload", 2, 3.0, 41), trajectories=2)
    assert (
        dynid(
            "identify", "arm.yaml", "old1.npz", "old2.npz", "-q", "-o", "before", "--no-report"
        ).status
        == 0
    )
    some = "payload,tool_force,torque_offset,coulomb_change,base_tilt"
    logs = [f"new{k}.npz" for k in (1, 2, 3, 4)]
    options = ("--mode", "frozen", "--effects", some, "--no-apply", "--json", "--no-plot")
    ended = dynid("gap", "before/parameters.npz", *logs, *options, **ONE)
    assert ended.status == 0, ended.err
    (named,) = json.loads(ended.out)["named"]
    assert named["effect"] == "payload"
    # Case 3.0 hangs a ball of 10 * 3.0 * 0.02 kg on the last link.
    assert named["parameters"]["m"]["value"] == pytest.approx(0.6, rel=0.05)


@pytest.mark.slow
def test_demo_finds_the_effect_that_it_hid(dynid):
    ended = dynid("demo", "--effect", "spring", "--seed", "1", "--json", **ONE)
    assert ended.status == 0, ended.err
    answer = json.loads(ended.out)
    assert answer["right"]
    assert answer["gap"]["named"][0]["effect"] == "spring"
    assert Path(
        dynid.folder / "out" / "demo" / "effect" / "with_effect" / "parameters.npz"
    ).is_file()


def test_demo_names_what_can_be_hidden(dynid):
    ended = dynid("demo", "--effect", "sprng")
    assert ended.status == 2
    assert "did you mean 'spring'" in ended.err


def test_the_copy_of_a_robot_that_comes_with_dynid_is_not_hidden_among_installed_files(
    tmp_path, monkeypatch
):
    from dynid.files.robotfile import load_robot
    from dynid.workflows.gap_result import robot_file_beside

    monkeypatch.chdir(tmp_path)
    assert (
        robot_file_beside(load_robot("kuka_lwr4plus"), []).resolve()
        == tmp_path / "kuka_lwr4plus.yaml"
    )
    (tmp_path / "robots").mkdir()
    assert (
        robot_file_beside(load_robot("kuka_lwr4plus"), []).resolve().parent == tmp_path / "robots"
    )
    own = tmp_path / "mine" / "arm.yaml"
    own.parent.mkdir()
    own.write_text(twolink.ROBOT)
    assert robot_file_beside(load_robot(str(own)), []) == own
