"""export, import, compare and run from outside: what they write, say and return."""

import csv
import html
import json
import re
import shutil
import subprocess
import sys
import xml.etree.ElementTree as ET
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from dynid.estimation.result_files import load
from dynid.loading import load_run
from dynid.workflows.model import base_model_of

IDENTIFY = Path(__file__).parents[2] / "trajectories" / "lwr4plus_identify.bag"
INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
URDF = f"""<robot name="two"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
<link name="one"><inertial><mass value="2"/>{INERTIA}</inertial></link>
<joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
</joint><link name="two"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>{INERTIA}</inertial></link></robot>"""


@pytest.fixture(scope="module")
def shop(tmp_path_factory, runner):
    """A folder with a result of the shipped log, the same log as npz, and one with a torque column scaled by 1.02."""
    folder = tmp_path_factory.mktemp("shop")
    (folder / "home").mkdir()
    run = runner(folder, folder / "home")
    assert (
        run("check", str(IDENTIFY), "--robot", "kuka_lwr4plus", "--convert", "-o", "log").status
        == 0
    )
    with np.load(folder / "log" / "log.npz") as archive:
        arrays = dict(archive)
    arrays["tau"] = arrays["tau"] * np.array([1, 1, 1.02, 1, 1, 1, 1])
    np.savez(folder / "scaled.npz", **arrays)
    assert run("identify", "kuka_lwr4plus", str(IDENTIFY), "-o", "out/arm").status == 0
    return run


@pytest.mark.slow
def test_code_is_exported_compiled_and_compared(shop):
    """C and Python need no bodies; their torques differ by rounding."""
    done = shop("export", "out/arm", "--format", "c", "--format", "python", "--json")
    answer = json.loads(done.out)
    assert (done.status, answer["schema"]) == (0, "dynid/export/1")
    checks = [check for file in answer["files"] for check in file["checks"]]
    assert [(check["engine"], check["agrees"], check["states"]) for check in checks] == [
        ("cc", True, 1000),
        ("NumPy", True, 1000),
    ]
    assert max(check["largest_difference_nm"] for check in checks) < 1e-10
    assert answer["wrote"] == ["out/arm/kuka_lwr4plus.c", "out/arm/kuka_lwr4plus.py"]
    script = "import kuka_lwr4plus as arm; print(*arm.inverse_dynamics([0.3]*7, [0.2]*7, [0.1]*7).tolist())"
    alone = subprocess.run(
        [sys.executable, "-c", script], cwd=shop.folder / "out/arm", capture_output=True, text=True
    )
    stored = load_run(shop.folder / "out/arm")
    observer = base_model_of(stored).model.observer(stored.reduction.base)
    state = (np.full((1, 7), value) for value in (0.3, 0.2, 0.1))
    expected = observer.torque(stored.theta, *state)[0]
    np.testing.assert_allclose([float(word) for word in alone.stdout.split()], expected, atol=1e-10)


def test_the_physical_set_is_accepted_by_every_simulator_and_the_plain_one_refused(shop):
    """All formats agree within 1e-6 N m; bodies that cannot exist need --allow-infeasible and are warned of."""
    done = shop("export", "out/arm", "--format", "all", "--set", "physical", "-o", "all", "--json")
    answer = json.loads(done.out)
    assert (done.status, answer["impossible_links"]) == (0, [])
    assert {
        file["format"]: [check["engine"].split()[0] for check in file["checks"]]
        for file in answer["files"]
    } == {
        "urdf": ["MuJoCo"],
        "mjcf": ["MuJoCo"],
        "yaml": ["dynid"],
        "effects": ["MuJoCo"],
        "c": ["cc"],
        "python": ["NumPy"],
        "matlab": ["Octave"] if shutil.which("octave-cli") else [],
    }
    assert (
        max(check["largest_difference_nm"] for file in answer["files"] for check in file["checks"])
        < 1e-6
    )
    assert set(answer["origin"].values()) == {"data", "prior"}
    assert sorted(path.name for path in (shop.folder / "all").iterdir()) == ["effects.py"] + [
        f"kuka_lwr4plus{suffix}" for suffix in (".c", ".m", ".py", ".urdf", ".xml", ".yaml")
    ]
    stored = load(shop.folder / "out/arm/parameters.npz")
    bad = shop.folder / "out/bad"
    bad.mkdir()
    opposite = replace(stored.fit, theta=stored.plain - 3 * np.abs(stored.plain))
    replace(stored, fit=opposite).save(bad / "parameters.npz")
    refused = shop("export", "out/bad", "--format", "urdf", "--set", "plain", "-o", "plain")
    assert (refused.status, refused.out) == (1, "")
    assert refused.err.splitlines()[0].startswith("error[E404] no body has the parameters of link ")
    assert not (shop.folder / "plain").exists()
    allowed = shop(
        "export",
        "out/bad",
        "--format",
        "urdf",
        "--set",
        "plain",
        "-o",
        "plain",
        "--allow-infeasible",
    )
    assert allowed.status == 0
    assert allowed.err.splitlines()[0].startswith(
        "warning[W409] no body has the parameters of link "
    )
    assert (shop.folder / "plain/kuka_lwr4plus.urdf").is_file()


def test_exporting_twice_reuses_the_file_and_another_file_is_not_overwritten(shop):
    """The same bytes are fine; a file that somebody changed needs --force."""
    assert shop("export", "out/arm", "--format", "matlab").status == 0
    again = shop("export", "out/arm", "--format", "matlab")
    assert again.status == 0
    assert again.err.splitlines()[0] == "reused     out/arm/kuka_lwr4plus.m       (the same bytes)"
    (shop.folder / "out/arm/kuka_lwr4plus.m").write_text("mine")
    refused = shop("export", "out/arm", "--format", "matlab")
    assert refused.status == 7
    assert refused.err.splitlines()[0].startswith("error[E702] out/arm/kuka_lwr4plus.m exists")
    assert (shop.folder / "out/arm/kuka_lwr4plus.m").read_text() == "mine"
    assert shop("export", "out/arm", "--format", "matlab", "--force").status == 0
    assert (
        (shop.folder / "out/arm/kuka_lwr4plus.m")
        .read_text()
        .startswith("function out = kuka_lwr4plus(what")
    )


def test_an_urdf_option_without_the_format_is_refused(shop):
    """It would be ignored silently."""
    (shop.folder / "two.urdf").write_text(URDF)
    done = shop("export", "out/arm", "--format", "c", "--urdf", "two.urdf", "-o", "none")
    assert (done.status, done.out) == (2, "")
    assert done.err.splitlines()[0] == "error[E101] --urdf is for --format urdf"
    assert not (shop.folder / "none").exists()


def test_a_urdf_becomes_a_robot_file_that_the_other_commands_read(dynid):
    """import, then check and model on what it wrote."""
    (dynid.folder / "two.urdf").write_text(URDF)
    done = dynid("import", "two.urdf", "--json")
    answer = json.loads(done.out)
    assert (done.status, answer["schema"], answer["n_joints"]) == (0, "dynid/import/1", 2)
    assert answer["kinematics_largest_difference"] < 1e-12
    assert answer["mass_kg"] == pytest.approx(3.0, abs=1e-12)
    assert answer["wrote"] == ["out/two/two.yaml"]
    checked = json.loads(dynid("check", "out/two/two.yaml", "--json").out)["checked"][0]
    assert (checked["n_joints"], checked["robot"]) == (2, "two")
    assert checked["tool_at_zero_m"] == pytest.approx([0.4, 0, 0.3], abs=1e-12)
    # By hand: one inertia about the vertical axis a, seven parameters of the link behind b, three of friction each.
    model = json.loads(dynid("model", "out/two/two.yaml", "-o", "out/two", "--json", "-y").out)
    assert (model["n_parameters"], model["rank"]) == (2 * 14, 1 + 7 + 2 * 3)


def test_a_file_that_is_no_urdf_is_refused(dynid):
    """With its own code, on stderr only."""
    (dynid.folder / "two.urdf").write_text("<sdf/>")
    done = dynid("import", "two.urdf")
    assert (done.status, done.out) == (3, "")
    assert done.err.splitlines()[0].startswith("error[E210] two.urdf")
    assert list(dynid.folder.iterdir()) == [dynid.folder / "two.urdf"]


@pytest.mark.slow
def test_a_result_is_as_its_baseline_and_a_scaled_torque_column_is_not(shop):
    """The regression job: the same log passes at a tolerance of 1 %, a column times 1.02 fails and is named."""
    same = shop("identify", "kuka_lwr4plus", str(IDENTIFY), "-o", "out/again", "--no-report")
    assert same.status == 0
    passed = shop(
        "compare", "out/again", "--baseline", "out/arm", "--tolerance", "1%", "--junit", "same.xml"
    )
    assert passed.status == 0
    assert (
        shop("identify", "kuka_lwr4plus", "scaled.npz", "-o", "out/scaled", "--no-report").status
        == 0
    )
    failed = shop(
        "compare",
        "out/scaled",
        "--baseline",
        "out/arm",
        "--tolerance",
        "1%",
        "--junit",
        "scaled.xml",
        "--json",
    )
    answer = json.loads(failed.out)
    assert (failed.status, answer["passed"]) == (1, False)
    (comparison,) = answer["comparisons"]
    moved = [each["name"] for each in comparison["beyond_tolerance"]]
    assert moved[0] == "lwr_2_joint rms_nm"
    assert {"Iyz3", "fo3"} <= set(moved)
    torque = {
        f["name"].split()[0]: f["percent"]
        for f in comparison["figures"]
        if "torque_rms_nm" in f["name"]
    }
    expected = {f"lwr_{k}_joint": 2.0 if k == 2 else 0.0 for k in range(7)}
    assert torque == pytest.approx(expected, abs=1e-9)
    counts = [
        ET.parse(shop.folder / name).getroot().get("failures")
        for name in ("same.xml", "scaled.xml")
    ]
    assert counts == ["0", "1"]


def test_runs_become_one_table(shop):
    """Text, CSV and LaTeX; two runs of one arm."""
    done = shop(
        "compare", "out/arm", "out/arm/parameters.npz", "--csv", "all.csv", "--latex", "all.tex"
    )
    assert done.status == 0
    answer, _, head, *rows = done.out.splitlines()[:5]
    assert answer == "Nothing has changed since out/arm by more than its uncertainty."
    assert re.split("  +", head) == [
        "run",
        "robot",
        "method",
        "rank",
        "condition",
        "unexplained",
        "held out",
        "weakest joint",
    ]
    assert [row.split()[0] for row in rows] == ["out/arm", "out/arm/parameters.npz"]
    found = load_run(shop.folder / "out/arm")
    with (shop.folder / "all.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [row["run"] for row in table] == ["out/arm", "out/arm/parameters.npz"]
    for row in table:
        assert [float(row[name]) for name in found.names] == found.theta.tolist()
    lines = (shop.folder / "all.tex").read_text().splitlines()
    assert lines[0] == r"\begin{tabular}{lrr}"
    assert lines[2] == r" & out/arm & out/arm/parameters.npz \\"
    assert len([line for line in lines if " & " in line]) == 1 + len(found.names) + 1


def test_a_tolerance_without_a_baseline_is_wrong_usage(shop):
    """Nothing could be compared."""
    done = shop("compare", "out/arm", "--tolerance", "1%")
    assert (done.status, done.out) == (2, "")
    assert done.err.splitlines()[0] == "error[E101] --tolerance needs a --baseline"


BATCH = f"""
defaults: {{robot: kuka_lwr4plus, options: {{report: false}}}}
jobs:
  - {{name: good, logs: {IDENTIFY}, baseline: out/arm, tolerance: 1%}}
  - {{name: scaled, logs: scaled.npz, baseline: out/arm, tolerance: 1%}}
  - {{name: missing, logs: nowhere.bag}}
"""


@pytest.mark.slow
def test_a_failing_job_does_not_stop_the_others_and_done_work_is_not_done_again(shop):
    """A passed, a drifted and a broken job; the second time nothing is identified; a changed option runs one again."""
    (shop.folder / "batch.yaml").write_text(BATCH)
    done = shop("run", "batch.yaml", "--json", "--junit", "batch.xml", "-o", "jobs")
    answer = json.loads(done.out)
    assert done.status == 3
    assert [job["outcome"] for job in answer["jobs"]] == ["passed", "beyond a limit", "failed"]
    good, scaled, missing = (job["message"] for job in answer["jobs"])
    assert good == ""
    assert re.fullmatch(
        r"limit +scaled: lwr_2_joint rms_nm \S+ -> \S+ \(\+\d+\.\d\d %\) and \d+ more", scaled
    )
    assert missing.startswith("error[E301] no such file nowhere.bag")
    root = ET.parse(shop.folder / "batch.xml").getroot()
    assert (root.get("tests"), root.get("failures"), root.get("errors")) == ("3", "1", "1")
    again = json.loads(shop("run", "batch.yaml", "--json", "-o", "jobs").out)
    assert [job["reused"] for job in again["jobs"]] == [True, True, False]
    (shop.folder / "batch.yaml").write_text(
        BATCH.replace(
            f"logs: {IDENTIFY}, baseline", f"logs: {IDENTIFY}, options: {{cutoff: 9}}, baseline"
        )
    )
    third = json.loads(
        shop("run", "batch.yaml", "--json", "-o", "jobs", "--only", "good", "--only", "scaled").out
    )
    assert [job["reused"] for job in third["jobs"]] == [False, True]


def test_an_option_that_identify_does_not_have_fails_its_job_and_the_nearest_is_offered(shop):
    (shop.folder / "wrong.yaml").write_text(
        f"jobs: [{{robot: kuka_lwr4plus, logs: {IDENTIFY}, options: {{cutof: 8}}}}]"
    )
    done = shop("run", "wrong.yaml")
    assert done.status == 2
    assert "did you mean '--cutoff'" in done.out


def test_the_report_is_one_file_beside_the_result(shop):
    """With a summary for a pull request; the verdict is the answer; a second run gives the same bytes."""
    done = shop("report", "out/arm", "--json")
    answer = json.loads(done.out)
    assert (done.status, answer["schema"], len(answer["verdict"])) == (0, "dynid/report/1", 3)
    assert answer["wrote"] == ["out/arm/report.html", "out/arm/summary.md"]
    page, summary = ((shop.folder / path).read_text(encoding="utf-8") for path in answer["wrote"])
    lead = html.unescape(re.search(r'<p class="lead">(.*?)</p>', page, flags=re.S)[1])
    assert lead == " ".join(answer["verdict"])
    assert re.findall(r'<li class="(\w+)"><span class="dot"', page) == list(
        answer["lights"].values()
    )
    assert summary.splitlines()[0] == "### KUKA LWR4+"
    again = shop("report", "out/arm")
    assert (again.status, again.out.splitlines()) == (0, answer["verdict"])
    assert (shop.folder / "out/arm/report.html").read_text(encoding="utf-8") == page
