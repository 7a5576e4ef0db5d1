"""export, import, compare and run from outside: what they write, say and return."""

import csv
import html
import json
import re
import xml.etree.ElementTree as ET
from dataclasses import replace

import numpy as np
import pytest

from dynid.loading import load_run
from runner import ROOT, rows

IDENTIFY = ROOT / "trajectories" / "lwr4plus_identify.bag"
INERTIA = '<inertia ixx="0.1" ixy="0" ixz="0" iyy="0.1" iyz="0" izz="0.1"/>'
URDF = f"""<robot name="two"><link name="base"/>
<joint name="a" type="revolute"><parent link="base"/><child link="one"/><origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
<limit lower="-2" upper="2" effort="50" velocity="2"/></joint>
<link name="one"><inertial><mass value="2"/>{INERTIA}</inertial></link>
<joint name="b" type="continuous"><parent link="one"/><child link="two"/><origin xyz="0.4 0 0"/><axis xyz="0 1 0"/>
</joint><link name="two"><inertial><origin xyz="0.1 0 0"/><mass value="1"/>{INERTIA}</inertial></link></robot>"""


def test_every_format_gives_the_torques_of_the_result_and_impossible_bodies_are_refused(story):
    """All formats agree within 1e-6 N m; bodies that cannot exist need --allow-infeasible and are warned of."""
    answer = story("export out/arm --format all --set physical -o all --json").facts
    assert (answer["schema"], answer["impossible_links"]) == ("dynid/export/1", [])
    found = {file["format"]: file["checks"] for file in answer["files"]}
    engines = [(name, *(check["engine"].split()[0] for check in found[name])) for name in found]
    assert sorted(engines) == rows("""
        c       | cc
        effects | MuJoCo
        matlab
        mjcf    | MuJoCo
        python  | NumPy
        urdf    | MuJoCo
        yaml
    """)
    for name, checks in found.items():
        for check in checks:
            assert check["agrees"]
            assert check["largest_difference_nm"] < (1e-10 if name in ("c", "python") else 1e-6)
    assert found["c"][0]["states"] == 1000
    assert set(answer["origin"].values()) == {"data", "prior"}
    names = {path.name for path in (story.folder / "all").iterdir()}
    suffixes = (".c", ".m", ".py", ".urdf", ".xml", ".yaml")
    assert names == {"effects.py", *(f"kuka_lwr4plus{suffix}" for suffix in suffixes)}

    stored = load_run(story.folder / "out/arm")
    opposite = replace(stored.fit, theta=stored.plain - 3 * np.abs(stored.plain))
    (story.folder / "out/bad").mkdir()
    replace(stored, fit=opposite).save(story.folder / "out/bad/parameters.npz")
    line = "export out/bad --format urdf --set plain -o plain"
    says = "no body has the parameters of link "
    assert story(line).failed(1).startswith(f"error[E404] {says}")
    assert not (story.folder / "plain").exists()
    allowed = story(f"{line} --allow-infeasible").good
    assert allowed.err.startswith(f"warning[W409] {says}")
    assert (story.folder / "plain/kuka_lwr4plus.urdf").is_file()


def test_exporting_twice_reuses_the_file_and_another_file_is_not_overwritten(story):
    """The same bytes are fine; a file that somebody changed needs --force."""
    line, path = "export out/arm --format matlab", story.folder / "out/arm/kuka_lwr4plus.m"
    assert story(line).good
    again = story(line).good.err.splitlines()[0]
    assert again == "reused     out/arm/kuka_lwr4plus.m       (the same bytes)"
    path.write_text("mine")
    assert story(line).failed(7).startswith("error[E702] out/arm/kuka_lwr4plus.m exists")
    assert path.read_text() == "mine"
    assert story(f"{line} --force").good
    assert path.read_text().startswith("function out = kuka_lwr4plus(what")


@pytest.mark.parametrize(
    ("line", "said"),
    rows("""
        export out/arm --format c --urdf two.urdf -o none | --urdf is for --format urdf
        compare out/arm --tolerance 1% | --tolerance needs a --baseline
    """),
)
def test_an_option_that_would_be_ignored_is_wrong_usage(story, line, said):
    (story.folder / "two.urdf").write_text(URDF)
    assert story(line).failed(2).splitlines()[0] == f"error[E101] {said}"
    assert not (story.folder / "none").exists()


def test_a_urdf_becomes_a_robot_file_that_the_other_commands_read(dynid):
    """import, then check and model on what it wrote."""
    (dynid.folder / "two.urdf").write_text(URDF)
    answer = dynid("import two.urdf --json").facts
    assert (answer["schema"], answer["n_joints"]) == ("dynid/import/1", 2)
    assert answer["kinematics_largest_difference"] < 1e-12
    assert answer["mass_kg"] == pytest.approx(3.0, abs=1e-12)
    assert answer["wrote"] == ["out/two/two.yaml"]
    (checked,) = dynid("check out/two/two.yaml --json").facts["checked"]
    assert (checked["n_joints"], checked["robot"]) == (2, "two")
    assert checked["tool_at_zero_m"] == pytest.approx([0.4, 0, 0.3], abs=1e-12)
    # By hand: one inertia about the vertical axis a, seven parameters of the link behind b, three of friction each.
    model = dynid("model out/two/two.yaml -o out/two --json -y").facts
    assert (model["n_parameters"], model["rank"]) == (2 * 14, 1 + 7 + 2 * 3)


def test_runs_become_one_table(story):
    """Text, CSV and LaTeX; two runs of one arm."""
    runs = ["out/arm", "out/arm/parameters.npz"]
    done = story("compare --csv all.csv --latex all.tex", *runs).good
    answer, _, head, *rows = done.out.splitlines()[:5]
    assert answer == "Nothing has changed since out/arm by more than its uncertainty."
    columns = "run, robot, method, rank, condition, error, held out, weakest joint"
    assert re.split("  +", head) == columns.split(", ")
    assert [row.split()[0] for row in rows] == runs
    found = load_run(story.folder / "out/arm")
    with (story.folder / "all.csv").open(newline="") as stream:
        table = list(csv.DictReader(stream))
    assert [row["run"] for row in table] == runs
    for row in table:
        assert [float(row[name]) for name in found.names] == found.theta.tolist()
    lines = (story.folder / "all.tex").read_text().splitlines()
    assert lines[0] == r"\begin{tabular}{lrr}"
    assert lines[2] == r" & out/arm & out/arm/parameters.npz \\"
    assert len([line for line in lines if " & " in line]) == 1 + len(found.names) + 1


BATCH = f"""
defaults: {{robot: kuka_lwr4plus, options: {{report: false}}}}
jobs:
  - {{name: good, logs: {IDENTIFY}, baseline: out/arm, tolerance: 1%}}
  - {{name: noisy, logs: {IDENTIFY}, fail_if: max_rms_nm > 1e-6}}
  - {{name: missing, logs: nowhere.bag}}
"""


@pytest.mark.slow
def test_a_failing_job_does_not_stop_the_others_and_done_work_is_not_done_again(story):
    """One passes, one is beyond its limit, one is broken; a second run identifies nothing, a changed option one."""

    def jobs(text=BATCH, more=""):
        (story.folder / "batch.yaml").write_text(text)
        done = story(f"run batch.yaml --json --junit batch.xml -o jobs {more}")
        return done.status, json.loads(done.out)["jobs"]

    status, first = jobs()
    assert status == 3
    assert [job["outcome"] for job in first] == ["passed", "beyond a limit", "failed"]
    good, noisy, missing = (job["message"] for job in first)
    assert good == ""
    assert re.fullmatch(r"limit +max_rms_nm = \S+ > 1e-06", noisy), noisy
    assert missing.startswith("error[E301] no such file nowhere.bag")
    root = ET.parse(story.folder / "batch.xml").getroot()
    assert [root.get(key) for key in ("tests", "failures", "errors")] == ["3", "1", "1"]
    assert [job["reused"] for job in jobs()[1]] == [True, True, False]
    other = BATCH.replace(f"{IDENTIFY},", f"{IDENTIFY}, options: {{cutoff: 9}},", 1)
    third = jobs(other, "--only good --only noisy")[1]
    assert [job["reused"] for job in third] == [False, True]


def test_an_option_that_identify_does_not_have_fails_its_job_and_the_nearest_is_offered(story):
    (story.folder / "wrong.yaml").write_text(
        f"jobs: [{{robot: kuka_lwr4plus, logs: {IDENTIFY}, options: {{cutof: 8}}}}]"
    )
    done = story("run wrong.yaml")
    assert done.status == 2
    assert "did you mean '--cutoff'" in done.out


def test_the_report_is_one_file_beside_the_result(story):
    """With a summary for a pull request; the verdict is the answer; a second run gives the same bytes."""
    answer = story("report out/arm --json").facts
    assert answer["schema"] == "dynid/report/1"
    assert answer["wrote"] == ["out/arm/report.html", "out/arm/summary.md"]
    page, summary = ((story.folder / path).read_text(encoding="utf-8") for path in answer["wrote"])
    lead = html.unescape(re.search(r'<p class="lead">(.*?)</p>', page, flags=re.S)[1])
    assert lead == " ".join(answer["verdict"])
    lights = re.findall(r'<li class="(\w+)"><span class="dot"', page)
    assert lights == list(answer["lights"].values())
    assert summary.splitlines()[0] == "### KUKA LWR4+"
    again = story("report out/arm").good.out.splitlines()
    assert again[: len(answer["verdict"])] == answer["verdict"]
    assert (story.folder / "out/arm/report.html").read_text(encoding="utf-8") == page


def test_the_shipped_log_has_the_rank_of_the_arm_and_predicts_the_other(story):
    assert story.answer["rank"] == 69
    assert story.answer["heldout_relative_error_percent"] < 1.0
    unseen = IDENTIFY.with_name("lwr4plus_validate.bag")
    line = f"validate out/arm/parameters.npz {unseen} --exclude 10-1e12 --no-plot --json"
    assert story(line).facts["relative_error_percent"] < 1.0
