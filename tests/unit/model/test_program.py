"""The straight-line program and its interpreter against plain Python arithmetic."""

import numpy as np
import pytest

from dynid.files.robotfile import load_robot
from dynid.model import build_model, tuning
from dynid.model.kinematics import geometry
from dynid.model.printing import as_latex, as_python
from dynid.model.program import ADD, MUL, NEG, SUB, Evaluator


@pytest.fixture(scope="module")
def model():
    return build_model(load_robot("scara"))


def evaluated(program, robot, states):
    """Return the matrices of a program at states, (N, rows, columns)."""
    found = np.zeros((len(states[0]), *program.shape))
    found[:, program.rows, program.cols] = Evaluator(program, robot, len(states[0])).run(*states).T
    return found


def by_hand(program, values):
    """Evaluate a program one operation at a time, as its definition says."""
    slots = [values[name] for name in program.inputs] + [float(c) for c in program.constants]
    for op, a, b in zip(program.op, program.lhs, program.rhs, strict=True):
        x, y = slots[a], slots[b]
        slots.append({ADD: x + y, SUB: x - y, MUL: x * y, NEG: -x}[int(op)])
    matrix = np.zeros(program.shape)
    for row, col, slot in zip(program.rows, program.cols, program.outputs, strict=True):
        matrix[row, col] = slots[slot]
    return matrix


def test_the_interpreter_computes_what_the_operations_say(model):
    rng = np.random.default_rng(0)
    n = model.robot.n
    q, qd, qdd = rng.normal(size=(3, 5, n))
    program = model.rigid
    found = evaluated(program, model.robot, (q, qd, qdd))
    for k in range(5):
        values = geometry(model.robot)
        for i, joint in enumerate(model.robot.joints, start=1):
            values |= {f"q{i}": q[k, i - 1], f"qd{i}": qd[k, i - 1], f"qdd{i}": qdd[k, i - 1]}
            if joint.revolute:
                angle = q[k, i - 1] + joint.theta_offset
                values |= {f"c{i}": np.cos(angle), f"s{i}": np.sin(angle)}
        expected = by_hand(program, values)
        assert found[k] == pytest.approx(expected, abs=1e-12)


def test_blocks_give_the_same_as_single_samples(model):
    rng = np.random.default_rng(1)
    states = rng.normal(size=(3, tuning.BLOCK_SAMPLES + 7, model.robot.n))
    whole = model.regressor(*states)
    for k in (0, tuning.BLOCK_SAMPLES - 1, tuning.BLOCK_SAMPLES, tuning.BLOCK_SAMPLES + 6):
        assert whole[k] == pytest.approx(model.regressor(*states[:, k : k + 1])[0], abs=1e-13)


def test_a_restricted_program_gives_the_same_columns_with_fewer_operations(model):
    columns = np.array([4, 0, 12, 21])
    part = model.rigid.restricted(columns)
    assert part.flops < model.rigid.flops
    rng = np.random.default_rng(2)
    states = rng.normal(size=(3, 3, model.robot.n))
    dense, got = (evaluated(each, model.robot, states) for each in (model.rigid, part))
    assert got == pytest.approx(dense[:, :, columns], abs=1e-14)


def test_the_printed_function_computes_the_regressor(model):
    space = {}
    exec(as_python(model), space)
    rng = np.random.default_rng(3)
    q, qd, qdd = rng.normal(size=(3, 4, model.robot.n))
    printed = space["regressor"](q.T, qd.T, qdd.T)
    dense = evaluated(model.rigid, model.robot, (q, qd, qdd))
    assert np.moveaxis(printed, -1, 0) == pytest.approx(dense, abs=1e-13)


def test_the_latex_shows_each_entry(model):
    text = as_latex(model)
    assert text.count("P_{") == len(model.rigid.rows)
    assert text.startswith(r"\begin{align*}")
