"""``identify`` asks whether the robot file is wrong where its fit is poor, and only there."""

from dataclasses import replace

import pytest

import dynid
from dynid import observe
from dynid.diagnose.mistakes import Edit, edited
from dynid.errors import GravityRemoved, WrongMapping
from dynid.signals.checks import prepare
from dynid.workflows.parameters import load_observations
from makelogs import lwr, lwr_log

pytestmark = pytest.mark.slow


def identified(log, robot, **options):
    return dynid.identify(robot, [log], **options)


@pytest.mark.parametrize(
    "mistake",
    [Edit("sign", (5.0,)), Edit("order", (0.0, 1.0, 2.0, 3.0, 6.0, 5.0, 4.0))],
    ids=lambda each: each.kind,
)
def test_a_mistake_that_leaves_little_is_named_all_the_same(mistake):
    wrong = edited(lwr(), mistake)
    with pytest.raises(WrongMapping, match="lwr_"):
        identified(lwr_log(), wrong)
    assert "W329" in [
        finding.code for finding in identified(lwr_log(), wrong, anyway=True).findings
    ]


def test_torques_that_bodies_without_weight_explain_well_are_refused():
    """Inertia and friction alone are those of an arm whose links are balanced, so that the fit itself is good."""
    robot, log = lwr(), prepare(lwr_log(), lwr())
    full, base = identified(log, robot), dynid.base_model(robot)
    weight = base.observer.torque(full.theta, log.q, 0 * log.q, 0 * log.q)
    with pytest.raises(GravityRemoved):
        identified(replace(log, tau=log.tau - weight), robot)


def test_stored_rows_ask_the_log_that_they_were_made_from(tmp_path):
    wrong = edited(lwr(), Edit("torque", (3.0,)))
    seen = observe(wrong, lwr_log())
    path = seen.save_stack(tmp_path)
    with pytest.raises(WrongMapping, match="torque of lwr_3_joint reversed"):
        dynid.identify(wrong, load_observations(path, seen.base))
