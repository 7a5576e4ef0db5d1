"""What identify is told besides its log, through the command line: bodies, a load for currents, an earlier result."""

from dataclasses import replace

import numpy as np
import pytest
from loaded_arm import LOAD, PLANT, ROBOT, recorded
from test_loads import GAINS

import dynid
from dynid import Identification
from dynid.model.attached import attached
from dynid.robot import Coulomb
from dynid.sim.sines import SineSpec, sines
from dynid.sim.urdf import urdf_text

slow = pytest.mark.slow
#: The logs are short: a condition number of 1900 is not what is tested here.
COMMON = "--drop-weak --no-report --json"
LOADED = f"identify amperes.yaml empty.csv --loaded loaded.csv --load-mass 1.8 {COMMON}"


@pytest.fixture(scope="module")
def shop(workshop):
    """A folder with short logs, currents of two motions, one with a load, and robot files with what they need."""
    run = workshop()
    for name, seed in (("log", 11), ("one", 41), ("two", 42)):
        log = recorded(seed, seconds=15.0)
        np.savez(run.folder / f"{name}.npz", t=log.t, q=log.q, tau=log.tau)
    names = [f"{kind}_{joint}" for kind in "qi" for joint in ROBOT.joint_names]
    options = {"delimiter": ",", "header": ",".join(["t", *names]), "comments": "", "fmt": "%.9g"}
    for name, seed, load in (("empty", 11, None), ("loaded", 12, LOAD)):
        log = recorded(seed, load)
        columns = np.column_stack([log.t, log.q, log.tau / GAINS])
        np.savetxt(run.folder / f"{name}.csv", columns, **options)
    text = ROBOT.path.read_text()
    # Why a width of the file: an update keeps the one that the first log told, the fit on both asks both.
    smooth = f"{text}\ncoulomb: {{shape: smooth, velocity: 0.57}}\n"
    (run.folder / "smooth.yaml").write_text(smooth)
    lines = [line for line in text.splitlines() if not line.startswith("torque:")]
    lines.append("torque: {source: motor_current, gain: null}\n")
    (run.folder / "amperes.yaml").write_text("\n".join(lines))
    (run.folder / "arm.urdf").write_text(urdf_text(ROBOT, PLANT.bodies))
    return run


# ---------------------------------------------------------------- what the user knows of the bodies
def links(shop, options):
    line = f"identify kuka_lwr4plus log.npz --force --json --no-report {options}"
    return shop(line).facts["links"]


@slow
def test_bounds_on_masses_and_centres_of_mass_are_kept(shop):
    bounds = "--total-mass 17.0:17.5 --link-mass 3=2.9:3.1 --com-box 1=-1,-1,-1:1,1,-0.05"
    found = links(shop, bounds)
    assert 17.0 <= sum(link["mass_kg"] for link in found) <= 17.5
    assert 2.9 <= found[2]["mass_kg"] <= 3.1
    assert found[0]["com_m"][2] <= -0.05


def test_a_prior_from_a_urdf_lies_in_the_frames_of_the_dh_table(shop):
    found = attached(shop.folder / "arm.urdf", ROBOT).prior().links
    for one, true in zip(found, PLANT.bodies, strict=True):
        assert one.parameters() == pytest.approx(true.parameters(), abs=1e-9)


@slow
def test_a_prior_from_a_file_fills_what_the_log_leaves_open(shop):
    """Root mean squares: noise may move one link's mass by 10 % at the cost of its neighbour, over five such logs."""

    def misses(options):
        ratio = [
            link["mass_kg"] / body.mass
            for link, body in zip(links(shop, options), PLANT.bodies, strict=True)
        ]
        return np.sqrt(np.mean((np.array(ratio) - 1) ** 2))

    with_prior = misses("--prior arm.urdf")
    assert with_prior < 0.05
    assert misses("--drop-weak") > 3 * with_prior


# ---------------------------------------------------------------- logs in amperes
@slow
def test_a_load_of_known_mass_makes_newton_metres_of_amperes_and_is_identified_with_them(shop):
    answer = shop(f"{LOADED} -o scaled").facts
    assert [each["gain_nm_per_a"] for each in answer["gains"]] == pytest.approx(GAINS, rel=0.03)
    assert "rms_nm" in answer["joints"][0]
    line = "identify scaled/amperes.yaml loaded.csv --payload-from scaled/parameters.npz"
    payload = shop(f"{line} {COMMON}").facts["payload"]
    assert payload["mass_kg"] == pytest.approx(LOAD.mass, rel=0.03)
    assert payload["com_m"] == pytest.approx(LOAD.com, abs=0.003)
    assert payload["std_error"]["mass_kg"] > 0


@slow
def test_without_gains_the_answer_is_in_amperes(shop):
    answer = shop(f"identify amperes.yaml empty.csv -o amperes {COMMON}").facts
    assert {"rms_a", "heldout_rms_a"} <= set(answer["joints"][0])
    assert answer["gains_relative"]
    assert not any(row["prior"] for row in answer["parameters"])
    assert not any(key.endswith("_nm") for joint in answer["joints"] for key in joint)
    assert answer["heldout_relative_error_percent"] < 2
    checked = shop("validate amperes/parameters.npz loaded.csv --no-plot --json").facts
    assert "rms_a" in checked["joints"][0]


def test_a_load_without_its_mass_is_refused(shop):
    assert shop("identify amperes.yaml empty.csv --loaded loaded.csv -o none").status == 2


# ---------------------------------------------------------------- an earlier result
def updated(shop, words):
    line = "identify smooth.yaml --cutoff 6 --delay off --json --no-report"
    return shop(f"{line} {words}").facts


@slow
def test_an_updated_result_equals_the_fit_on_both_logs(shop):
    updated(shop, "one.npz -o first --method ols")
    shop("validate first/parameters.npz empty.csv").failed(2)
    answers = [
        updated(shop, f"{words} --method ols")
        for words in (
            "two.npz -o updated --update first/parameters.npz",
            "one.npz two.npz -o batch",
        )
    ]
    one, other = (
        Identification.load(shop.folder / name / "parameters.npz") for name in ("updated", "batch")
    )
    sigma = np.sqrt(np.diagonal(other.covariance))
    assert np.abs((one.plain - other.plain) / sigma).max() < 1e-6
    assert 0.7 < np.median(np.sqrt(np.diagonal(one.covariance)) / sigma) < 1.4
    errors = [answer["relative_error_percent"] for answer in answers]
    assert errors[0] == pytest.approx(errors[1], rel=1e-9)
    assert one.log_sha256 == other.log_sha256


@slow
def test_an_updated_result_may_take_the_place_of_the_old_one_but_the_same_log_is_not_added(shop):
    updated(shop, "one.npz -o place --method wls")
    again = "--update place/parameters.npz -o none"
    assert shop(f"identify kuka_lwr4plus one.npz {again}").status == 2
    updated(shop, "two.npz -o place --update place/parameters.npz")
    assert len(Identification.load(shop.folder / "place/parameters.npz").log_sha256) == 2


# ---------------------------------------------------------------- the width of the Coulomb step
def logs_of(width):
    """Two motions of a SCARA whose friction turns within a width [rad/s or m/s]."""
    arm = dynid.load_robot("scara")
    turns = replace(arm, coulomb=Coulomb("smooth", (width,) * arm.n))
    motions = [
        sines(arm, SineSpec(15.0, 3.0, 0.8, 0.9, 0.9, -np.inf), 0.002, np.random.default_rng(k))
        for k in (1, 2)
    ]
    return arm, turns, [dynid.simulate(turns, m, seed=k).log for k, m in enumerate(motions)]


def test_the_width_lies_in_its_interval_and_predicts_as_the_true_one(tmp_path):
    arm, turns, (log, unseen) = logs_of(0.003)
    result = dynid.identify(arm, log)
    found = result.robot.coulomb_shape
    for j in (0, 1, 3):
        low, high = found.interval[j]
        assert 0.8 * low < 0.003 < 1.2 * high
    assert result.robot.model_key == arm.model_key
    both = [dynid.validate(each, unseen) for each in (result, dynid.identify(turns, log))]
    assert both[0].relative_error_percent < 1.1 * both[1].relative_error_percent
    result.save(tmp_path / "parameters.npz")
    assert dynid.load(tmp_path).robot.coulomb_shape == found


def test_a_width_of_the_file_stays_and_so_does_the_usual_one_where_logs_do_not_contradict_it():
    arm, turns, (log, _) = logs_of(0.01)
    assert dynid.identify(turns, log).robot.coulomb_shape == turns.coulomb
    velocity = np.array(dynid.identify(arm, log).robot.coulomb_shape.velocity)
    assert np.abs(np.log(velocity[[0, 1, 3]] / 0.01)).max() < 0.2
