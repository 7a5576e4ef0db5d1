"""From a robot file to its base model: the regressor and what of its parameters can be identified (Paper Eq. 13)."""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from dynid.answer import Answer, Facts, picked
from dynid.arguments import public
from dynid.files.artifact import read_header, reading
from dynid.loading import RobotLike, as_robot
from dynid.model.base_model import (
    BaseModel,
    in_memory,
    key_of,
    load_reduction,
    save_model,
    save_reduction,
    stored_key,
)
from dynid.model.reduce import Reduction
from dynid.model.regressor import Model, build_model
from dynid.progress import Progress, stage
from dynid.robot import Robot
from dynid.runs import RunFolder
from dynid.workflows.options import ModelOptions, joint_indices


def adapted(robot: Robot, options: ModelOptions) -> Robot:
    """Return the robot with what the options change.

    Raises:
        WrongUsage: the arm has no such links.
    """
    if options.gravity is not None:
        robot = replace(robot, gravity=options.gravity)
    if options.effects is not None:
        friction = tuple(word for word in options.effects if word != "motor_inertia")
        rotors = "motor_inertia" in options.effects
        joints = (replace(joint, friction=friction, motor_inertia=rotors) for joint in robot.joints)
        robot = replace(robot, joints=tuple(joints))
    if not options.links:
        return robot
    links = joint_indices(robot.joint_names, options.links, "--links")
    return replace(robot, links=tuple(sorted(k + 1 for k in links)))


# ---------------------------------------------------------------- the regressor
@dataclass(frozen=True)
class DerivedModel:
    """The regressor of an arm in a folder, with its base parameters once they are asked for.

    Attributes:
        model: the regressor.
        folder: where both are stored.
        seconds: what each step took [s].
        wrote: what was derived now; where nothing was, stored files were used.
        reduction: the base parameters; None until they are asked for.
    """

    model: Model
    folder: Path
    seconds: dict[str, float]
    wrote: tuple[Path, ...]
    reduction: Reduction | None = None

    @property
    def base(self) -> BaseModel:
        """The model with its base parameters."""
        assert self.reduction is not None
        return BaseModel(self.model, self.reduction)

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid model`` says, with or without base parameters."""
        answer = {
            **picked(self.model.robot, robot="name", n_joints="n", key="model_key"),
            "n_parameters": self.model.size,
            "operations": self.model.rigid.flops,
            "seconds": self.seconds,
        }
        reduction = self.reduction
        if reduction is None:
            return answer | dict.fromkeys(("rank", "classes", "groups"))
        groups = [
            {"name": name, "terms": reduction.terms(i), "formula": reduction.formulas[i]}
            for i, name in enumerate(reduction.base_names)
        ]
        classes = picked(reduction, "alone", "none", "combined")
        return {**answer, **picked(reduction, "rank", "gap"), "classes": classes, "groups": groups}

    def answer(self) -> Answer:
        """Return what ``dynid model`` answers: the classes, and what each combination is made of."""
        if self.reduction is None:
            return Answer(self.facts(), f"The equations of {self.model.robot.name} are ready.")
        return replace(self.base.answer(), facts=self.facts())


def stored_differences(robot: Robot, folder: Path) -> str | None:
    """Return what differs between the robot of a stored regressor and this one; None where nothing does."""
    path = RunFolder(folder).model[0]
    if stored_key(path) in (None, key_of(robot)):
        return None
    header, changed = read_header(path), list[str]()
    with reading(path):
        rows = header.get("geometry", [])
        for i, (joint, row) in enumerate(zip(robot.joints, rows, strict=False)):
            for name, old in zip(("a", "twist", "d", "theta_offset"), row[1:], strict=True):
                if old != getattr(joint, name):
                    changed.append(f"joints[{i}].{name} {old:g} -> {getattr(joint, name):g}")
    return "; ".join(changed) or "other gravity, columns, links or version of dynid"


def derive_model(robot: Robot, folder: Path, *, rebuild: bool = False) -> DerivedModel:
    """Return the regressor of an arm, stored where it is not yet.

    Args:
        robot: the arm.
        folder: where regressor.npz is kept.
        rebuild: whether to store it again in any case.
    """
    start, path = time.perf_counter(), RunFolder(folder).model[0]
    stage("symbolic")
    new = rebuild or stored_key(path) != key_of(robot)
    model = build_model(robot)
    seconds = {"symbolic": time.perf_counter() - start}
    if new:
        save_model(path, model)
    return DerivedModel(model, folder, seconds, (path,) * new)


# ---------------------------------------------------------------- base parameters
def reduce_model(
    derived: DerivedModel,
    options: ModelOptions = ModelOptions(),
    *,
    seed: int = 0,
) -> DerivedModel:
    """Return a regressor with its base parameters, which are stored beside it.

    Args:
        derived: the regressor.
        options: random states and tolerance; the stored base parameters serve only where both are the defaults.
        seed: seed of the random states.

    Raises:
        ReductionsDisagree: the singular values leave the rank open.
    """
    start, path, model = time.perf_counter(), RunFolder(derived.folder).model[1], derived.model
    usual = options.tolerance is None and options.samples == ModelOptions().samples
    stored = not derived.wrote and usual and stored_key(path) == key_of(model.robot)
    if stored:
        reduction = load_reduction(path)
    else:
        from dynid.model.relations import base_parameters  # SymPy

        stage("reduce")
        reduction = base_parameters(
            model, samples=options.samples, seed=seed, tolerance=options.tolerance
        )
        save_reduction(path, model, reduction)
    return replace(
        derived,
        seconds={**derived.seconds, "reduce": time.perf_counter() - start},
        wrote=(*derived.wrote, *(path,) * (not stored)),
        reduction=reduction,
    )


@public
def base_model(
    robot: RobotLike,
    folder: str | Path | None = None,
    progress: Progress | None = None,
    *,
    options: ModelOptions = ModelOptions(),
    **changes: Any,  # noqa: ANN401
) -> BaseModel:
    """Return the regressor of an arm with its base parameters, derived when it is not there yet or stale.

    Args:
        robot: the arm, its name, or the path of its file.
        folder: where regressor.npz and fullregressor.npz are kept; None keeps the model in memory only.
        progress: reports when it was derived.
        options: what differs from the robot file, and how the base parameters are found.
        changes: single options by name, such as ``links="4-7"``; see ``dynid.ModelOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).

    Example:
        dynid.base_model("kuka_lwr4plus")
    """
    robot = adapted(as_robot(robot), options)
    stage("model")
    if folder is None:
        return in_memory(robot, options.samples, options.tolerance)
    reduced = reduce_model(derive_model(robot, Path(folder)), options)
    if reduced.wrote:
        made = f"{len(reduced.base.reduction.names)} -> {reduced.base.rank} base parameters"
        stage("model", f"derived for {robot.name}: {made}, stored in {folder}")
    return reduced.base


# ---------------------------------------------------------------- for people
def relations(model: Model, form: str, *, at_rest: bool) -> tuple[Facts, str]:
    """Return the relations behind all base parameters, so that a vendor's grouped numbers can be named.

    Args:
        model: the regressor.
        form: ``"json"`` or ``"text"``.
        at_rest: whether only what torques at rest show is wanted, as vendors publish it.

    Returns:
        The JSON answer, and the relations in the form that is wanted.
    """
    from dynid.model import relations as made_of  # SymPy

    groups = made_of.relations_of(model, still=at_rest)
    facts = {
        "schema": "dynid/model/1",
        "robot": model.robot.name,
        **made_of.relations_json(model, groups),
    }
    if form == "text":
        return facts, made_of.relations_text(groups)
    return facts, json.dumps(facts, indent=2)
