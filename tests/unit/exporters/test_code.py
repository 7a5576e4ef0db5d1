"""C, Python and MATLAB give dynid's torques, and their parts obey the laws of mechanics."""

import ctypes
import re
import shutil
import subprocess
from dataclasses import replace
from pathlib import Path

import numpy as np
import pinocchio as pin
import pytest
from export_cases import SHIPPED, made, random, random_model_error, shipped, with_effect, written
from numpy.testing import assert_allclose

from arms import pinocchio_model
from dynid import load_robot
from dynid.exporters import FORMATS
from dynid.exporters.code import compiled, imported, pointer
from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.reduce import random_states
from dynid.robot import Coulomb, EffectSpec

PAPER = replace(load_robot("scara"), coulomb=Coulomb("threshold", (0.5,) * 4))


@pytest.mark.parametrize("format", ["c", "python"])
@pytest.mark.parametrize("robot", [*SHIPPED, PAPER], ids=[*SHIPPED, "the paper's Eq. 7"])
def test_written_code_gives_dynids_torques(robot, format):
    """1000 states, friction included, coupled motors of the TX40 and the paper's Coulomb threshold too: 1e-10 N m."""
    source = shipped(robot) if isinstance(robot, str) else made(robot)
    (agreement,) = FORMATS[format].check(FORMATS[format].text(source), source)
    assert agreement.states == 1000
    assert agreement.largest < 1e-10


def by_hand(arm, error, q, qd, qdd):
    """Torques of the parameters and of the residual model, from its equation, one state and joint after the other."""
    observer = arm.base.observer
    W, signs = observer.dense(q, qd, qdd), observer.coulomb_sign(qd)
    tau = W @ arm.theta
    for m, j in np.ndindex(*q.shape):
        x, v, sign = q[m, j], abs(qd[m, j]) / error.speed[j], signs[m, j]
        waves = [f(k * x) for k in (1, 2, 3) for f in (np.sin, np.cos)]
        shapes = [np.exp(-v / least) for least in (0.1, 0.4, 1.6)]
        columns = np.array(
            [
                *waves,
                *(sign * np.array([*waves[:4], *shapes])),
                sign * abs(W[m, j] @ error.reference),
            ]
        )
        tau[m, j] += (columns / error.scale[j] - W[m, j] @ error.projection[j]) @ error.mean[j, :14]
        tau[m, j] += W[m, j] @ error.own[j]
    return tau


@pytest.mark.parametrize("format", ["c", "python"])
@pytest.mark.parametrize("robot", ["scara", "staubli_tx40"])
def test_code_predicts_with_the_residual_model(robot, format):
    alone = shipped(robot)
    error = random_model_error(alone)
    source = replace(alone, model_error=error)
    q, qd, qdd = random_states(source.robot, 20, 3)
    found = FORMATS[format].loaded(FORMATS[format].text(source), source)
    expected = by_hand(source, error, q, qd, qdd)
    assert_allclose(found.theirs(q, qd, qdd), expected, rtol=1e-9, atol=1e-9)
    assert_allclose(found.ours(q, qd, qdd), expected, rtol=1e-9, atol=1e-9)


def test_files_say_whether_they_have_the_residual_model():
    source = replace(shipped("scara"), model_error=random_model_error(shipped("scara")))
    bare = replace(source, residual_model=False)
    assert "; with its residual model" in FORMATS["c"].text(source)
    assert "without the result's residual model" in FORMATS["c"].text(bare)
    assert "residual(" not in FORMATS["c"].text(bare)
    for name in ("urdf", "mjcf", "yaml"):
        assert "without the result's residual model" in FORMATS[name].text(source)
        assert any("residual model" in phrase for phrase in FORMATS[name].leaves_out(source))
    assert "residual model" not in FORMATS["c"].text(shipped("scara"))


@pytest.mark.optional
@pytest.mark.skipif(shutil.which("octave-cli") is None, reason="Octave is not installed")
@pytest.mark.parametrize("robot", ["scara", "staubli_tx40"])
def test_the_matlab_file_gives_dynids_torques_in_octave(robot, tmp_path):
    """1000 states: 1e-10 N m."""
    source = shipped(robot)
    states, n = random_states(source.robot, 1000, 0), source.robot.n
    name = written(source, "matlab", tmp_path).stem
    np.savetxt(tmp_path / "states.txt", np.hstack(states))
    script = (
        f"s = load('states.txt'); t = zeros(size(s, 1), {n}); "
        f"for k = 1:size(s, 1) r = reshape(s(k, :), {n}, 3); "
        f"t(k, :) = {name}('inverse_dynamics', r(:, 1), r(:, 2), r(:, 3)); end; "
        "save('-ascii', '-double', 'tau.txt', 't');"
    )
    words = ["octave-cli", "--norc", "--quiet", "--eval", script]
    subprocess.run(words, cwd=tmp_path, capture_output=True, check=True)
    expected = source.base.observer.torque(source.theta, *states)
    assert_allclose(np.loadtxt(tmp_path / "tau.txt"), expected, atol=1e-10)


@pytest.mark.parametrize("seed", range(3))
def test_mass_matrix_gravity_and_coriolis_are_pinocchios(seed):
    """The parts of the module equal those of the arm built by hand, rotors on the diagonal."""
    source = random(seed)
    full, robot = source.full, source.full.robot
    module = imported(FORMATS["python"].text(source))
    model = pinocchio_model(robot, full.bodies)
    data = model.createData()
    for q, qd, _ in zip(*random_states(robot, 10, seed), strict=True):
        upper = pin.crba(model, data, q)
        mass = np.triu(upper) + np.triu(upper, 1).T + np.diag(full.of_joints("Im"))
        assert_allclose(module.mass_matrix(q), mass, atol=1e-9)
        assert_allclose(module.gravity(q), pin.computeGeneralizedGravity(model, data, q), atol=1e-9)
        coriolis = pin.nonLinearEffects(model, data, q, qd) - pin.computeGeneralizedGravity(
            model, data, q
        )
        assert_allclose(module.coriolis(q, qd), coriolis, atol=1e-9)
        assert_allclose(module.coriolis_matrix(q, qd) @ qd, coriolis, atol=1e-9)


def test_the_coriolis_matrix_is_that_of_the_christoffel_symbols():
    """dM/dt - 2 C is skew-symmetric."""
    module = imported(FORMATS["python"].text(shipped("kinova_gen2")))
    rng = np.random.default_rng(3)
    q, qd, h = rng.uniform(-2, 2, 7), rng.normal(size=7), 1e-5
    rate = (module.mass_matrix(q + h * qd) - module.mass_matrix(q - h * qd)) / (2 * h)
    skew = rate - 2 * module.coriolis_matrix(q, qd)
    assert_allclose(skew + skew.T, 0.0, atol=1e-7)


@pytest.mark.skipif(shutil.which("cc") is None, reason="there is no C compiler")
def test_the_c_functions_are_those_of_the_python_module():
    """Regressor, gravity, friction, mass matrix, Coriolis torques and matrix."""
    source = shipped("kuka_lwr4plus")
    module = imported(FORMATS["python"].text(source))
    library = compiled(FORMATS["c"].text(source))
    q, qd, qdd = (row[0] for row in random_states(source.base.robot, 1, 5))

    def called(name, shape, *inputs):
        out = np.empty(shape)
        getattr(library, f"dynid_{name}")(
            *map(pointer, inputs), out.ctypes.data_as(ctypes.POINTER(ctypes.c_double))
        )
        return out

    p = len(source.theta)
    pairs = [
        (called("regressor", (7, p), q, qd, qdd), module.regressor(q, qd, qdd)),
        (called("gravity", 7, q), module.gravity(q)),
        (called("friction", 7, qd), module.friction(qd)),
        (called("mass_matrix", (7, 7), q), module.mass_matrix(q)),
        (called("coriolis", 7, q, qd), module.coriolis(q, qd)),
        (called("coriolis_matrix", (7, 7), q, qd), module.coriolis_matrix(q, qd)),
    ]
    for found, expected in pairs:
        assert_allclose(found, expected, atol=1e-12)


def test_parameters_that_the_data_did_not_determine_are_marked():
    """The head of each code file says so."""
    source = shipped("scara")
    source = replace(source, known=("not determined", *source.known[1:]))
    for format in ("c", "python", "matlab"):
        assert "not determined by the data" in FORMATS[format].text(source)


@pytest.mark.slow
@pytest.mark.parametrize("format", ["c", "python"])
def test_a_formula_is_part_of_the_code(format):
    """The torque by hand, joint 2 of the arm without any effect beside it."""
    robot, names = load_robot("kuka_lwr4plus"), load_robot("kuka_lwr4plus").joint_names
    said = "a cos(2 q2) |qd3| qd4^3 / (2 + sin(q1)^2) + b qdd1 sign(qd2)"
    specs = (
        EffectSpec("formula", (names[1],), {"a": 0.7, "b": -0.3}, {}, said),
        EffectSpec("formula", (names[3],), {"a": 0.01}, {}, "a qd4 t"),
    )
    bare, source = made(robot), made(replace(robot, effects=specs))
    sizes = {"formula2_a": 0.7, "formula2_b": -0.3, "formula4_a": 0.01}
    values = zip(source.base.names, source.theta, strict=True)
    source = replace(source, theta=np.array([sizes.get(name, value) for name, value in values]))
    q, qd, qdd = random_states(robot, 20, 3)
    law = 0.7 * np.cos(2 * q[:, 1]) * np.abs(qd[:, 2]) * qd[:, 3] ** 3 / (2 + np.sin(q[:, 0]) ** 2)
    law -= 0.3 * qdd[:, 0] * source.base.model.observer().coulomb_sign(qd)[:, 1]
    form = FORMATS[format]
    expected = form.loaded(form.text(bare), bare).theirs(q, qd, qdd)
    expected[:, 1] += law
    found = form.loaded(form.text(source), source).theirs(q, qd, qdd)
    assert_allclose(found, expected, rtol=1e-9, atol=1e-9)
    assert FORMATS[format].leaves_out(source) == (
        f"effect formula on {names[3]}: it depends on what was before, and code keeps no state",
    )
    (agreement,) = FORMATS[format].check(FORMATS[format].text(source), source)
    assert agreement.largest < 1e-10


@pytest.mark.slow
@pytest.mark.parametrize("format", ["c", "python"])
@pytest.mark.parametrize("name", CATALOGUE)
def test_every_effect_of_the_catalogue_is_code_or_its_absence_has_a_reason(name, format):
    """1000 states: an effect that is left out adds nothing, and is named."""
    source = with_effect(name)
    (agreement,) = FORMATS[format].check(FORMATS[format].text(source), source)
    assert agreement.agrees
    assert agreement.largest < 1e-9
    remembers = name in ("warmup_friction", "torque_drift", "presliding_hysteresis")
    whole_arm = name in ("encoder_offset", "base_tilt", "tool_force")
    left_out = ("joint_elasticity", "backlash", "torque_delay", "offset_step")
    without = remembers or whole_arm or name in left_out
    assert [name in phrase for phrase in FORMATS[format].leaves_out(source)] == [True] * without


@pytest.mark.skipif(shutil.which("cc") is None, reason="no C compiler")
def test_the_controller_of_the_docs_compiles_and_steps(tmp_path):
    """Gravity, friction and inverse dynamics in one step; the program prints its own time."""
    example = Path(__file__).parents[3] / "docs" / "examples" / "controller.c"
    arm, program = written(shipped("kuka_lwr4plus"), "c", tmp_path), tmp_path / "controller"
    words = ["cc", "-O2", "-std=c99", f'-DMODEL="{arm}"', str(example), "-o", str(program), "-lm"]
    subprocess.run(words, check=True, capture_output=True)
    said = subprocess.run([str(program)], check=True, capture_output=True, text=True).stdout
    assert re.match(r"[0-9.]+ us a step", said)
