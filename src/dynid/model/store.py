"""regressor.npz and fullregressor.npz: the model of loop 1 on disk, keyed by the content of the robot file.

The program is stored as integer arrays; loading it builds no code.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dynid.errors import NotAnArtifact
from dynid.files.artifact import Artifact, read_artifact, read_header, reading, write_artifact
from dynid.files.contents import Array, Contents, Fact
from dynid.model.program import Program
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model
from dynid.robot import Robot

#: Integers of a derivation are small.
LARGEST_CONSTANT = 1e9
_ARM = {
    "key": Fact(str),
    "joints": Fact(list[str], "n"),
    "geometry": Fact(list[tuple[str, float, float, float, float]], "n"),
    "convention": Fact(str),
    "gravity": Fact(tuple[float, float, float]),
}
REGRESSOR = Contents(
    "dynid/regressor/1",
    {
        **_ARM,
        "program_inputs": Fact(list[str]),
        "constants": Fact(list[int], least=-LARGEST_CONSTANT, most=LARGEST_CONSTANT),
        "shape": Fact(tuple[int, int]),
        "parameters": Fact(list[str]),
        "operations": Fact(int, least=0),
    },
    {name: Array("M", np.int32, least=0) for name in ("op", "lhs", "rhs")}
    | {name: Array("E", np.int32, least=0) for name in ("rows", "cols", "outputs")},
)
_REDUCTION = {
    "parameters": Fact(list[str], "c"),
    "base": Fact(list[str], "p"),
    "rank": Fact(int),
    "alone": Fact(list[str]),
    "none": Fact(list[str]),
    "combined": Fact(list[str]),
    "gap": Fact(float | None),
    "method": Fact(str),
    "formulas": Fact(list[str]),
}
#: Base parameters in a file that holds more: their facts are under ``reduction``.
REDUCTION_FACTS = {"reduction": Fact(dict[str, Any])} | {f"reduction.{key}": fact for key, fact in _REDUCTION.items()}
REDUCTION_ARRAYS = {
    "base": Array("p", np.int64, least=0, rising=True),
    "K": Array("p c"),
    "singular_values": Array("_", least=0.0),
}
FULL = Contents("dynid/fullregressor/1", {**_ARM, **_REDUCTION}, REDUCTION_ARRAYS)
#: Raised when the derivation or the layout of its arrays changes, so that older caches are rebuilt.
DERIVATION = 2


def key_of(robot: Robot) -> str:
    """Return the key of a robot's model: content of the robot file and version of the derivation."""
    return f"{robot.model_key}-{DERIVATION}"


def paths(out: Path) -> tuple[Path, Path]:
    """Return the paths of regressor.npz and fullregressor.npz in a folder."""
    return out / "regressor.npz", out / "fullregressor.npz"


def stored_key(path: Path) -> str | None:
    """Return the key in a stored model, None when there is none."""
    header = read_header(path) if path.is_file() else None
    return str(header["key"]) if header and "key" in header else None


def _header(robot: Robot, **facts: object) -> dict[str, Any]:
    geometry = [[j.type, j.a, j.twist, j.d, j.theta_offset] for j in robot.joints]
    return {"key": key_of(robot), "robot": robot.name, "joints": list(robot.joint_names), "geometry": geometry,
            "convention": robot.convention, "gravity": list(robot.gravity), **facts}  # fmt: skip


def save_model(path: Path, model: Model) -> None:
    """Write regressor.npz."""
    p = model.rigid
    arrays = {"op": p.op, "lhs": p.lhs, "rhs": p.rhs, "rows": p.rows, "cols": p.cols, "outputs": p.outputs}
    header = _header(
        model.robot,
        program_inputs=list(p.inputs),
        constants=list(p.constants),
        shape=list(p.shape),
        parameters=list(model.parameter_names),
        operations=p.flops,
    )
    write_artifact(path, Artifact(REGRESSOR.schema, header, arrays))


def load_model(path: Path, robot: Robot) -> Model:
    """Read regressor.npz of a robot."""
    artifact = read_artifact(path, REGRESSOR)
    h, a = artifact.header, artifact.arrays
    with reading(path):
        program = Program(
            tuple(h["program_inputs"]),
            tuple(map(int, h["constants"])),
            a["op"], a["lhs"], a["rhs"], a["rows"], a["cols"], a["outputs"],
            (int(h["shape"][0]), int(h["shape"][1])),
        )  # fmt: skip
    if program.shape != (robot.n, 11 * robot.n) or program.joints > robot.n:
        raise NotAnArtifact(f"{path} is damaged: it belongs to an arm with other joints", where=str(path))
    return Model(robot, program)


def save_reduction(path: Path, model: Model, reduction: Reduction) -> None:
    """Write fullregressor.npz."""
    facts, arrays = reduction_facts(reduction)
    write_artifact(path, Artifact(FULL.schema, _header(model.robot, **facts), arrays))


def load_reduction(path: Path) -> Reduction:
    """Read fullregressor.npz."""
    artifact = read_artifact(path, FULL)
    with reading(path):
        return reduction_from(artifact.header, artifact.arrays)


def reduction_facts(reduction: Reduction) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return base parameters as facts of a header and arrays, for any file that holds them."""
    facts = {
        "parameters": list(reduction.names),
        "base": list(reduction.base_names),
        "rank": reduction.rank,
        "alone": list(reduction.alone),
        "none": list(reduction.none),
        "combined": list(reduction.combined),
        "gap": reduction.gap if np.isfinite(reduction.gap) else None,
        "method": reduction.method,
        "formulas": list(reduction.formulas),
    }
    return facts, {"base": reduction.base, "K": reduction.K, "singular_values": reduction.singular_values}


def reduction_from(facts: Mapping[str, Any], arrays: Mapping[str, NDArray[Any]]) -> Reduction:
    """Return the base parameters that ``reduction_facts`` wrote.

    Args:
        facts: as the tables of this module have them, which the reader of a file has asked.
        arrays: with the names of ``REDUCTION_ARRAYS``.

    Raises:
        ValueError: names, indices and the matrix contradict each other.
    """
    found = Reduction(
        names=tuple(facts["parameters"]),
        base=arrays["base"].astype(np.intp),
        K=arrays["K"],
        alone=tuple(facts["alone"]),
        none=tuple(facts["none"]),
        combined=tuple(facts["combined"]),
        singular_values=arrays["singular_values"],
        gap=np.inf if facts["gap"] is None else facts["gap"],
        method=facts["method"],
        formulas=tuple(facts["formulas"]),
    )
    p, c = found.K.shape
    known = set(found.names)
    if len(known) != c or not known.issuperset((*found.alone, *found.none, *found.combined)):
        raise ValueError("the names of its parameters contradict each other")
    if p == 0 or found.base[-1] >= c or tuple(facts["base"]) != found.base_names:
        raise ValueError("its base parameters are not among its parameters")
    if not np.array_equal(found.K[:, found.base], np.eye(p)):
        raise ValueError("'K' is not the matrix of a reduction")
    if found.formulas and len(found.formulas) != p:
        raise ValueError("it has another number of formulas than of base parameters")
    return found
