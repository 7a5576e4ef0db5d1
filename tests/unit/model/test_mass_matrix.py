"""The mass matrix against the textbook two-link arm, and the alarm for a wrong sign in the driver's map."""

import numpy as np
import pytest

from dynid import identify
from dynid.diagnose.mistakes import Edit, edited
from dynid.model.regressor import indefinite_share, mass_matrices
from makelogs import gen2, gen2_log


def planar(a, b, c):
    """Two-link planar arm: M = [[a + 2 b cos q2, c + b cos q2], [c + b cos q2, c]], any velocity and gravity terms."""

    def torque(q, qd, qdd):
        cos, sin = np.cos(q[:, 1]), np.sin(q[:, 1])
        M = np.array([[a + 2 * b * cos, c + b * cos], [c + b * cos, c + 0 * cos]]).transpose(
            2, 0, 1
        )
        rest = np.stack(
            [
                9.81 * np.cos(q[:, 0]) - b * sin * qd[:, 1] ** 2 + 0.3,
                b * sin * qd[:, 0] ** 2 + qd[:, 1],
            ],
            1,
        )
        return (M @ qdd[:, :, None])[:, :, 0] + rest

    return torque


def test_columns_are_those_of_the_textbook_arm():
    q = np.random.default_rng(0).uniform(-3, 3, (50, 2))
    M, cos = mass_matrices(planar(2.0, 0.4, 0.3), q), np.cos(q[:, 1])
    assert np.allclose(M[:, 0, 0], 2.0 + 0.8 * cos)
    assert np.allclose(M[:, 0, 1], 0.3 + 0.4 * cos)
    assert np.allclose(M[:, 1, 1], 0.3)


def test_alarm_is_raised_exactly_where_the_determinant_turns_negative():
    q = np.random.default_rng(1).uniform(-3, 3, (2000, 2))
    good, bad = planar(2.0, 0.4, 0.3), planar(1.0, 0.9, 0.3)
    assert indefinite_share(good, q) == 0
    cos = np.cos(q[:, 1])
    negative = (1.0 + 1.8 * cos) * 0.3 - (0.3 + 0.9 * cos) ** 2 < 0
    assert indefinite_share(bad, q) == pytest.approx(np.mean(negative))


@pytest.mark.parametrize(
    "joint", [None, 1, *(pytest.param(k, marks=pytest.mark.slow) for k in (3, 5, 6))]
)
def test_an_alarm_is_raised_for_a_wrong_sign_alone_even_where_the_residual_hides_it(joint):
    robot = gen2() if joint is None else edited(gen2(), Edit("sign", (joint - 1.0,)))
    found = identify(robot, gen2_log(), feasible=False, anyway=True, drop_weak=True)
    assert found.relative_error_percent < 5.0
    alarms = [one.evidence["share"] for one in found.findings if one.code == "W405"]
    assert bool(alarms) == (joint is not None)
    assert all(share > 0.2 for share in alarms)
