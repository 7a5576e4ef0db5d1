"""The straight-line program in blocks, restricted to columns, and printed."""

import numpy as np
import pytest

from dynid import load_robot
from dynid.model import build_model, tuning
from dynid.model.printing import as_latex, as_python


@pytest.fixture(scope="module")
def model():
    return build_model(load_robot("scara"))


def test_blocks_give_the_same_as_single_samples(model):
    rng = np.random.default_rng(1)
    states = rng.normal(size=(3, tuning.BLOCK_SAMPLES + 7, model.robot.n))
    whole = model.regressor(*states)
    for k in (0, tuning.BLOCK_SAMPLES - 1, tuning.BLOCK_SAMPLES, tuning.BLOCK_SAMPLES + 6):
        assert whole[k] == pytest.approx(model.regressor(*states[:, k : k + 1])[0], abs=1e-13)


def test_the_printed_function_computes_the_regressor(model):
    space = {}
    exec(as_python(model), space)
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.normal(size=(3, 4, model.robot.n))
    printed = space["regressor"](q.T, qd.T, qdd.T)
    dense = model.regressor(q, qd, qdd)[:, :, : len(printed[0])]
    assert np.moveaxis(printed, -1, 0) == pytest.approx(dense, abs=1e-13)


def test_chosen_columns_are_those_of_the_whole(model):
    columns, states = np.array([4, 0, 12, 21]), np.random.default_rng(2).normal(size=(3, 3, 4))
    part = model.observer(columns).dense(*states)
    assert part == pytest.approx(model.regressor(*states)[:, :, columns], abs=1e-14)


def test_the_latex_shows_each_entry(model):
    text = as_latex(model)
    assert text.count("P_{") == len(model.rigid.rows)
    assert text.startswith(r"\begin{align*}")
