"""The observer in C gives the torques of the one in Python; a controller at 1 kHz has time for it."""

import ctypes
import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest

import dynid
from dynid import ExportOptions, export
from dynid.errors import WrongUsage
from dynid.estimation import tuning
from dynid.estimation.contacts import inertial_columns, own_parameters
from dynid.estimation.momentum_observer import MomentumObserver
from dynid.exporters.languages import compiled, pointer
from dynid.sim.sines import SineSpec, sines

ROOT = Path(__file__).parents[3]
pytestmark = pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")


@pytest.fixture(scope="module")
def written(result, tmp_path_factory):
    folder = tmp_path_factory.mktemp("observer")
    export(result, folder / "arm.c", ExportOptions(observer=True))
    return folder / "arm.c"


def test_c_and_python_observe_the_same_torque(result, written):
    """1000 steps of a motion with a push: rounding."""
    assert_equal(result, written)


@pytest.mark.parametrize("name", ["scara", "staubli_tx40"])
def test_they_do_so_for_arms_that_slide_and_whose_motors_are_coupled(name, tmp_path):
    """The SCARA has a sliding joint; the TX40 has modified DH and a motor that turns two joints."""
    robot, rng = dynid.load_robot(name), np.random.default_rng(3)
    spec = SineSpec(10.0, 10.0, 0.4, 0.5, 0.3, 0.03)
    logs = [dynid.simulate(robot, sines(robot, spec, 5e-3, rng)).log for _ in range(2)]
    found = dynid.identify(robot, logs)
    export(found, tmp_path / "arm.c", ExportOptions(observer=True))
    assert_equal(found, tmp_path / "arm.c")


def test_they_do_so_where_the_torque_of_a_joint_contradicts_the_others(tmp_path):
    robot, rng = dynid.load_robot("kuka_lwr4plus"), np.random.default_rng(5)
    spec = SineSpec(12.0, 10.0, 0.6, 0.7, 0.5, 0.03)
    logs = [dynid.simulate(robot, sines(robot, spec, 5e-3, rng), noise=0.01).log for _ in range(2)]
    for log in logs:
        log.tau[:, 3] *= -1.0
    found = dynid.identify(robot, logs, anyway=True)
    assert 3 in own_parameters(found)
    export(found, tmp_path / "arm.c", ExportOptions(observer=True))
    assert_equal(found, tmp_path / "arm.c")


def assert_equal(result, written):
    library, n, dt = compiled(written), result.robot.n, 2e-3
    t = dt * np.arange(1000)[:, None]
    size = np.linspace(0.2, 0.4, n)
    q, qd, qdd = size * np.sin(3 * t), 3 * size * np.cos(3 * t), -9 * size * np.sin(3 * t)
    tau = result.inverse_dynamics(q, qd, qdd, t[:, 0])
    tau[400:600] -= 2.0
    inertial, error = inertial_columns(result), result.model_error
    W = result.regressor(q, qd, np.zeros_like(q), t[:, 0])
    other = W[:, :, ~inertial] @ result.theta[~inertial]
    if error is not None:
        other += error.torque_of(q, qd, result.base.observer.coulomb_sign(qd), W)
        other -= np.einsum("mjp,jp->mj", W[:, :, inertial], error.own[:, inertial])
    ours = MomentumObserver(
        result.base.observer, result.theta, inertial, tuning.OBSERVER_GAIN, own_parameters(result)
    )
    expected = ours.run(q, qd, tau, other, dt)
    state, found = np.zeros(1 + 4 * n), np.empty_like(q)
    for k in range(len(q)):
        rows = (pointer(row[k]) for row in (q, qd, tau))
        library.dynid_observer_step(pointer(state), *rows, ctypes.c_double(dt), pointer(found[k]))
    np.testing.assert_allclose(found, expected, atol=1e-10)
    assert np.abs(found[550]).min() > 1.0, "the push is there"
    assert np.abs(found[:400]).max() < 0.1, "and nothing before"


def test_the_threshold_in_c_holds_what_friction_may_differ_by(result, written):
    library, n = compiled(written), result.robot.n
    at = {}
    for speed in (0.0, 1.0, 2.0):
        threshold, qd = np.empty(n), np.full(n, speed)
        library.dynid_contact_threshold(pointer(qd), pointer(threshold))
        at[speed] = threshold
    coulomb, viscous = (
        np.array([abs(result.params.get(f"{kind}{j + 1}", 0.0)) for j in range(n)])
        for kind in ("fc", "fv")
    )
    np.testing.assert_allclose(at[2.0] - at[1.0], tuning.FRICTION_LEVEL * viscous, atol=1e-9)
    moving = tuning.FRICTION_LEVEL * (coulomb + viscous)
    np.testing.assert_allclose(
        at[0.0] - at[1.0], (1 + tuning.STATIC_SHARE) * coulomb - moving, atol=1e-9
    )


def test_the_controller_of_the_docs_compiles_and_its_step_is_short(result, written):
    """Gravity, friction, inverse dynamics and the observer in one step; the program prints its own time."""
    example = ROOT / "docs" / "examples" / "controller.c"
    program = written.parent / "controller"
    words = [
        "cc",
        "-O2",
        "-std=c99",
        f'-DMODEL="{written}"',
        str(example),
        "-o",
        str(program),
        "-lm",
    ]
    subprocess.run(words, check=True, capture_output=True)
    said = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    assert "us a step" in said
    assert float(said.split()[0]) < 1000.0


def test_an_observer_is_for_c_only(result, tmp_path):
    with pytest.raises(WrongUsage, match="--observer is for"):
        export(result, tmp_path / "arm.py", ExportOptions(observer=True))
