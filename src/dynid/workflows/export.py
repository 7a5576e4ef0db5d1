"""Write an identified model for simulators and controllers, and prove each file by loading it again."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Any

from dynid import arguments
from dynid.answer import Answer
from dynid.arguments import public
from dynid.disk import write_text
from dynid.errors import Finding, NotAnArtifact, NotPhysical, WrongUsage
from dynid.estimation.least_squares import relative_error
from dynid.estimation.result import Identification
from dynid.exporters import (
    EFFECTS,
    FORMATS,
    Agreement,
    IdentifiedArm,
    LoadingFailed,
    NotTried,
    Provenance,
    full_model,
)
from dynid.exporters.effects_file import HOSTS, wanted
from dynid.exporters.full_model import model_of
from dynid.exporters.simulated import simulated
from dynid.loading import ResultLike, as_base_model, as_result
from dynid.model.base_model import BaseModel
from dynid.model.regressor import indefinite_share, random_poses
from dynid.progress import SILENT, Progress
from dynid.table import Table
from dynid.version import __version__
from dynid.workflows.options import SUFFIXES, ExportOptions
from dynid.workflows.results import base_model_of


@dataclass(frozen=True)
class ExportedFile:
    """One written file.

    Attributes:
        format: name of its format.
        path: the file.
        text: its text.
        leaves_out: what the format has no place for, one phrase each.
        agreements: comparison with dynid's torques, none where nothing here loads the file.
        refused: what the engine said that refused the file, empty when none did.
        elements: effects that it has elements for, one phrase each.
        beside: what ``effects.py`` beside it adds, one phrase each.
        not_tried: why the machine does not let it be loaded, empty when it does.
    """

    format: str
    path: Path
    text: str = field(repr=False)
    leaves_out: tuple[str, ...]
    agreements: tuple[Agreement, ...] = ()
    refused: str = ""
    elements: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()
    not_tried: str = ""

    @property
    def agrees(self) -> bool:
        """Whether no engine refused the file or differs from dynid."""
        return not self.refused and all(each.agrees for each in self.agreements)

    def findings(self) -> tuple[Finding, ...]:
        """Return the warning W408 when an engine refused the file or differs."""
        if self.agrees:
            return ()
        worst = self.refused or ", ".join(
            f"{each.engine} differs by {each.largest:.3g}" for each in self.agreements
        )
        return (Finding("W408", "warning", f"{self.path}: {worst}", {}),)

    def facts(self) -> dict[str, Any]:
        """Return the file as the JSON answer has it."""
        return {
            "format": self.format,
            "path": str(self.path),
            "checks": [
                {
                    "engine": each.engine,
                    "what": each.what,
                    "largest_difference_nm": each.largest,
                    "torque_rms_nm": each.torque_rms,
                    "states": each.states,
                    "agrees": each.agrees,
                }
                for each in self.agreements
            ],
            "refused": self.refused or None,
            "not_tried": self.not_tried or None,
            "leaves_out": list(self.leaves_out),
            "elements": list(self.elements),
            "effects_py": list(self.beside),
        }


@dataclass(frozen=True, repr=False)
class ExportedModel(Answer):
    """The files of one export.

    Attributes:
        arm: what was written.
        files: one per format.
        findings: warnings.
        drawn: files of arms drawn from the posterior, and at the end their ranges and correlations.
    """

    arm: IdentifiedArm
    files: tuple[ExportedFile, ...]
    findings: tuple[Finding, ...]
    drawn: tuple[Path, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether every engine that loaded a file has dynid's torques."""
        return all(file.agrees for file in self.files)

    def sentence(self) -> str:
        """Return in one sentence whether the files have the torques of the model."""
        refused = [file.format for file in self.files if file.refused]
        if refused:
            return f"Do not use {', '.join(refused)}: the program that should load it refuses it."
        if not self.agrees:
            worst = [file.format for file in self.files if not file.agrees]
            return f"Do not use {', '.join(worst)}: the torques differ from those of the model."
        tried = [each for file in self.files for each in file.agreements]
        if not tried:
            return "The files are written; there is no program here to load them."
        return "The files have the torques of the model."

    def table(self) -> Table:
        """Return one row per comparison: format, engine, what was compared, largest difference [N m]."""
        heads = ("format", "loaded in", "compared", "largest difference")
        rows = []
        for file in self.files:
            for each in file.agreements:
                shown = f"{each.largest:.1e} of {each.torque_rms:.3g} N m"
                rows.append((file.format, each.engine, each.what, shown))
            if not file.agreements:
                why = (
                    f"not tried: {file.not_tried}"
                    if file.not_tried
                    else "no program here to load it"
                )
                rows.append((file.format, "-", "refused" if file.refused else why, "-"))
        return Table([dict(zip(heads, row, strict=True)) for row in rows])

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid export`` says."""
        return {
            "schema": "dynid/export/1",
            "robot": self.arm.robot.name,
            "files": [file.facts() for file in self.files],
            "impossible_links": list(self.arm.full.impossible_links()),
            "origin": dict(self.arm.full.origin),
            "findings": [asdict(finding) for finding in self.findings],
            "draws": [str(path) for path in self.drawn],
            "wrote": [str(file.path) for file in self.files]
            + [str(path) for path in self.drawn[-1:]],
        }


@public
def export(
    result: ResultLike,
    path: Path | str,
    options: ExportOptions | None = None,
    *,
    formats: str | Sequence[str] = (),
    base: BaseModel | None = None,
    seed: int = 0,
    write: Callable[[Path, str], object] | None = None,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> ExportedModel:
    """Write an identified model, load each file again, and compare torques.

    Args:
        result: identified parameters, their folder or their file.
        path: the file, whose suffix names the format: .urdf, .xml (MJCF), .yaml, .c, .py, .m; or a folder,
            when ``formats`` are given.
        options: which parameters are written, and into which URDF.
        formats: names of formats, written to the folder ``path`` under the name of the robot.
        base: the result's base model, where it is there already.
        seed: seed of the random states that torques are compared on.
        write: writes a text to a file; None overwrites what is there.
        progress: reports what is compared.
        changes: single options by name, such as ``urdf="arm.urdf"``; see ``dynid.ExportOptions``.

    Raises:
        WrongUsage: the suffix is that of no format, a URDF was given without the format, or an argument is something
            else than what is wanted (E101).
        NotPhysical: no body has the parameters, and the format needs bodies.

    Example:
        dynid.export("out/kuka_lwr4plus", "arm.xml")
    """
    options, progress = (
        arguments.options(ExportOptions, options, changes),
        arguments.progress(progress),
    )
    result, base = as_result(result), as_base_model(base)
    path, seed = arguments.path(path, "path"), arguments.whole(seed, "seed")
    wanted = arguments.words(formats, "formats", FORMATS)
    if write is not None and not callable(write):
        raise arguments.refused("write", "None or a function of path and text", write)
    names = wanted or (format_of(path),)
    if options.urdf is not None and "urdf" not in names:
        raise WrongUsage("--urdf is for --format urdf", fix="add --format urdf")
    arm = identified_arm(result, names, options, base, progress)
    findings = possible(arm, names, options)
    progress.findings(findings)
    arm = replace(arm, warning="; ".join(finding.text for finding in findings))
    # Why all texts first: nothing is written when one of the formats cannot hold the model.
    texts = {name: FORMATS[name].text(arm) for name in names}
    files = []
    for name, text in texts.items():
        place = path / f"{arm.file_stem}{SUFFIXES[name]}" if wanted else path
        (write or write_text)(place, text)
        progress.stage("compare", place.name)
        files.append(proved(name, place, text, arm, seed))
        progress.findings(files[-1].findings())
    if beside_simulators(arm, names):
        place = (path if wanted else path.parent) / EFFECTS_FILE
        text = EFFECTS.text(arm)
        (write or write_text)(place, text)
        progress.stage("compare", place.name)
        files.append(proved("effects", place, text, arm, seed))
        progress.findings(files[-1].findings())
    drawn: tuple[Path, ...] = ()
    if options.draws:
        drawn = write_draws(
            result, arm, options.draws, seed, path if wanted else path.parent, names, progress
        )
    return ExportedModel(arm, tuple(files), findings, drawn)


def write_draws(
    result: Identification,
    arm: IdentifiedArm,
    count: int,
    seed: int,
    folder: Path,
    formats: Sequence[str],
    progress: Progress = SILENT,
) -> tuple[Path, ...]:
    """Write arms drawn from the posterior, and ``draws.json`` with ranges and correlations; return their paths.

    Args:
        result: the result.
        arm: the exported arm that they are drawn about.
        count: number of draws.
        seed: of the draws.
        folder: where ``draws/`` is made.
        formats: formats of the export; those of simulators are written.
        progress: reports what is written.

    Raises:
        WrongUsage: none of the formats is one of a simulator.
    """
    import json

    hosts = [name for name in formats if name in HOSTS]
    if not hosts:
        raise WrongUsage("draws are written as URDF or MJCF", fix="add --format mjcf")
    progress.stage("draw", f"{count} arms")
    drawn, wrote = result.draws(count, seed), []
    digits, beside = len(str(count)), beside_simulators(arm, hosts) and bool(arm.base.model.added)
    for k, (x, theta) in enumerate(zip(drawn.x, drawn.theta, strict=True), start=1):
        one = replace(arm, theta=theta, full=model_of(arm.base, drawn.names, x, arm.full.origin))
        stem = folder / "draws" / f"{arm.file_stem}_{k:0{digits}d}"
        texts = {f"{stem}{SUFFIXES[name]}": FORMATS[name].text(one) for name in hosts}
        if beside:
            texts[f"{stem}_{EFFECTS_FILE}"] = EFFECTS.text(one)
        for name, text in texts.items():
            write_text(Path(name), text)
            wrote.append(Path(name))
    facts = folder / "draws" / "draws.json"
    write_text(facts, json.dumps(drawn.facts(), indent=1) + "\n")
    return (*wrote, facts)


#: The file of what simulators' files have no place for.
EFFECTS_FILE = "effects.py"


def beside_simulators(arm: IdentifiedArm, formats: Sequence[str]) -> bool:
    """Return whether a file of one of these formats lacks something that ``effects.py`` has."""
    return wanted(arm, tuple(formats))


def format_of(path: Path) -> str:
    """Return the format that a file's suffix names.

    Raises:
        WrongUsage: there is none.
    """
    for name, suffix in SUFFIXES.items():
        if path.suffix.lower() == suffix:
            return name
    known = ", ".join(SUFFIXES.values())
    raise WrongUsage(
        f"no format has the suffix '{path.suffix}' of {path}", fix=f"a file with one of {known}"
    )


def identified_arm(
    result: Identification,
    formats: Iterable[str],
    options: ExportOptions,
    base: BaseModel | None = None,
    progress: Progress = SILENT,
) -> IdentifiedArm:
    """Return what is exported from a result.

    Raises:
        NotAnArtifact: a parameter of the result is not a finite number.
    """
    import numpy as np

    which, full = options.parameters, result.physical
    if which == "auto":
        which = (
            "physical" if any(FORMATS[name].needs_bodies for name in formats) else result.in_force
        )
    if not (np.isfinite(result.plain).all() and np.isfinite(full.x).all()):
        raise NotAnArtifact(
            f"{result.path} is damaged: a parameter is not a finite number", where=str(result.path)
        )
    theta = result.reduction.K @ full.x if which == "physical" else result.plain
    base = base or base_model_of(result, result.path.parent if result.path.name else None, progress)
    version = str(result.header.get("dynid", __version__))
    made = Provenance(
        version, result.method, which, relative_error(result.factors, theta), result.log_sha256
    )
    # Why only the set in force: the residual model is what that set leaves.
    error = result.model_error if which == result.in_force else None
    return IdentifiedArm(
        base,
        theta,
        result.knowledge,
        full_model(base, full, theta),
        made,
        options.urdf,
        model_error=error,
        residual_model=options.residual_model,
    )


#: Formats that are programs with a mass matrix.
LANGUAGES = ("c", "python", "matlab")
#: Poses in which the mass matrix of exported code is looked at.
POSES = 200


def possible(
    arm: IdentifiedArm, formats: Iterable[str], options: ExportOptions
) -> tuple[Finding, ...]:
    """Return the warning W409 for what cannot exist, bodies or the mass matrix, where it is wanted all the same.

    Raises:
        NotPhysical: it is not, or the sizes of masses are unknown.
    """
    names = tuple(formats)
    holding = [name for name in names if FORMATS[name].needs_bodies]
    if arm.base.robot.torque.relative and holding:
        raise NotPhysical(
            "no gain of a drive is known, so the sizes of masses and inertias are unknown",
            why=f"a {'/'.join(holding)} file holds kilograms",
            fix="identify with --loaded LOG --load-mass KG, or export c, python, matlab or yaml, in amperes",
        )
    impossible = arm.full.impossible_links()
    if not impossible or not holding:
        return _definite(arm, [name for name in names if name in LANGUAGES], options)
    links = ", ".join(str(link) for link in impossible)
    what = f"no body has the parameters of link {links}: mass or inertia not positive, or triangle inequality broken"
    why = f"simulators refuse such a {'/'.join(holding)} file or replace its inertias silently"
    fix = "export --set physical, or c, python, matlab or yaml, or add --allow-infeasible"
    return _wanted(options, NotPhysical(what, why=why, fix=fix), {"links": list(impossible)})


def _wanted(
    options: ExportOptions, refusal: NotPhysical, evidence: dict[str, Any]
) -> tuple[Finding, ...]:
    """Return the warning W409 in place of a refusal, where what cannot exist is wanted all the same.

    Raises:
        NotPhysical: it is not.
    """
    if not options.allow_infeasible:
        raise refusal
    return (Finding("W409", "warning", refusal.what, evidence),)


def _definite(
    arm: IdentifiedArm, formats: Sequence[str], options: ExportOptions
) -> tuple[Finding, ...]:
    """Return the warning W409 for a mass matrix that is not positive definite, where it is wanted all the same.

    Raises:
        NotPhysical: it is not: a controller that divides by it, or predicts with it, goes astray.
    """
    if not formats:
        return ()
    observer = arm.base.model.observer(arm.base.reduction.base)
    poses = random_poses(arm.base.robot, POSES)
    share = indefinite_share(lambda q, qd, qdd: observer.torque(arm.theta, q, qd, qdd), poses)
    if not share:
        return ()
    what = f"the mass matrix is not positive definite in {round(POSES * share)} of {POSES} random poses"
    why = f"{'/'.join(formats)} would compute accelerations of the wrong sign"
    fix = "export --set physical, or add --allow-infeasible"
    return _wanted(options, NotPhysical(what, why=why, fix=fix), {"share": share})


def proved(name: str, path: Path, text: str, arm: IdentifiedArm, seed: int = 0) -> ExportedFile:
    """Return a file's text with how well each engine that loads it agrees with dynid."""
    form = EFFECTS if name == "effects" else FORMATS[name]
    agreements, refused, not_tried = [], "", ""
    try:
        agreements = form.check(text, arm, seed)
    except LoadingFailed as error:
        refused = str(error)
    except NotTried as error:
        not_tried = str(error)
    found = ExportedFile(
        name, path, text, form.leaves_out(arm), tuple(agreements), refused, not_tried=not_tried
    )
    if name not in HOSTS:
        return found
    where = simulated(arm)
    beside = tuple(where.in_effects_file(mjcf=name == "mjcf"))
    elements = where.numbers + (where.elements if name == "mjcf" else ())
    return replace(found, elements=elements, beside=beside)
