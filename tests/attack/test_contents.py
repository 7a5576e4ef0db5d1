"""Results with one odd fact or array: only mistakes with a message come out of their readers, and nothing behind them fails."""

from __future__ import annotations

import copy
import importlib
import json
import pkgutil
import shutil
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from inputs import ROBOT, first_seed, inputs_wanted

import dynid
from dynid.errors import DynidError, JointCountDiffers, RankDeficient, WrongUsage
from dynid.estimation import observation_files, prediction, result_files
from dynid.estimation.compare import compare
from dynid.estimation.payload import find_payload
from dynid.estimation.posterior import parameter_posterior
from dynid.files import artifact
from dynid.files.contents import Contents
from dynid.files.trajectoryfile import read_trajectory
from dynid.gap import record
from dynid.gap.record import read_record
from dynid.model import base_model as store
from dynid.model.base_model import BaseModel
from dynid.npz import read_npz
from dynid.reports.gathered import _spectrum, gather, relative_percent
from dynid.sim import comparison
from dynid.sim.comparison import SimulatorGap
from dynid.workflows.earlier_information import require_same_arm
from dynid.workflows.gap_result import with_methods
from dynid.workflows.identify import identify
from dynid.workflows.model import base_model
from dynid.workflows.parameters import load_observations
from dynid.workflows.robots import load_robot
from dynid.workflows.trajectory import trajectory_of

STATES = np.random.default_rng(0).standard_normal((3, 20, 2))


def identification(path: Path, robot) -> None:
    found = dynid.load(path)
    found.summary(), found.links(), found.to_json() if hasattr(found, "to_json") else None
    found.save_yaml(path.with_suffix(".yaml"))
    parameter_posterior(found).sample_noise(100.0)
    compare(found, found)
    found.save(path.with_name("again.npz"))


def gap(path: Path, robot) -> None:
    found = with_methods(read_record(path))
    found.facts(), found.summary(), repr(found), found.joint_table()


def driven(path: Path, robot) -> None:
    found = SimulatorGap.load(path, robot)
    found.facts(), repr(found), found.save(path.with_name("again.npz"))


def trajectory(path: Path, robot) -> None:
    trajectory_of(stored := read_trajectory(path, robot)).sampled(10.0)
    assert not stored.reviewed or stored.review


def motion(path: Path, robot) -> None:
    relative_percent(prediction.load(path)[0])


def stack(path: Path, robot) -> None:
    _spectrum(observation_files.load_factors(path)[0])
    for log in observation_files.load(path)[0]:
        log.filter.second_kernel  # noqa: B018


def regressor(path: Path, robot) -> None:
    store.load_model(path, robot).regressor(*STATES)


def reduction(path: Path, robot) -> None:
    model = store.load_model(path.with_name("regressor.npz"), robot)
    found = store.load_reduction(path)
    if found.names == model.parameter_names:
        repr(BaseModel(model, found)), BaseModel(model, found).table()


#: Every kind of result: what it holds, its file, and what is done with it.
KINDS = {
    "identification": (result_files.CONTENTS, "parameters.npz", identification),
    "gap": (record.contents(), "gap.npz", gap),
    "driven": (comparison.CONTENTS, "simulator_gap.npz", driven),
    "trajectory": (read_trajectory.__globals__["CONTENTS"], "trajectory.npz", trajectory),
    "motion": (prediction.CONTENTS, "estimatedmotion.npz", motion),
    "stack": (observation_files.CONTENTS, "fullnumericregressor.npz", stack),
    "regressor": (store.REGRESSOR, "regressor.npz", regressor),
    "reduction": (store.FULL, "fullregressor.npz", reduction),
}
VALUES = (
    None,
    True,
    -1,
    0,
    1,
    0.5,
    7,
    10**9,
    10**30,
    10**400,
    1e-300,
    -1e150,
    1e149,
    float("inf"),
    float("nan"),
    "",
    "x",
    "\ud800"[:0],
    "a" * 5000,
    [],
    {},
    [[]],
    [None],
    ["x"],
    [1.0, 2.0],
    {"x": 1},
    [["x", 1]],
    [0] * 40,
)


def places(node: object) -> list[tuple[object, object]]:
    """Return every place of a JSON document: what holds it, and its key."""
    items = (
        node.items()
        if isinstance(node, dict)
        else enumerate(node)
        if isinstance(node, list)
        else ()
    )
    return [place for key, value in items for place in ((node, key), *places(value))]


def other_fact(rng: np.random.Generator, header: dict) -> str:
    """Change one fact of a header; return what was done."""
    every = places(header)
    node, key = every[rng.integers(len(every))]
    old = node[key]
    if isinstance(node, dict) and rng.random() < 0.1:
        del node[key]
        return f"no {key}"
    more = [str(old), [old], {"a": old}]
    if isinstance(old, list):
        more += [old * 2, old[::-1], old[:-1], [*old, *old[:1]], old[:1] * len(old)] * 3
    if isinstance(old, (int, float)) and not isinstance(old, bool):
        more += [-old, old + 1, old * 1e9, float(old)] * 2
    choices = [*VALUES, *more]
    node[key] = copy.deepcopy(choices[rng.integers(len(choices))])
    return f"{key} = {node[key]!r:.80} (was {old!r:.40})"


def other_array(rng: np.random.Generator, arrays: dict) -> str:
    """Change one array; return what was done."""
    name = str(rng.choice(sorted(arrays)))
    old = arrays[name]
    if rng.random() < 0.05:
        del arrays[name]
        return f"no {name}"
    one = int(rng.integers(max(old.size, 1)))
    axis = int(rng.integers(max(old.ndim, 1)))

    def with_value(value: float) -> np.ndarray:
        new = old.copy() if old.dtype.kind == "f" else old.astype(np.float64)
        new.reshape(-1)[one : one + 1] = value
        return new

    numbers = (np.nan, np.inf, -np.inf, -1.0, 0.0, 1e-300, 1e-30, 1e59, -1e59, 1e308, 1e12)
    changes = {
        **{f"one is {value}": (lambda value=value: with_value(value)) for value in numbers},
        "an integer is huge": lambda: np.where(
            np.arange(old.size).reshape(old.shape) == one, 2**30, old
        ).astype(old.dtype),
        "an integer is negative": lambda: np.where(
            np.arange(old.size).reshape(old.shape) == one, -1, old
        ).astype(old.dtype),
        "zeros": lambda: np.zeros_like(old),
        "ones": lambda: np.ones_like(old),
        "negative": lambda: (-old.astype(float)).astype(old.dtype),
        **{
            kind: (lambda kind=kind: old.astype(kind))
            for kind in ("f2", "f4", ">f8", "i1", "u8", "U8", "b1", "f8", "i8")
        },
        "reversed": lambda: old[::-1],
        "shuffled": lambda: rng.permutation(old),
        "short": lambda: old[: len(old) // 2],
        "one row": lambda: old[:1],
        "empty": lambda: old[:0],
        "longer": lambda: np.concatenate([old, old], axis=axis),
        "narrow": lambda: np.take(old, [0], axis=axis),
        "wide": lambda: np.repeat(old, 2, axis=axis),
        "none across": lambda: np.take(old, [], axis=axis),
        "column": lambda: old[..., None],
        "flat": lambda: old.reshape(-1),
        "scalar": lambda: old.reshape(-1)[0],
        "turned": lambda: np.swapaxes(old, 0, -1),
        "same": lambda: np.full_like(old, old.reshape(-1)[0]),
        "times 1e30": lambda: (old * 1e30).astype(old.dtype),
        "times 1e-30": lambda: (old * 1e-30).astype(old.dtype),
    }
    word = str(rng.choice(list(changes))) if old.size else "column"
    arrays[name] = np.asarray(changes[word]())
    return f"{name}: {word}"


def changed(rng: np.random.Generator, path: Path) -> str:
    """Change one or two things in a result; return what was done."""
    arrays = read_npz(path)
    header = json.loads(str(arrays.pop("header")))
    done = [
        other_fact(rng, header) if rng.random() < 0.5 or not arrays else other_array(rng, arrays)
        for _ in range(rng.integers(1, 3))
    ]
    np.savez(path, header=np.array(json.dumps(header)), **arrays)
    return "; ".join(done)


def outcome(
    kind: str, seed: int, originals: Path, folder: Path
) -> tuple[str, BaseException | None]:
    """Change a result as a seed says and use it; return what was done and the exception that nobody expects, None without one."""
    _, file, use = KINDS[kind]
    shutil.copy(originals / "out" / "regressor.npz", folder)
    shutil.copy(originals / "out" / file, folder)
    robot = load_robot(originals / "arm.yaml")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        done = changed(np.random.default_rng([seed, 7]), folder / file)
        try:
            use(folder / file, robot)
        except DynidError:
            pass
        except Exception as error:  # noqa: BLE001
            return done, error
    return done, None


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_with_an_odd_fact_is_used_or_refused(kind, originals, tmp_path):
    bad = []
    for seed in range(first_seed(), first_seed() + inputs_wanted(2000)):
        done, error = outcome(kind, seed, originals, tmp_path)
        if error is not None:
            bad.append(f"seed {seed}: {done}: {error!r:.200}")
    assert not bad, f"{len(bad)}\n" + "\n".join(bad)


def test_every_kind_of_result_is_declared(originals):
    """A file of results that no table describes, or a table that these tests do not know, is a hole."""
    for module in pkgutil.walk_packages(dynid.__path__, "dynid."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)
    declared = {contents.schema for contents, _, _ in KINDS.values()}
    written = {artifact.read_artifact(path).schema for path in (originals / "out").rglob("*.npz")}
    assert written == declared
    assert all(isinstance(contents, Contents) for contents, _, _ in KINDS.values())


@pytest.mark.parametrize("kind", KINDS)
def test_a_result_as_it_was_written_has_the_contents_of_its_table(kind, originals):
    contents, file, _ = KINDS[kind]
    for path in (originals / "out").rglob(file):
        found = artifact.read_artifact(path, contents)
        assert {
            place.split(".")[0] for place, fact in contents.facts.items() if fact.needed
        } <= set(found.header)


def of_three_joints(path: Path) -> None:
    """Make a result one of an arm with a third joint: every array and fact with a size of two joints has three."""
    arrays = read_npz(path)
    header = json.loads(str(arrays.pop("header")))
    for name in ("joints", "joint_names"):
        for holder in (header, header.get("record", {})):
            if name in holder and len(holder[name]) == 2:
                holder[name] = [*holder[name], copy.deepcopy(holder[name][-1])]
                if isinstance(holder[name][-1], dict):
                    holder[name][-1]["joint"] = 2
                else:
                    holder[name][-1] = "hand"
    if "record" in header:
        header["record"]["torque_units"] += ["N m"]
    for name, array in arrays.items():
        if name != "ratio" and not name.startswith("curve") and 2 in array.shape:
            axis = (
                array.ndim - 1
                if name in ("simulation", "simulated", "added")
                else array.shape.index(2)
            )
            arrays[name] = np.concatenate([array, np.take(array, [1], axis=axis)], axis=axis)
        elif name == "ratio":
            arrays[name] = np.concatenate([array, array[1:]])
    np.savez(path, header=np.array(json.dumps(header)), **arrays)


@pytest.mark.parametrize(
    "file",
    [
        "estimatedmotion.npz",
        "gap.npz",
        "simulator_gap.npz",
        "fullnumericregressor.npz",
        "validation/other/estimatedmotion.npz",
    ],
)
def test_a_report_beside_a_file_of_another_arm_names_it(file, originals, tmp_path):
    shutil.copytree(originals / "out", tmp_path / "out")
    of_three_joints(tmp_path / "out" / file)
    with pytest.raises(JointCountDiffers, match=Path(file).name):
        gather(dynid.load(tmp_path / "out" / "parameters.npz"))


def test_what_is_beside_a_result_of_the_same_arm_is_gathered(originals):
    found = gather(dynid.load(originals / "out" / "parameters.npz"))
    assert found.motion is not None
    assert found.gap is not None
    assert found.driven is not None
    assert found.singular_values is not None


def test_results_and_motions_of_another_arm_complete_no_plan(originals, tmp_path):
    other = ROBOT.replace("elbow", "wrist")
    (tmp_path / "other.yaml").write_text(other)
    robot = load_robot(tmp_path / "other.yaml")
    for file in ("parameters.npz", "trajectory.npz"):
        with pytest.raises(JointCountDiffers, match=file):
            require_same_arm([dynid.load(originals / "out" / file)], robot)


def test_a_load_is_not_found_against_an_arm_with_other_joints(originals):
    """Names of parameters are numbers of joints: two arms may have the same, and other joints."""
    one = dynid.load(originals / "out" / "parameters.npz")
    joints = tuple(replace(joint, joint=f"{joint.joint}_2") for joint in one.joints)
    with pytest.raises(WrongUsage, match="different base parameters"):
        find_payload(one, replace(one, quality=replace(one.quality, joints=joints)))


@pytest.mark.parametrize("name", ["tau", "qdd"])
def test_a_stack_of_numbers_that_no_system_holds_is_no_internal_error(name, originals, tmp_path):
    path, robot = tmp_path / "fullnumericregressor.npz", load_robot(originals / "arm.yaml")
    arrays = read_npz(originals / "out" / path.name)
    arrays[name] = (
        0 * arrays[name]
        if name == "tau"
        else np.where(np.arange(len(arrays["t"]))[:, None] == 600, -1e59, arrays[name])
    )
    np.savez(path, **arrays)
    base = base_model(robot)
    with np.errstate(all="ignore"), pytest.raises(RankDeficient, match="cannot be solved"):
        identify(robot, load_observations(path, base), base=base)
