"""``dynid gap`` from outside: its JSON keys, the copy of the robot file, and the effect that stays from then on."""

import shutil

import numpy as np
import pytest
import yaml

import twolink
from dynid import load_robot
from dynid.workflows.gap import robot_file_beside
from recorded_lwr import only, recorded, sharp
from runner import ROOT

#: One thread: several processes share the machine when all tests run.
ONE = {"OMP_NUM_THREADS": "1"}
KEYS = "schema robot verdict where named alternatives gap advice wrote"


@pytest.fixture(scope="module")
def shop(workshop):
    """A folder with logs of an LWR4+ with load-dependent friction on joint 4, its robot file and a first result."""
    run = workshop()
    shutil.copy(ROOT / "robots" / "kuka_lwr4plus.yaml", run.folder / "arm.yaml")

    def load_friction(t, q, qd, rigid):
        return only(3, 0.04 * np.abs(rigid[:, 3]) * sharp(qd[:, 3]))

    for k in range(6):
        one = recorded(k // 2, seconds=15.0, noise=10 + k, start=20.0 * k, added=load_friction)
        np.savez(run.folder / f"log{k + 1}.npz", t=one.t, q=one.q, tau=one.tau)
    line = "identify arm.yaml log1.npz log3.npz -q -o before --no-report"
    assert run(line).good
    return run.folder


@pytest.fixture
def logs(dynid, shop):
    """Names of the logs, which stand in the working folder with what was identified from them."""
    shutil.copytree(shop, dynid.folder, dirs_exist_ok=True)
    return sorted(path.name for path in dynid.folder.glob("log*.npz"))


@pytest.mark.slow
def test_gap_names_adds_and_the_tool_has_it_from_then_on(dynid, logs):
    some = "load_friction,position_friction,stribeck,spring,torque_gain,torque_crosstalk"
    line = f"gap before/parameters.npz --json --apply best -o after --effects {some}"
    answer = dynid(line, *logs, **ONE).facts
    assert set(answer) >= set(KEYS.split())
    assert (answer["schema"], answer["verdict"]) == ("dynid/gap/1", "named")
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
    assert dynid("report before -q").good
    page = (dynid.folder / "before" / "report.html").read_text()
    assert f"Position error in {driven['engine']}" in page

    own = f"after/{copy.name} {logs[0]} {logs[2]}"
    again = dynid(f"identify {own} --json -o with --no-report").facts
    values = {row["name"]: row["value"] for row in again["parameters"]}
    assert values["load_friction4_a"] == pytest.approx(entry["parameters"]["a"], rel=0.15)
    more = f"{logs[4]} --json --no-plot --allow-training-data"
    rms = [
        dynid(f"validate {name}/parameters.npz {more}").facts["joints"][3]["rms_nm"]
        for name in ("before", "with", "after")
    ]
    assert max(rms[1:]) < 0.8 * rms[0]


@pytest.mark.slow
def test_gap_without_a_terminal_reports_and_adds_nothing(dynid, logs):
    """What an earlier search left goes, what is somebody's own stays, and the page beside the result is made again."""
    before = dynid.folder / "before"
    (before / "gap").mkdir()
    names = "gap/effect_2_spring.png gap/simulator.png simulator_gap.npz"
    old = [before / name for name in names.split()]
    for path in (*old, before / "gap" / "own.png", before / "report.html"):
        path.write_text("old")
    line = "gap before/parameters.npz --effects load_friction,stribeck --joints 4 --no-plot"
    ended = dynid(line, *logs, **ONE).good
    assert ended.out.startswith("Missing effect on lwr_3_joint: friction that grows with the load")
    assert "(not asked: no terminal" in ended.err
    asked = "--effects load_friction,stribeck --joints 4 --apply best"
    assert asked in " ".join(ended.err.split()), "the next command does what was shown"
    assert not list(dynid.folder.glob("arm+*"))
    assert not any(path.exists() for path in old)
    assert (before / "gap" / "own.png").read_text() == "old"
    assert "friction that grows with the load" in (before / "report.html").read_text()


@pytest.mark.slow
def test_demo_finds_the_effect_that_it_hid(dynid):
    answer = dynid("demo --effect spring --seed 1 --json", **ONE).facts
    assert answer["right"]
    assert answer["gap"]["named"][0]["effect"] == "spring"
    assert (dynid.folder / "out/demo/effect/with_effect/parameters.npz").is_file()


def test_the_copy_of_a_robot_that_comes_with_dynid_is_not_hidden_among_installed_files(
    tmp_path, monkeypatch
):
    def beside(name):
        return robot_file_beside(load_robot(str(name)), []).resolve()

    monkeypatch.chdir(tmp_path)
    assert beside("kuka_lwr4plus") == tmp_path / "kuka_lwr4plus.yaml"
    own = tmp_path / "arm.yaml"
    own.write_text(twolink.ROBOT)
    assert beside(own) == own
