"""Without PyBullet a motion is measured on capsules and drawn."""

import numpy as np
import pytest

from dynid import PlanOptions, plan_trajectory
from dynid.errors import Collision, PackageMissing
from dynid.reports.motion_drawing import draw_motion
from dynid.trajectory import planning
from dynid.trajectory.plan import through_waypoints
from dynid.trajectory.preview import Drawing

UP = np.radians([[0, 0, 0, 0, 0, 0, 0], [20, 40, 0, 40, 0, 0, 0]])
DOWN = np.radians([[0, 0, 0, 0, 0, 0, 0], [0, 105, 0, 0, 0, 0, 0]])
QUICK = PlanOptions(optimise=False, duration=6.0, segments=4)


def missing(*args, **options):
    raise PackageMissing("no PyBullet")


def test_the_arm_is_drawn_and_the_pairs_are_measured_on_capsules(lwr, monkeypatch, tmp_path):
    monkeypatch.setattr(planning, "measure_poses", missing)
    drawing = Drawing(tmp_path / "preview.png", tmp_path / "preview.gif")
    plan = plan_trajectory(lwr.robot, QUICK, waypoints=UP, base=lwr, drawing=drawing)
    assert plan.clearance.pictures == (tmp_path / "preview.png",)
    assert (tmp_path / "preview.png").read_bytes().startswith(b"\x89PNG")
    assert not (tmp_path / "preview.gif").exists()
    (finding,) = plan.clearance.findings
    assert (finding.code, finding.text.count(".")) == ("W605", 0)


def test_a_given_motion_that_meets_the_floor_is_refused_without_pybullet_too(lwr, monkeypatch):
    monkeypatch.setattr(planning, "measure_poses", missing)
    with pytest.raises(Collision, match="floor"):
        plan_trajectory(lwr.robot, QUICK, waypoints=DOWN, base=lwr)
    down = through_waypoints(DOWN, planning.bounds(lwr.robot))
    context = planning.planning_context(lwr, QUICK)
    with pytest.raises(Collision, match="floor"):
        planning.require_clear_motion(context, down, None, Drawing(), draw_motion)


def test_a_motion_that_teaches_too_little_says_what_limits_it(lwr):
    plan = plan_trajectory(lwr.robot, QUICK, waypoints=UP, base=lwr)
    assert "even at full speed" in plan.too_little
    assert "weakest: " in plan.too_little
