"""Results side by side, what changed against a baseline, and every estimator on one log."""

from dataclasses import replace

import pytest

from dynid import compare
from dynid.errors import WrongUsage


def test_two_motions_of_one_arm_have_not_drifted(result, other):
    found = compare([other], baseline=result)
    assert found.passed
    assert [run.drift for run in found.runs] == [""]
    assert found.runs[0].comparison.p_value > 0.01


def test_an_elbow_with_five_percent_more_torque_is_named_with_the_size_of_the_change(
    result, scaled
):
    found = compare([scaled], baseline=result, tolerance="1%")
    (run,) = found.runs
    assert not found.passed
    changes = {change.name: change.percent for change in run.changed}
    assert changes["elbow torque_rms_nm"] == pytest.approx(5.0, abs=0.01)
    assert "fv2" in changes
    assert not {"fv1", "shoulder torque_rms_nm"} & set(changes)
    assert run.drift.startswith(f"{run.changed[0].name} ")


def test_the_first_run_is_the_reference_where_there_is_no_baseline(result, scaled):
    """It judges nothing, but what changed is said."""
    found = compare([result, scaled])
    assert [run.reference for run in found.runs] == ["", "run 1"]
    assert found.runs[1].drift.startswith(found.runs[1].changed[0].name)
    assert found.passed
    assert all(name in repr(found) for name in ("run 2", found.runs[1].changed[0].name))


def test_another_arm_is_shown_but_not_judged_and_is_no_baseline(result):
    reduction = result.reduction
    first = reduction.base[0]
    names = tuple("x" if k == first else name for k, name in enumerate(reduction.names))
    fewer = replace(result, reduction=replace(reduction, names=names))
    assert compare([result, fewer]).runs[1].comparison is None
    with pytest.raises(WrongUsage, match="other joints, base parameters"):
        compare([fewer], baseline=result)


def test_the_table_has_one_row_per_run_and_the_worst_joint(result, other):
    table = compare([result, other]).table()
    assert [row["run"] for row in table] == ["run 1", "run 2"]
    worst = max(result.joints, key=lambda joint: joint.relative_percent)
    assert table[0]["weakest joint"] == f"{worst.joint} {worst.relative_percent:.1f} %"
