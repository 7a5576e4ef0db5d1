"""Gains of the drives from currents of a simulated arm, against those that were put in."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import LOAD, recorded
from test_stack import stacked

import models
from dynid.estimation.drive_gains import find_gains, known_load

GAINS = np.array([11.0, 9.5, 8.0, 7.0, 3.5, 3.0, 2.4])


@pytest.fixture(scope="module")
def base():
    return models.shipped("kuka_lwr4plus")


def currents(base, seed, load=None):
    log = recorded(seed, load)[1]
    log = replace(log, tau=log.tau / GAINS, tau_unit="A")
    return stacked(base, log, cutoff=6.0)


@pytest.fixture(scope="module")
def empty(base):
    return currents(base, 11)


@pytest.fixture(scope="module")
def loaded(base):
    return currents(base, 12, LOAD)


def test_a_load_that_is_known_whole_tells_them_better(base, empty, loaded):
    with_tool = replace(base, model=replace(base.model, robot=replace(base.robot, tool=LOAD)))
    found = find_gains(empty, np.full(7, np.nan), known_load(with_tool, loaded, None))
    assert found.gain == pytest.approx(GAINS, rel=0.03)


def test_one_known_gain_tells_the_others(empty):
    known = np.full(7, np.nan)
    known[1] = GAINS[1]
    assert find_gains(empty, known).gain == pytest.approx(GAINS, rel=0.05)


def test_gains_found_from_a_known_one_are_as_uncertain_as_that(empty):
    known = np.full(7, np.nan)
    known[2] = GAINS[2]
    sure, unsure = find_gains(empty, known), find_gains(empty, known, scale_error=0.05)
    assert unsure.gain == pytest.approx(sure.gain)
    assert unsure.std_error[2] == pytest.approx(0.05 * GAINS[2])
    assert unsure.std_error**2 == pytest.approx(sure.std_error**2 + (0.05 * sure.gain) ** 2)
    relative = find_gains(empty, np.full(7, np.nan), scale_error=0.05)
    assert relative.std_error == pytest.approx(find_gains(empty, np.full(7, np.nan)).std_error)


def test_without_any_size_the_ratios_are_found(empty):
    found = find_gains(empty, np.full(7, np.nan))
    assert found.relative
    assert found.gain == pytest.approx(GAINS / np.exp(np.mean(np.log(GAINS))), rel=0.05)
