"""Recordings of real arms through the command line: the figures of ../shared/data/README.md, or better.

These numbers come from recordings and say what an earlier run reached; the bounds are those of the README there.
"""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml

from dynid.estimation import result
from dynid.estimation.observation_rows import rows_of
from dynid.files.robotfile import load_robot
from dynid.model import build_model
from dynid.model.prior import prior_parameters
from dynid.robot import Body
from dynid.workflows.logs import LogOptions, condition_logs, load_log

pytestmark = pytest.mark.data


def answer(run):
    assert run.status == 0, run.err
    return json.loads(run.out)


def test_lwr_run_1_predicts_run_2_within_2_2_percent(dynid, recordings):
    folder = recordings / "kuka_lwr4plus"
    fitted = answer(dynid("identify", "kuka_lwr4plus", str(folder / "run1.bag"), "--json"))
    assert fitted["schema"] == "dynid/identify/1"
    assert fitted["rank"] == 69
    replay = dynid("validate", "out/kuka_lwr4plus/parameters.npz", str(folder / "run2.bag"), "--no-plot", "--json")
    checked = answer(replay)
    assert checked["relative_error_percent"] <= 2.2
    assert all(joint["rms_nm"] < joint["baseline_rms_nm"] for joint in checked["joints"])
    refused = dynid("validate", "out/kuka_lwr4plus/parameters.npz", str(folder / "run1.bag"))
    assert refused.status == 2
    assert "E405" in refused.err


@pytest.mark.parametrize(
    ("robot", "folder", "bound"),
    [("ur10", "ur10_salerno", 7.5), ("staubli_tx40", "tx40", 7.4), ("franka_panda", "panda_salerno", 3.8)],
)
def test_other_arms_reach_the_plain_baselines_on_held_out_rows(dynid, recordings, robot, folder, bound):
    run = answer(dynid("identify", robot, str(recordings / folder / "exc.npz"), "--holdout", "33%", "--json"))
    assert run["heldout_relative_error_percent"] <= bound


def test_the_tx40_has_61_base_parameters_with_its_coupled_wrist(dynid, recordings):
    run = answer(dynid("identify", "staubli_tx40", str(recordings / "tx40" / "exc.npz"), "--json"))
    assert run["rank"] == 61


def test_the_jaco_torques_agree_with_the_official_inertias(recordings):
    """Gravity and inertia of the maker's URDF, no friction: 14.2 % in an independent evaluation."""
    robot = load_robot(Path(__file__).parents[1] / "robots" / "jaco2_6dof.yaml")
    table = yaml.safe_load((recordings / "inertia_tables" / "kinova_j2n6s300_kinova_ros.yaml").read_text())
    model = build_model(robot)
    bag = next((recordings / "jaco2_6dof").glob("*.bag"))
    log = load_log(bag, robot, identify=False)
    (source,) = condition_logs([log], model, LogOptions())
    gamma = np.zeros(model.size)
    for k, link in enumerate(table["links_dh"], start=1):
        inertia = tuple(link["inertia_com"][key] for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
        first = model.parameter_names.index(f"m{k}")
        gamma[first : first + 10] = Body(link["mass"], tuple(link["com"]), inertia).parameters()
    rows = list(rows_of(source, model.observer()))
    measured = np.concatenate([part.tau for part in rows])
    predicted = np.concatenate([part.W @ gamma for part in rows])
    assert 100 * np.linalg.norm(measured - predicted) / np.linalg.norm(measured) < 15.0
    assert len(log) == 420


def test_two_runs_write_the_same_bytes(dynid, recordings):
    log = str(recordings / "kuka_lwr4plus" / "run1.bag")
    texts = []
    for _ in range(2):
        assert dynid("identify", "kuka_lwr4plus", log, "--force").status == 0
        texts.append((dynid.folder / "out/kuka_lwr4plus/parameters.yaml").read_bytes())
    assert texts[0] == texts[1]


def test_the_prior_is_far_worse_than_the_fit(dynid, recordings):
    log = str(recordings / "kuka_lwr4plus" / "run1.bag")
    assert dynid("identify", "kuka_lwr4plus", log).status == 0
    stored = result.load(dynid.folder / "out/kuka_lwr4plus/parameters.npz")
    assert stored.relative_error_percent < 2.2
    assert len(prior_parameters(stored.robot)) == 70
