"""``dynid trajectory`` from the outside: answer, files, exit statuses, the question."""

import csv
import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import yaml

from dynid.files.trajectoryfile import read_trajectory
from runner import Runner

QUICK = ("--no-optimise", "--duration", "6", "--segments", "4", "--preview", "none")


@pytest.fixture(scope="module")
def planned(tmp_path_factory):
    """A quick plan in one folder for several tests: how to run there, its answer, what was said."""
    folder = tmp_path_factory.mktemp("plan")
    runner = Runner(folder, folder)
    done = runner("trajectory", "kuka_lwr4plus", *QUICK, "--json")
    assert done.status == 0, done.err
    return runner, json.loads(done.out), done.err


def test_answer_has_the_keys_of_the_contract_with_units_in_their_names(planned):
    _, answer, _ = planned
    assert answer["schema"] == "dynid/trajectory/1"
    keys = {
        "robot",
        "duration_s",
        "alpha",
        "condition_number",
        "condition_number_scaled",
        "smallest_singular_value",
    }
    keys |= {"peak", "collisions", "closest_m", "predicted_std_error", "wrote"}
    assert keys <= set(answer)
    peak = {
        "joint",
        "position_rad",
        "velocity_rad_s",
        "acceleration_rad_s2",
        "torque_nm",
        "limit_share",
    }
    assert [set(row) >= peak for row in answer["peak"]] == [True] * 7
    assert answer["duration_s"] == pytest.approx(6 / 0.2)
    assert all(error > 0 for error in answer["predicted_std_error"].values())
    assert "m4" not in answer["predicted_std_error"]


def test_npz_csv_and_yaml_hold_the_same_motion(planned):
    runner, answer, _ = planned
    out = runner.folder / "out" / "kuka_lwr4plus"
    assert {str(out / name) for name in ("trajectory.npz",)} <= {
        str(runner.folder / path) for path in answer["wrote"]
    }
    with np.load(out / "trajectory.npz") as stored:
        t, q = stored["t"], stored["q"]
    with (out / "trajectory.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    message = yaml.load((out / "trajectory.yaml").read_text(), Loader=yaml.CSafeLoader)
    assert len(t) == len(rows) == len(message["points"])
    assert np.allclose([float(row["q_lwr_3_joint"]) for row in rows], q[:, 3], atol=1e-6)
    assert np.allclose([point["positions"][3] for point in message["points"]], q[:, 3], atol=1e-6)
    assert all(len(point["velocities"]) == 7 for point in message["points"])


def test_unattended_motion_is_marked_unreviewed_and_accepted_on_review(planned):
    runner, answer, said = planned
    assert answer["reviewed"] is False
    assert "written, marked reviewed: no (not asked: no terminal; set with --accept)" in said
    path = "out/kuka_lwr4plus/trajectory.npz"
    done = runner(
        "trajectory", "kuka_lwr4plus", "--review", path, "--accept", "--preview", "none", "--json"
    )
    assert (done.status, json.loads(done.out)["reviewed"]) == (0, True), done.err


def test_same_inputs_are_reused_and_other_inputs_need_force(planned):
    run, answer, _ = planned
    again = run("trajectory", "kuka_lwr4plus", *QUICK, "--json")
    assert "reused" in again.err
    assert json.loads(again.out)["condition_number"] == answer["condition_number"]
    other = run("trajectory", "kuka_lwr4plus", *QUICK, "--alpha", "0.5")
    assert other.status == 7
    assert "error[E702]" in other.err


def test_waypoints_beyond_a_limit_end_with_status_5_the_numbers_and_a_way_out(dynid):
    (dynid.folder / "far.csv").write_text("0,0,0,0,0,0,0\n0,2.6,0,0,0,0,0\n0,0,0,0,0,0,0\n")
    done = dynid("trajectory", "kuka_lwr4plus", "--from-waypoints", "far.csv", "--preview", "none")
    assert done.status == 5
    assert done.out == ""
    assert "error[E501] lwr_1_joint reaches 2.6 rad at t = " in done.err
    assert "limit 1.88 with 10 % margin" in done.err
    assert not (dynid.folder / "out" / "kuka_lwr4plus" / "trajectory.npz").exists()


def test_waypoints_in_degrees_are_seen_as_such(dynid):
    (dynid.folder / "deg.csv").write_text("0,0,0,0,0,0,0\n0,30,0,0,0,0,0\n")
    done = dynid("trajectory", "kuka_lwr4plus", "--from-waypoints", "deg.csv", "--preview", "none")
    assert done.status == 3
    assert "error[E307] deg.csv: lwr_1_joint is 30 rad at waypoint 2" in done.err
    assert "angle_unit: deg" in done.err


@pytest.mark.slow
def test_arm_built_lower_than_the_wanted_distance_is_planned_and_still_kept_off_the_floor(dynid):
    text = "name: low\nconvention: standard\njoints:\n  - {a: 0.4, d: 0.1, twist: 90 deg}\n  - {a: 0.3}\n"
    (dynid.folder / "low.yaml").write_text(text)
    words = ("--preview", "none", "--duration", "6", "--segments", "4")
    done = dynid("trajectory", "low.yaml", *words, "--seconds", "60", "--restarts", "3", "--json")
    assert done.status == 0, done.err
    assert json.loads(done.out)["closest_m"] > 0.03
    (dynid.folder / "down.csv").write_text("0,0.5\n0,-0.5\n0,0.5\n")
    down = dynid(
        "trajectory", "low.yaml", "--from-waypoints", "down.csv", "--preview", "none", "-o", "down"
    )
    assert down.status == 5
    assert "error[E502]" in down.err
    assert "floor" in down.err


def test_waypoints_into_the_floor_end_with_status_5_and_the_pair(dynid):
    (dynid.folder / "floor.csv").write_text("0,0,0,0,0,0,0\n0,1.8,0,-0.4,0,0,0\n0,0,0,0,0,0,0\n")
    done = dynid(
        "trajectory", "kuka_lwr4plus", "--from-waypoints", "floor.csv", "--preview", "none"
    )
    assert done.status == 5
    assert "error[E502]" in done.err
    assert "floor" in done.err


def test_too_fast_a_tool_is_told_the_alpha_that_passes_and_that_alpha_passes(dynid):
    (dynid.folder / "w.csv").write_text("0,0,0,0,0,0,0\n0.5,0.8,0,0.4,0,0,0\n0,0,0,0,0,0,0\n")
    words = (
        "trajectory",
        "kuka_lwr4plus",
        "--from-waypoints",
        "w.csv",
        "--preview",
        "none",
        "--tool-speed",
        "0.25",
    )
    done = dynid(*words, "--alpha", "1")
    assert done.status == 5
    alpha = done.err.split("--alpha ")[1].split()[0]
    assert dynid(*words, "--alpha", alpha).status == 0


@pytest.mark.slow
def test_plan_file_sets_options_and_the_command_line_wins(dynid):
    text = (
        "alpha: 0.5\nsegments: 4\nduration: 6\nwaypoints: [[0,0,0,0,0,0,0],[0.3,0.3,0,0,0,0,0]]\n"
    )
    (dynid.folder / "plan.yaml").write_text(text)
    first = dynid(
        "trajectory", "kuka_lwr4plus", "plan.yaml", "--preview", "none", "--json", "-o", "a"
    )
    second = dynid(
        "trajectory",
        "kuka_lwr4plus",
        "plan.yaml",
        "--preview",
        "none",
        "--json",
        "--alpha",
        "1",
        "-o",
        "b",
    )
    assert (json.loads(first.out)["alpha"], json.loads(second.out)["alpha"]) == (0.5, 1.0)
    assert json.loads(first.out)["duration_s"] == pytest.approx(
        2 * json.loads(second.out)["duration_s"]
    )


@pytest.mark.slow
def test_person_is_asked_and_no_plans_another_motion(dynid):
    done = dynid.typing("trajectory", "kuka_lwr4plus", *QUICK, keys=["n\n", "seed 3\n", "y\n"])
    assert done.status == 0, done.err
    assert "alpha 0.2, seed 3" in done.err
    assert "reviewed: accepted unseen" in done.err


@pytest.mark.slow
def test_declining_for_good_writes_nothing_and_ends_with_status_7(dynid):
    done = dynid.typing("trajectory", "kuka_lwr4plus", *QUICK, keys=["q\n"])
    assert done.status == 7
    assert not (dynid.folder / "out" / "kuka_lwr4plus" / "trajectory.npz").exists()


@pytest.mark.slow
def test_gui_without_a_display_is_status_6_and_pictures_are_the_default(dynid):
    done = dynid("trajectory", "kuka_lwr4plus", *QUICK[:-1], "gui")
    assert done.status == 6
    assert "error[E604]" in done.err
    shown = dynid("trajectory", "kuka_lwr4plus", *QUICK[:-2], "--json")
    assert shown.status == 0, shown.err
    folder = dynid.folder / "out" / "kuka_lwr4plus"
    assert (folder / "preview.png").stat().st_size > 20_000
    assert (folder / "preview.gif").read_bytes()[:6] == b"GIF89a"


def errors_of(done):
    assert done.status == 0, done.err
    return np.array(list(json.loads(done.out)["predicted_std_error"].values()))


@pytest.mark.slow
def test_earlier_log_and_what_was_identified_from_it_make_every_predicted_error_smaller(dynid):
    bag = str(Path(__file__).parents[2] / "trajectories" / "kinova_gen2_identify.bag")
    assert dynid("identify", "kinova_gen2", bag, "--no-report", "-o", "before").status == 0
    words = ("trajectory", "kinova_gen2", *QUICK, "--json")
    alone = errors_of(dynid(*words, "--noise", "0.1", "-o", "alone"))
    log = errors_of(dynid(*words, "--noise", "0.1", "--earlier", bag, "-o", "log"))
    result = dynid(*words, "--earlier", "before/parameters.npz", "-o", "result")
    told = json.loads(result.out)
    assert np.all(log < alone)
    # Why not each: bodies that were found are less uncertain than those of the prior only where they are no heavier.
    assert np.mean(errors_of(result) < alone) > 0.8
    assert told["unexplained_torque_nm"] > told["expected_torque_error_nm"]
    assert json.loads(result.out)["torque_noise_from"] == "as an earlier identification found it"


@pytest.fixture
def noisy(dynid):
    """Writes the LWR4+ to a file of its own, with a torque noise."""
    text = (Path(__file__).parents[2] / "robots" / "kuka_lwr4plus.yaml").read_text()

    def make(noise):
        told = text.replace("{source: joint_sensor}", f"{{source: joint_sensor, noise: {noise}}}")
        (dynid.folder / "arm.yaml").write_text(told)

    return make


@pytest.mark.slow
def test_noise_of_the_robot_file_scales_the_predicted_errors_and_the_option_wins(dynid, noisy):
    answers = []
    for noise, words in (("0.1", ()), ("0.3", ()), ("0.3", ("--noise", "0.1"))):
        noisy(noise)
        done = dynid("trajectory", "arm.yaml", *QUICK, *words, "--json", "--force")
        assert done.status == 0, done.err
        answers.append(json.loads(done.out))
    errors = [np.array(list(answer["predicted_std_error"].values())) for answer in answers]
    assert [answer["torque_noise_from"] for answer in answers] == ["from the robot file"] * 2 + [
        "given with --noise"
    ]
    ratio = errors[1] / errors[0]
    # What the prior tells stays as it was; what it does not tell changes by the whole factor.
    assert np.all((ratio > 1.0 - 1e-9) & (ratio < 3.0 * (1 + 1e-6)))
    assert ratio.max() == pytest.approx(3.0, rel=0.01)
    assert np.allclose(errors[2], errors[0], rtol=1e-6)


@pytest.mark.parametrize("noise", ["-0.1", "[0.1, 0.1]", "[0.1, 0.1, 0.1, null, 0.1, 0.1, 0.1]"])
def test_noise_that_is_not_one_positive_number_a_joint_is_refused_with_the_line(
    dynid, noisy, noise
):
    noisy(noise)
    done = dynid("trajectory", "arm.yaml", *QUICK)
    assert done.status == 3
    lines = (dynid.folder / "arm.yaml").read_text().splitlines()
    line = next(k for k, text in enumerate(lines, start=1) if "noise" in text)
    assert f"arm.yaml:{line}: torque.noise" in done.err


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("--alpha", "2"), "alpha = 2"),
        (("--floor", "low"), "--floor 'low'"),
        (("--obstacle", "1,2,3"), "--obstacle '1,2,3' is not 6 numbers"),
        (("--noise", "0"), "--noise '0'"),
        (("--weights", "1"), "--weights '1'"),
    ],
)
def test_wrong_options_end_with_status_2_and_an_example(dynid, words, says):
    done = dynid("trajectory", "kuka_lwr4plus", *QUICK, *words)
    assert done.status == 2
    assert says in done.err


@pytest.mark.slow
def test_no_asks_what_to_change_old_pictures_go_and_an_unseen_motion_is_accepted_unseen(dynid):
    out = dynid.folder / "out" / "kuka_lwr4plus"
    out.mkdir(parents=True)
    (out / "preview.gif").write_bytes(b"of another motion")
    keys = ["n\n", "alpha five\n", "alpha 0.1\n", "y\n"]
    done = dynid.typing("trajectory", "kuka_lwr4plus", *QUICK, keys=keys)
    assert done.status == 0, done.err
    assert "change what? such as alpha 0.1, seed 1" in done.err
    assert "five is no number" in done.err
    assert "reviewed: accepted unseen" in done.err
    assert not (out / "preview.gif").exists()
    stored = read_trajectory(out / "trajectory.npz")
    assert (stored.alpha, stored.review.seen) == (0.1, False)


def test_help_of_trajectory_imports_no_numpy():
    code = "import sys, dynid.cli.trajectory; print('numpy' in sys.modules)"
    assert (
        subprocess.run([sys.executable, "-c", code], capture_output=True, text=True).stdout
        == "False\n"
    )
