"""``dynid trajectory`` from the outside: answer, files, exit statuses, the question."""

import csv
import re

import numpy as np
import pytest
import yaml

from dynid.files.trajectoryfile import read_trajectory
from runner import ROOT, rows

LWR = "trajectory kuka_lwr4plus"
QUICK = "--no-optimise --duration 6 --segments 4 --preview none"
OUT = "out/kuka_lwr4plus"
TRAJECTORIES = ROOT / "trajectories"


@pytest.fixture(scope="module")
def planned(workshop):
    """A quick plan in one folder for several tests: how to run there, its answer, what was said."""
    run = workshop()
    done = run(f"{LWR} {QUICK} --json")
    return run, done.facts, done.err


def test_answer_holds_a_peak_of_each_joint_and_the_errors_of_what_can_be_known(planned):
    _, answer, _ = planned
    assert answer["schema"] == "dynid/trajectory/1"
    assert len(answer["peak"]) == 7
    assert answer["duration_s"] == pytest.approx(6 / 0.2)
    assert all(error > 0 for error in answer["predicted_std_error"].values())
    assert "m4" not in answer["predicted_std_error"]


def test_npz_csv_and_yaml_hold_the_same_motion(planned):
    run, answer, _ = planned
    assert f"{OUT}/trajectory.npz" in answer["wrote"]
    out = run.folder / OUT
    with np.load(out / "trajectory.npz") as stored:
        t, q = stored["t"], stored["q"]
    with (out / "trajectory.csv").open() as stream:
        rows = list(csv.DictReader(stream))
    points = yaml.load((out / "trajectory.yaml").read_text(), Loader=yaml.CSafeLoader)["points"]
    assert len(t) == len(rows) == len(points)
    assert np.allclose([float(row["q_lwr_3_joint"]) for row in rows], q[:, 3], atol=1e-6)
    assert np.allclose([point["positions"][3] for point in points], q[:, 3], atol=1e-6)
    assert all(len(point["velocities"]) == 7 for point in points)


def test_unattended_motion_is_marked_unreviewed_and_accepted_on_review(planned):
    run, answer, said = planned
    assert answer["reviewed"] is False
    assert "written, marked reviewed: no (not asked: no terminal; set with --accept)" in said
    review = f"{LWR} --review {OUT}/trajectory.npz --accept --preview none --json"
    assert run(review).facts["reviewed"] is True


def test_same_inputs_are_reused_and_other_inputs_need_force(planned):
    run, answer, _ = planned
    again = run(f"{LWR} {QUICK} --json")
    assert "reused" in again.err
    assert again.facts["condition_number"] == answer["condition_number"]
    run(f"{LWR} {QUICK} --alpha 0.5").failed(7, "error[E702]")


@pytest.mark.parametrize(
    ("point", "status", "said"),
    rows(r"""
        0,2.6,0,0,0,0,0    | 5 | E501\] lwr_1_joint reaches 2.6 rad at t = .*limit 1.88 with 10 % margin
        0,30,0,0,0,0,0     | 5 | E501\] lwr_1_joint reaches 30 rad
        0,1.8,0,-0.4,0,0,0 | 5 | E502\].*floor
    """),
)
def test_waypoints_that_cannot_be_end_with_the_numbers_and_a_way_out(dynid, point, status, said):
    (dynid.folder / "far.csv").write_text(f"0,0,0,0,0,0,0\n{point}\n0,0,0,0,0,0,0\n")
    done = dynid(f"{LWR} --from-waypoints far.csv --preview none")
    assert re.search(said, done.failed(int(status)), re.S)
    assert not (dynid.folder / OUT / "trajectory.npz").exists()


@pytest.mark.slow
def test_arm_built_lower_than_the_wanted_distance_is_planned_and_still_kept_off_the_floor(dynid):
    text = "name: low\nconvention: standard\njoints:\n  - {a: 0.4, d: 0.1, twist: 90 deg}\n  - {a: 0.3}\n"
    (dynid.folder / "low.yaml").write_text(text)
    line = "trajectory low.yaml --preview none"
    more = "--duration 6 --segments 4 --seconds 60 --restarts 3 --json"
    assert dynid(f"{line} {more}").facts["closest_m"] > 0.03
    (dynid.folder / "down.csv").write_text("0,0.5\n0,-0.5\n0,0.5\n")
    dynid(f"{line} --from-waypoints down.csv -o down").failed(5, "error[E502]", "floor")


def test_too_fast_a_tool_is_told_the_alpha_that_passes_and_that_alpha_passes(dynid):
    (dynid.folder / "w.csv").write_text("0,0,0,0,0,0,0\n0.5,0.8,0,0.4,0,0,0\n0,0,0,0,0,0,0\n")
    line = f"{LWR} --from-waypoints w.csv --preview none --tool-speed 0.25"
    alpha = dynid(f"{line} --alpha 1").failed(5).split("--alpha ")[1].split()[0]
    assert dynid(f"{line} --alpha {alpha}").good


@pytest.mark.slow
def test_plan_file_sets_options_and_the_command_line_wins(dynid):
    text = (
        "alpha: 0.5\nsegments: 4\nduration: 6\nwaypoints: [[0,0,0,0,0,0,0],[0.3,0.3,0,0,0,0,0]]\n"
    )
    (dynid.folder / "plan.yaml").write_text(text)
    line = f"{LWR} plan.yaml --preview none --json"
    first, second = (dynid(f"{line} {more}").facts for more in ("-o a", "--alpha 1 -o b"))
    assert (first["alpha"], second["alpha"]) == (0.5, 1.0)
    assert first["duration_s"] == pytest.approx(2 * second["duration_s"])


@pytest.mark.slow
def test_no_asks_what_to_change_old_pictures_go_and_an_unseen_motion_is_accepted_unseen(dynid):
    out = dynid.folder / OUT
    out.mkdir(parents=True)
    (out / "preview.gif").write_bytes(b"of another motion")
    keys = ["n\n", "five\n", "\n", "3\n", "n\n", "0.1\n", "\n", "y\n"]
    said = dynid.typing(f"{LWR} {QUICK}", keys=keys).good.err
    assert "'five' is not a valid float" in said
    assert "alpha [0.2]" in said
    assert "seed [1]" in said
    assert "seed [4]" in said
    assert "reviewed: accepted unseen" in said
    assert not (out / "preview.gif").exists()
    stored = read_trajectory(out / "trajectory.npz")
    assert (stored.alpha, stored.review.seen) == (0.1, False)


@pytest.mark.slow
def test_declining_for_good_writes_nothing_and_ends_with_status_7(dynid):
    assert dynid.typing(f"{LWR} {QUICK}", keys=["q\n"]).status == 7
    assert not (dynid.folder / OUT / "trajectory.npz").exists()


@pytest.mark.slow
def test_gui_without_a_display_is_status_6_and_pictures_are_the_default(dynid):
    dynid(f"{LWR} {QUICK} --preview gui").failed(6, "error[E604]")
    assert dynid(f"{LWR} {QUICK.removesuffix('--preview none')}").good
    assert (dynid.folder / OUT / "preview.png").stat().st_size > 20_000
    assert (dynid.folder / OUT / "preview.gif").read_bytes()[:6] == b"GIF89a"


def errors_of(done):
    return np.array(list(done.facts["predicted_std_error"].values()))


@pytest.mark.slow
def test_what_was_identified_before_makes_predicted_errors_smaller(dynid):
    bag = TRAJECTORIES / "kinova_gen2_identify.bag"
    assert dynid(f"identify kinova_gen2 {bag} --no-report -o before").good
    line = f"trajectory kinova_gen2 {QUICK} --json"
    alone = errors_of(dynid(f"{line} --noise 0.1 -o alone"))
    result = dynid(f"{line} --earlier before/parameters.npz -o result")
    told = result.facts
    # Why not each: bodies that were found are less uncertain than those of the prior only where they are no heavier.
    assert np.mean(errors_of(result) < alone) > 0.8
    assert told["unexplained_torque_nm"] > told["expected_torque_error_nm"]
    assert told["torque_noise_from"] == "as an earlier identification found it"


@pytest.mark.slow
def test_noise_of_the_robot_file_scales_the_predicted_errors_and_the_option_wins(dynid):
    errors = []
    cases = rows("""
        0.1 |             | from the robot file
        0.3 |             | from the robot file
        0.3 | --noise 0.1 | given with --noise
    """)
    text = (TRAJECTORIES.parent / "robots" / "kuka_lwr4plus.yaml").read_text()
    for noise, words, source in cases:
        noisy = text.replace("{source: joint_sensor}", f"{{source: joint_sensor, noise: {noise}}}")
        (dynid.folder / "arm.yaml").write_text(noisy)
        done = dynid(f"trajectory arm.yaml {QUICK} {words} --json --force")
        assert done.facts["torque_noise_from"] == source
        errors.append(errors_of(done))
    ratio = errors[1] / errors[0]
    # What the prior tells stays as it was; what it does not tell changes by the whole factor.
    assert np.all((ratio > 1.0 - 1e-9) & (ratio < 3.0 * (1 + 1e-6)))
    assert ratio.max() == pytest.approx(3.0, rel=0.01)
    assert np.allclose(errors[2], errors[0], rtol=1e-6)
