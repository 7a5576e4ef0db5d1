"""What the user knows besides the logs, through the command line, on the shipped log of a simulated arm."""

import json
from pathlib import Path

import numpy as np
import pytest
from loaded_arm import PLANT, ROBOT, recorded

from dynid.errors import WrongRobotFile
from dynid.files.robotfile import parse_robot
from dynid.model.attached import attached
from dynid.sim.urdf import urdf_text


@pytest.fixture(scope="module")
def shop(workshop):
    run = workshop()
    log = recorded(11, seconds=15.0)
    np.savez(run.folder / "log.npz", t=log.t, q=log.q, tau=log.tau)
    return run


def links(shop, *options):
    done = shop(
        "identify", "kuka_lwr4plus", "log.npz", "--force", "--json", "--no-report", *options
    )
    assert done.status == 0, done.err
    return json.loads(done.out)["links"]


@pytest.mark.slow
def test_bounds_on_masses_and_centres_of_mass_are_kept(shop):
    bounds = (
        "--total-mass",
        "17.0:17.5",
        "--link-mass",
        "3=2.9:3.1",
        "--com-box",
        "1=-1,-1,-1:1,1,-0.05",
    )
    found = links(shop, *bounds)
    assert 17.0 <= sum(link["mass_kg"] for link in found) <= 17.5
    assert 2.9 <= found[2]["mass_kg"] <= 3.1
    assert found[0]["com_m"][2] <= -0.05


def test_a_prior_from_a_urdf_lies_in_the_frames_of_the_dh_table(tmp_path):
    (tmp_path / "arm.urdf").write_text(urdf_text(ROBOT, PLANT.bodies))
    for found, true in zip(
        attached(tmp_path / "arm.urdf", ROBOT).prior().links, PLANT.bodies, strict=True
    ):
        assert found.parameters() == pytest.approx(true.parameters(), abs=1e-9)


@pytest.mark.slow
def test_a_prior_from_a_file_fills_what_the_log_leaves_open(shop):
    (shop.folder / "arm.urdf").write_text(urdf_text(ROBOT, PLANT.bodies))
    true = np.array([body.mass for body in PLANT.bodies])
    # Why root mean square: noise may move one link's mass by 10 % at the cost of its neighbour, over five such logs.
    with_prior, without = (
        np.sqrt(
            np.mean((np.array([link["mass_kg"] for link in links(shop, *options)]) / true - 1) ** 2)
        )
        for options in (("--prior", "arm.urdf"), ("--drop-weak",))
    )
    assert with_prior < 0.05
    assert without > 3 * with_prior


def test_a_range_upside_down_is_refused(shop):
    assert shop("identify", "kuka_lwr4plus", "log.npz", "--total-mass", "17:15").status == 2
    text = ROBOT.path.read_text() + "known: {total_mass: [17, 15]}\n"
    with pytest.raises(WrongRobotFile, match="not a range"):
        parse_robot(text, Path("arm.yaml"))
