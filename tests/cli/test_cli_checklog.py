"""check on logs: what it says, what it writes, what it refuses."""

import numpy as np
import pytest

import twolink
from dynid.files.logs import read_npz_log
from runner import ROOT

BAG = ROOT / "trajectories/lwr4plus_identify.bag"


@pytest.mark.slow
def test_a_bag_is_described_and_converted_once_and_read_back(dynid):
    line = f"check {BAG} --robot kuka_lwr4plus"
    (checked,) = dynid(f"{line} --json").facts["checked"]
    assert (checked["kind"], checked["samples"]) == ("log", 8000)
    assert checked["rate_hz"] == pytest.approx(200, rel=0.01)
    assert checked["duration_s"] == pytest.approx(40, rel=0.01)
    assert len(checked["position_span_rad"]) == len(checked["torque_max_nm"]) == 7
    path = "out/kuka_lwr4plus/log.npz"
    assert f"wrote      {path}" in dynid(f"{line} --convert").err
    assert len(read_npz_log(dynid.folder / path)) == 8000
    assert dynid(f"{line} --convert").err.startswith("reused")
    (again,) = dynid(f"check {path} --robot kuka_lwr4plus --json").facts["checked"]
    assert again["samples"] == 8000


def test_a_log_without_a_robot_says_what_it_holds(dynid):
    shown = dynid(f"check {BAG}").good.out
    assert "/lwr/joint_states  sensor_msgs/JointState, " in shown
    assert "joint_names: [lwr_0_joint, lwr_1_joint" in shown


def test_the_robot_file_among_the_paths_serves_the_logs(arm):
    assert "matched by name: shoulder, elbow" in arm("check arm.yaml log.csv").good.out


def test_fix_repairs_without_loss_and_lists_each_repair(arm):
    def turn(columns):
        columns["q"][1500:, 1] += 2 * np.pi

    twolink.write_log(arm.folder / "log.csv", 1, turn)
    said = arm("check arm.yaml log.csv --fix").good.err
    assert "warning[W315] elbow jumps by 6.28 rad at 15.00 s; unwrapped" in said
    log = read_npz_log(arm.folder / "out/arm/log.npz")
    assert np.abs(np.diff(log.q[:, 1])).max() < 0.1


def test_a_faulty_log_is_not_converted(arm):
    def broken(columns):
        columns["tau"][300:312, 1] = np.nan

    twolink.write_log(arm.folder / "log.csv", 1, broken)
    arm("check arm.yaml log.csv --convert").failed(3)
    assert not (arm.folder / "out").exists()
