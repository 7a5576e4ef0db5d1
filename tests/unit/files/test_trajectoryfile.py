"""trajectory.npz comes back as it was, knows who has seen it, and its exports are what drivers read."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import yaml

from dynid import Motion, load_robot
from dynid.errors import JointCountDiffers, NotAnArtifact
from dynid.files.trajectoryfile import (
    Review,
    StoredTrajectory,
    motion_hash,
    read_trajectory,
    write_joint_trajectory,
    write_trajectory,
)
from dynid.robot import DriverSpec, JointMap

SHIPPED = Path(__file__).parents[3] / "trajectories"
ROBOT = load_robot(Path(__file__).parents[3] / "robots" / "kuka_lwr4plus.yaml")


def stored(**changes):
    rng = np.random.default_rng(0)
    motion = Motion(np.arange(5) / 100, *rng.standard_normal((3, 5, 7)))
    basis = {"kind": "quintic", "knots": [0.0, 1.0]}
    facts = StoredTrajectory(
        ROBOT.name, ROBOT.joint_names, motion, 0.5, basis, rng.standard_normal((2, 7))
    )
    return replace(facts, **changes)


def test_file_comes_back_as_it_was(tmp_path):
    mark = Review("ann", "2026-11-20T21:40:00+01:00", motion_hash(stored().motion))
    original = stored(review=mark, facts={"inputs": {"robot": "x"}})
    write_trajectory(tmp_path / "t.npz", original)
    found = read_trajectory(tmp_path / "t.npz", ROBOT)
    assert found.reviewed
    assert found.review == mark
    assert np.array_equal(found.motion.qd, original.motion.qd)
    assert (found.alpha, found.basis, found.facts["inputs"]) == (
        0.5,
        original.basis,
        {"robot": "x"},
    )


def test_review_of_another_motion_does_not_count():
    assert not stored().reviewed
    assert not stored(review=Review("ann", "now", "0" * 64)).reviewed


def test_samples_changed_after_planning_are_noticed(tmp_path):
    write_trajectory(tmp_path / "t.npz", stored())
    with np.load(tmp_path / "t.npz") as archive:
        arrays = {name: archive[name] for name in archive.files}
    arrays["q"][2, 3] += 0.1
    np.savez(tmp_path / "t.npz", **arrays)
    with pytest.raises(NotAnArtifact, match="changed after planning"):
        read_trajectory(tmp_path / "t.npz")


def test_trajectory_of_another_arm_is_refused(tmp_path):
    write_trajectory(tmp_path / "t.npz", stored(joints=tuple("abcdefg")))
    with pytest.raises(JointCountDiffers, match="has the joints a, b"):
        read_trajectory(tmp_path / "t.npz", ROBOT)


def test_joint_trajectory_speaks_the_drivers_language(tmp_path):
    sign, offset = (1.0, -1.0, 1.0, 1.0, 1.0, 1.0, -1.0), (0.0, 1.0, 0.0, 0.0, 0.5, 0.0, 0.0)
    names = tuple(f"arm_{k}" for k in range(7))
    driven = replace(ROBOT, driver=DriverSpec("generic", JointMap(sign, offset), joint_names=names))
    write_joint_trajectory(tmp_path / "t.yaml", driven, stored().motion)
    message = yaml.safe_load((tmp_path / "t.yaml").read_text())
    assert message["joint_names"] == list(names)
    assert len(message["points"]) == 5
    point = message["points"][3]
    assert np.allclose(
        np.array(sign) * point["positions"] + offset, stored().motion.q[3], atol=1e-8
    )
    assert np.allclose(np.array(sign) * point["velocities"], stored().motion.qd[3], atol=1e-8)
    assert len(point["accelerations"]) == 7
    assert point["time_from_start"] == {"secs": 0, "nsecs": 30_000_000}


@pytest.mark.parametrize("name", sorted(path.stem for path in SHIPPED.glob("*_alpha*.npz")))
def test_shipped_motions_are_reviewed_have_a_picture_and_say_how_to_make_them_again(name):
    found = read_trajectory(SHIPPED / f"{name}.npz")
    assert found.reviewed
    assert (SHIPPED / f"{name}.png").is_file()
    assert found.alpha == float(name.rpartition("alpha")[2])
    if found.alpha == 1.0:
        assert found.facts["answer"]["search"]["seed"] == 1
