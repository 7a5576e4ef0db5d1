"""Measured velocity against the change of position: unit, sign, column."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.errors import JointNamesDiffer
from dynid.signals.checks import prepare
from makelogs import gen2, gen2_log


def generic():
    """The Gen2 behind a driver whose velocity is to be believed."""
    return replace(gen2(), driver=replace(gen2().driver, kind="generic"))


def test_velocity_that_agrees_only_roughly_is_a_warning():
    log = prepare(replace(gen2_log(), qd=0.65 * gen2_log().qd), generic())
    assert [f.code for f in log.findings] == ["W308"] * 7
    assert "0.65 x the change of position" in log.findings[0].text


@pytest.mark.parametrize("pair", [(3, 4), (0, 6)])
def test_swapped_velocity_columns_are_named_in_pairs(pair):
    order = np.arange(13)
    order[list(pair)] = pair[::-1]
    broken = replace(gen2_log(), qd=gen2_log().qd[:, order])
    with pytest.raises(
        JointNamesDiffer,
        match=rf"joint_{pair[0] + 1} and j2s7s300_joint_{pair[1] + 1} look swapped",
    ) as caught:
        prepare(broken, generic())
    assert "0.99 swapped" in str(caught.value) or "1.00 swapped" in str(caught.value)
    assert prepare(replace(broken, qd=None), generic()).qd is None


def test_swapped_position_columns_are_seen_by_the_velocities():
    order = [0, 1, 2, 4, 3, 5, 6, *range(7, 13)]
    joints = tuple(
        replace(joint, limits=replace(joint.limits, position=None)) for joint in generic().joints
    )
    with pytest.raises(JointNamesDiffer, match="joint_4 and j2s7s300_joint_5 look swapped"):
        prepare(replace(gen2_log(), q=gen2_log().q[:, order]), replace(generic(), joints=joints))


def test_joints_that_all_move_alike_are_not_called_swapped():
    rng = np.random.default_rng(0)
    t = gen2_log().t
    size = np.linspace(0.4, 0.8, 13)
    swing, qd = np.outer(np.sin(0.6 * t), size) + np.pi, np.outer(0.6 * np.cos(0.6 * t), size)
    qd = (qd + rng.normal(0, 0.01, qd.shape))[:, [1, 0, *range(2, 13)]]
    free = replace(generic(), torque=replace(generic().torque, source="gravity_free"))
    prepare(replace(gen2_log(), q=swing, qd=qd), free)


def test_noise_on_the_velocity_is_no_fault():
    rng = np.random.default_rng(0)
    qd = gen2_log().qd + rng.normal(0, 0.05, gen2_log().qd.shape)
    assert prepare(replace(gen2_log(), qd=qd), generic()).findings == ()


def test_velocities_are_not_judged_while_nothing_moves():
    q = gen2_log().q
    noise = np.random.default_rng(0).normal(0, 0.01, q.shape)
    still = replace(gen2_log(), q=0 * q + q[0], qd=noise)
    assert prepare(still, generic(), identify=False).findings == ()


def test_a_velocity_of_zeros_was_never_measured():
    assert prepare(replace(gen2_log(), qd=0 * gen2_log().qd), generic()).qd is None


def test_kinovas_velocity_is_put_aside_with_its_ratio():
    log = prepare(replace(gen2_log(), qd=2 * gen2_log().qd), gen2())
    (finding,) = log.findings
    assert (finding.code, finding.level) == ("W308", "info")
    np.testing.assert_allclose(finding.evidence["slope"], 2.0, rtol=0.02)
    assert log.qd is None
    np.testing.assert_array_equal(log.extra["qd_reported"], 2 * gen2_log().qd[:, :7])


def test_a_velocity_that_is_not_used_may_have_holes():
    qd = gen2_log().qd.copy()
    qd[5, 3] = np.nan
    assert prepare(replace(gen2_log(), qd=qd), gen2()).qd is None
