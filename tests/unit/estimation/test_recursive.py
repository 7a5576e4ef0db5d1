"""A result that is updated with a new log equals the fit on both logs."""

import json

import numpy as np
import pytest
from loaded_arm import recorded

from dynid import Identification
from makelogs import ROOT

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def shop(workshop):
    run = workshop()
    # Why a width of the file: an update keeps the one that the first log told, the fit on both asks both.
    text = (ROOT / "robots/kuka_lwr4plus.yaml").read_text()
    (run.folder / "arm.yaml").write_text(f"{text}\ncoulomb: {{shape: smooth, velocity: 0.57}}\n")
    for name, seed in (("one", 41), ("two", 42)):
        log = recorded(seed, seconds=15.0)
        np.savez(run.folder / f"{name}.npz", t=log.t, q=log.q, tau=log.tau)
    return run


def run(shop, *words):
    done = shop(
        "identify",
        "arm.yaml",
        *words,
        "--cutoff",
        "6",
        "--delay",
        "off",
        "--json",
        "--no-report",
    )
    assert done.status == 0, done.err
    return json.loads(done.out)


def test_an_updated_result_equals_the_fit_on_both_logs(shop):
    run(shop, "one.npz", "-o", "first", "--method", "ols")
    updated = run(
        shop, "two.npz", "-o", "updated", "--update", "first/parameters.npz", "--method", "ols"
    )
    batch = run(shop, "one.npz", "two.npz", "-o", "batch", "--method", "ols")
    one, other = (
        Identification.load(shop.folder / name / "parameters.npz") for name in ("updated", "batch")
    )
    sigma = np.sqrt(np.diagonal(other.covariance))
    assert np.abs((one.plain - other.plain) / sigma).max() < 1e-6
    ratio = np.sqrt(np.diagonal(one.covariance)) / sigma
    assert 0.7 < np.median(ratio) < 1.4
    assert updated["relative_error_percent"] == pytest.approx(
        batch["relative_error_percent"], rel=1e-9
    )
    assert one.log_sha256 == other.log_sha256


def test_the_same_log_is_not_added_twice(shop):
    run(shop, "one.npz", "-o", "twice")
    done = shop(
        "identify", "kuka_lwr4plus", "one.npz", "--update", "twice/parameters.npz", "-o", "none"
    )
    assert done.status == 2


def test_an_updated_result_may_take_the_place_of_the_old_one(shop):
    run(shop, "one.npz", "-o", "place", "--method", "wls")
    run(shop, "two.npz", "-o", "place", "--update", "place/parameters.npz")
    assert len(Identification.load(shop.folder / "place" / "parameters.npz").log_sha256) == 2
