"""The copy of the robot file, and the arm identified again with what was named."""

import pytest

import twolink
from dynid import load_robot
from dynid.estimation.estimate import estimate
from dynid.gap.apply import specs_of, stacked_with, with_specs, write_robot
from dynid.gap.problem import make_problem
from dynid.judgement.gap import GapEffect
from dynid.robot import EffectSpec

SPRING = EffectSpec(
    "spring", ("elbow",), {"k1": 0.3, "c": 0.0, "order": 1.0, "constant": 1.0}, {"k1": 0.01}
)
OFFSET = EffectSpec("torque_offset", ("shoulder", "elbow"), {"c": 0.1}, {})


@pytest.fixture
def robot(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("# my arm\n" + twolink.ROBOT + "# the end\n")
    return load_robot(str(path))


def test_the_copy_keeps_the_file_and_has_the_effects(robot, tmp_path):
    write_robot(robot, [SPRING], tmp_path / "new.yaml")
    text = (tmp_path / "new.yaml").read_text()
    assert text.startswith("# my arm\n")
    assert "# the end" in text
    assert load_robot(str(tmp_path / "new.yaml")).effects == (SPRING,)


def test_the_rigid_body_and_its_base_parameters_stay(twolinks):
    base = twolinks.base
    added = with_specs(base, [SPRING])
    n = base.rank
    assert added.reduction.base_names[:n] == base.names
    assert added.reduction.base_names[n:] == ("spring2_k1", "spring2_c")
    again = with_specs(added, [OFFSET])
    assert set(again.reduction.base_names) > set(added.reduction.base_names)


def test_numbers_are_rounded_to_what_their_errors_leave():
    sizes = (("k1", 2.3456789, 0.0123, "N m/rad"), ("c", 0.1, None, "N m"), ("order", 1.0, 0.0, ""))
    found = GapEffect("spring", "spring", "elbow", joints=("elbow",), sizes=sizes)
    numbers = {"k1": 2.34568, "c": 0.1, "order": 1.0}
    assert specs_of([found], 0.0) == [EffectSpec("spring", ("elbow",), numbers, {"k1": 0.012})]


def test_the_logs_are_stacked_with_the_columns_of_the_effect(twolinks, on_joint):
    """Least squares on that stack finds the stiffness that the torques were made with."""
    logs = twolinks.logs(lambda t, q, qd, qdd: on_joint(1, 2.0 * q[:, 1]))
    theta = make_problem(logs, twolinks.base, None).theta
    base, stack = stacked_with(logs, twolinks.base, [SPRING], theta)
    assert "spring2_k1" in base.names
    found = estimate(stack, method="wls", holdout=None)
    k = found.names.index("spring2_k1")
    assert abs(found.plain[k] - 2.0) < 3 * found.std_error[k]
    assert found.std_error[k] < 0.1
