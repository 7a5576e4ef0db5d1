"""Old and new logs of other motion: which joints have changed, and by how much, with nothing but the logs."""

from dataclasses import replace

import numpy as np
import pytest

from dynid.gap.change import change_test, still_changed, with_always_missing
from dynid.gap.problem import make_problem


@pytest.mark.parametrize(
    ("lacking", "before", "now", "repeats"),
    [
        (lambda q, qd: np.sin(q[:, 0] + 2.0 * q[:, 1]), (1, 2), (5, 6), 1),
        (lambda q, qd: np.cos(q[:, 0] + 2.0 * q[:, 1]) * qd[:, 1], (3,), (4,), 2),
        (lambda q, qd: np.tanh((q[:, 1] - 0.5) / 0.05), (3,), (4,), 1),
    ],
)
def test_what_a_model_lacks_on_another_motion_is_no_change(
    twolinks, on_joint, lacking, before, now, repeats
):
    """Torques ten times the noise and more that no column says, in old and new logs alike, which move elsewhere."""
    there = lambda t, q, qd, qdd: on_joint(1, lacking(q, qd))  # noqa: E731
    old = twolinks.logs(there, plans=before, repeats=repeats)
    kept = twolinks.kept(old)
    problem = make_problem(
        twolinks.logs(there, plans=now, repeats=repeats, first=20), twolinks.base, kept, old
    )
    assert still_changed(problem, []).joints == ()


def test_what_shakes_a_joint_since_then_has_changed_it_though_no_parameters_absorb_it(
    twolinks, on_joint, old, kept
):
    """A vibration that none of the columns follows: old and new logs ask for the same parameters."""
    shake = lambda t, q, qd, qdd: on_joint(1, 0.15 * np.sin(2.0 * np.pi * 3.0 * t))  # noqa: E731
    problem = make_problem(twolinks.logs(shake, plans=(5, 6), first=20), twolinks.base, kept, old)
    change = still_changed(problem, [])
    assert change.joints == (1,)
    assert change.more[1] > 1.5


@pytest.mark.parametrize(("shaken", "joints"), [(0.0, ()), (0.25, (1,))])
def test_rows_of_like_speed_tell_whether_new_logs_leave_more(twolinks, on_joint, shaken, joints):
    """A joint that rings the more the faster it turns, then and now, and shakes jointly with that since."""

    def rings(shaken):
        return lambda t, q, qd, qdd: on_joint(
            1, 0.4 * np.abs(qd[:, 1]) * np.sin(20.0 * t) + shaken * np.sin(2.0 * np.pi * 3.7 * t)
        )

    old = twolinks.logs(rings(0.0), plans=(1, 2))
    kept = twolinks.kept(old)
    problem = make_problem(
        twolinks.logs(rings(shaken), plans=(5, 6), first=20), twolinks.base, kept, old
    )
    assert still_changed(problem, []).joints == joints


def test_rows_that_are_few_prove_no_change(twolinks, old, kept, more_friction):
    """Half as many rows as parameters: one set for them alone fits anything, and foretells nothing."""
    problem = make_problem(
        twolinks.logs(more_friction, plans=(5,), repeats=1, first=20), twolinks.base, kept, old
    )
    few = problem.rows.train & (problem.rows.is_new <= (problem.rows.at < 12))
    assert still_changed(replace(problem, rows=replace(problem.rows, train=few)), []).joints == ()


def test_the_growth_is_that_of_fits_of_all_rows_at_once(twolinks, old, kept, more_friction):
    """Chow's statistic by least squares of stacked, weighted rows instead of normal equations."""
    problem = make_problem(
        twolinks.logs(more_friction, plans=(5, 6), first=20), twolinks.base, kept, old
    )
    wide, held = with_always_missing(problem, problem.rows)
    found = change_test(wide, held)
    eras = [
        [stacked(wide, wide.train & (wide.is_new == is_new), j) for j in range(2)]
        for is_new in (False, True)
    ]

    def left(groups, sigma):
        """Return what one set of parameters leaves of each joint of each group."""
        A = np.vstack(
            [rows[:, :-1] / s for group in groups for rows, s in zip(group, sigma, strict=True)]
        )
        y = np.concatenate(
            [rows[:, -1] / s for group in groups for rows, s in zip(group, sigma, strict=True)]
        )
        prior = np.zeros((len(held), A.shape[1]))
        prior[:, : held.shape[1] - 1] = held[:, :-1]
        # Known errors are one standard deviation each.
        known = np.eye(A.shape[1])[held.shape[1] - 1 :]
        value = np.concatenate([y, held[:, -1], np.zeros(len(known))])
        x = np.linalg.lstsq(np.vstack([A, prior, known]), value, rcond=1e-9)[0]
        return np.array(
            [[np.sum((rows[:, -1] - rows[:, :-1] @ x) ** 2) for rows in group] for group in groups]
        )

    counts = np.array([[len(rows) for rows in era] for era in eras]).sum(axis=0)
    sigma = np.sqrt(sum(left([era], np.ones(2))[0] for era in eras) / counts)
    apart = sum(left([era], sigma)[0] for era in eras)
    np.testing.assert_allclose(
        found.growth, np.sqrt(left(eras, sigma).sum(axis=0) / apart), rtol=2e-3
    )


def stacked(rows, chosen, joint):
    """Return the rows [columns, torque] of one joint, columns that are not judged at their own place."""
    extra = [rows.turns[k] * (k == joint) for k in range(2)]
    found = np.column_stack([rows.W[:, joint], *(x.T for x in extra), rows.tau[:, joint]])
    return found[chosen & rows.use[:, joint]]
