"""Logs in amperes through the command line."""

import json

import numpy as np
import pytest
from loaded_arm import LOAD, ROBOT, recorded
from test_loads import GAINS

pytestmark = pytest.mark.slow

#: The logs are short: a condition number of 1900 is not what is tested here.
LOADED = ("--loaded", "loaded.csv", "--load-mass", "1.8", "--drop-weak", "--no-report")


@pytest.fixture(scope="module")
def shop(workshop):
    """A robot file with unknown gains and the currents of two motions, one with a load."""
    run = workshop()
    for name, seed, load in (("empty", 11, None), ("loaded", 12, LOAD)):
        log = recorded(seed, load)
        names = [f"{kind}_{joint}" for kind in "qi" for joint in ROBOT.joint_names]
        rows = np.column_stack([log.t, log.q, log.tau / GAINS])
        np.savetxt(
            run.folder / f"{name}.csv",
            rows,
            delimiter=",",
            header=",".join(["t", *names]),
            comments="",
            fmt="%.9g",
        )
    text = "".join(
        line
        for line in ROBOT.path.read_text().splitlines(keepends=True)
        if not line.startswith("torque:")
    )
    (run.folder / "arm.yaml").write_text(text + "torque: {source: motor_current, gain: null}\n")
    return run


def test_a_load_of_known_mass_makes_newton_metres_of_amperes(shop):
    done = shop("identify", "arm.yaml", "empty.csv", *LOADED, "--json")
    answer = json.loads(done.out)
    assert done.status == 0, done.err
    assert [each["gain_nm_per_a"] for each in answer["gains"]] == pytest.approx(GAINS, rel=0.03)
    assert "rms_nm" in answer["joints"][0]


def test_without_gains_the_answer_is_in_amperes(shop):
    words = ("-o", "amperes", "--drop-weak", "--json", "--no-report")
    answer = json.loads(shop("identify", "arm.yaml", "empty.csv", *words).out)
    assert {"rms_a", "heldout_rms_a"} <= set(answer["joints"][0])
    assert answer["gains_relative"]
    assert not any(key.endswith("_nm") for joint in answer["joints"] for key in joint)
    assert answer["heldout_relative_error_percent"] < 2
    checked = json.loads(
        shop("validate", "amperes/parameters.npz", "loaded.csv", "--no-plot", "--json").out
    )
    assert "rms_a" in checked["joints"][0]


def test_a_load_without_its_mass_is_refused(shop):
    assert (
        shop("identify", "arm.yaml", "empty.csv", "--loaded", "loaded.csv", "-o", "none").status
        == 2
    )


def test_the_load_of_a_second_log_is_identified(shop):
    first = shop("identify", "arm.yaml", "empty.csv", *LOADED, "-o", "scaled")
    assert first.status == 0, first.err
    again = ("--payload-from", "scaled/parameters.npz", "--drop-weak", "--json", "--no-report")
    done = shop("identify", "scaled/arm.yaml", "loaded.csv", *again)
    payload = json.loads(done.out)["payload"]
    assert payload["mass_kg"] == pytest.approx(LOAD.mass, rel=0.03)
    assert payload["com_m"] == pytest.approx(LOAD.com, abs=0.003)
    assert payload["std_error"]["mass_kg"] > 0
