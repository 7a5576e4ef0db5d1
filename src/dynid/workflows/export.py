"""Write an identified model for simulators and controllers, and prove each file by loading it again."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from dynid.answer import Answer, Answered, Facts, picked
from dynid.arguments import no_such, public
from dynid.disk import write_text
from dynid.errors import Finding, NotPhysical, WrongUsage
from dynid.estimation.draws import Draws
from dynid.estimation.least_squares import relative_error
from dynid.estimation.result import Identification
from dynid.exporters import FORMATS
from dynid.exporters.effects_file import EFFECTS, HOSTS, wanted
from dynid.exporters.full_model import full_model, model_of
from dynid.exporters.interface import (
    RESIDUAL,
    Agreement,
    Format,
    IdentifiedArm,
    LoadingFailed,
)
from dynid.exporters.simulated import simulated
from dynid.loading import ResultLike, as_result
from dynid.progress import Progress, notice, stage
from dynid.table import Table
from dynid.version import __version__
from dynid.workflows.options import ExportOptions
from dynid.workflows.parameters import torque_unit


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
        elements: effects that are in its numbers, one phrase each.
        beside: what ``effects.py`` beside it adds, one phrase each.
    """

    format: str
    path: Path
    text: str = field(repr=False)
    leaves_out: tuple[str, ...]
    agreements: tuple[Agreement, ...] = ()
    refused: str = ""
    elements: tuple[str, ...] = ()
    beside: tuple[str, ...] = ()

    @property
    def agrees(self) -> bool:
        """Whether no engine refused the file or differs from dynid."""
        return not self.refused and all(each.agrees for each in self.agreements)

    def findings(self) -> tuple[Finding, ...]:
        """Return the warning W408 when an engine refused the file or differs."""
        if self.agrees:
            return ()
        differ = (f"{each.engine} differs by {each.largest:.3g}" for each in self.agreements)
        return (Finding("W408", "warning", f"{self.path}: {self.refused or ', '.join(differ)}"),)

    def facts(self) -> Facts:
        """Return the file as the JSON answer has it."""
        return {
            **picked(self, "format", "path"),
            "checks": [
                picked(
                    each,
                    "engine",
                    "what",
                    "states",
                    "agrees",
                    largest_difference_nm="largest",
                    torque_rms_nm="torque_rms",
                )
                for each in self.agreements
            ],
            "refused": self.refused or None,
            "not_tried": None,
            **picked(self, "leaves_out", "elements", effects_py="beside"),
        }


@dataclass(frozen=True, repr=False)
class ExportedModel(Answered):
    """The files of one export.

    Attributes:
        arm: what was written.
        files: one per format.
        findings: warnings.
        fitted_percent: relative error of the result with all that it holds on the fitted logs [%].
        drawn: files of arms drawn from the posterior, and at the end their ranges and correlations.
    """

    arm: IdentifiedArm
    files: tuple[ExportedFile, ...]
    findings: tuple[Finding, ...]
    fitted_percent: float
    drawn: tuple[Path, ...]

    @property
    def agrees(self) -> bool:
        """Whether every engine that loaded a file has dynid's torques."""
        return all(file.agrees for file in self.files)

    def sentence(self) -> str:
        """Return in one sentence whether the files have the torques of the model."""
        wrong = ", ".join(file.format for file in self.files if not file.agrees)
        if wrong:
            return f"Do not use {wrong}: an engine refuses it, or has other torques than the model."
        if not any(file.agreements for file in self.files):
            return "The files are written; there is no program here to load them."
        return "The files have the torques of the model."

    def table(self) -> Table:
        """Return one row per comparison: format, engine, what was compared, largest difference."""
        rows, unit = [], torque_unit(self.arm.robot)
        for file in self.files:
            words = "refused" if file.refused else "no program here to load it"
            compared = [
                (each.engine, each.what, f"{each.largest:.1e} of {each.torque_rms:.3g} {unit}")
                for each in file.agreements
            ]
            rows += [(file.format, *row) for row in compared or [("-", words, "-")]]
        heads = ("format", "loaded in", "compared", "largest difference")
        return Table([dict(zip(heads, row, strict=True)) for row in rows])

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid export`` says."""
        full = self.arm.full
        return {
            "robot": self.arm.robot.name,
            "files": [file.facts() for file in self.files],
            "impossible_links": full.impossible_links(),
            "origin": dict(full.origin),
            "findings": self.findings,
            "draws": self.drawn,
        }

    def answer(self) -> Answer:
        """Return what ``dynid export`` answers."""
        parts = []
        for file in self.files:
            parts += [f"{file.format} has {phrase}" for phrase in file.elements]
            parts += [
                f"{file.format} has no place for {phrase}"
                for phrase in file.leaves_out
                if phrase.removeprefix("effect ") not in file.beside
            ]
            if file.beside:
                parts.append(f"effects.py adds to {file.format}: {', '.join(file.beside)}")
        if any(RESIDUAL in file.leaves_out for file in self.files):
            alone = self.arm.relative_error_percent
            both = f"{self.fitted_percent:.2g} % with the residual model, {alone:.2g} % without it"
            parts.append(f"relative torque error on the training logs: {both}")
        return Answer(
            self.facts(),
            self.sentence(),
            (self.table(), *parts),
            wrote=self.drawn[-1:],
            status=not (self.agrees or self.findings),
        )


@public
def export(
    result: ResultLike,
    path: Path | str,
    options: ExportOptions = ExportOptions(),
    *,
    formats: str | Sequence[str] = (),
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
    result, path = as_result(result), Path(path)
    chosen = (formats,) if isinstance(formats, str) else tuple(formats)
    for name in chosen:
        if name not in FORMATS:
            raise no_such("formats: no format", name, FORMATS)
    suffix = path.suffix.lower()
    names = chosen or tuple(form.name for form in FORMATS.values() if form.suffix == suffix)
    if not names:
        fix = f"a file with one of {', '.join(form.suffix for form in FORMATS.values())}"
        raise WrongUsage(f"no format has the suffix '{path.suffix}' of {path}", fix=fix)
    if options.urdf is not None and "urdf" not in names:
        raise WrongUsage("--urdf is for --format urdf", fix="add --format urdf")
    hosts = [name for name in names if name in HOSTS]
    if options.draws and not hosts:
        raise WrongUsage("draws are written as URDF or MJCF", fix="add --format mjcf")
    arm = identified_arm(result, names, options)
    findings = _possible(arm, names, options)
    notice(findings)
    arm = replace(arm, warning="; ".join(finding.text for finding in findings))
    folder, files = path if chosen else path.parent, []
    # Why all texts first: nothing is written when one of the formats cannot hold the model.
    forms = [*(FORMATS[name] for name in names), *[EFFECTS] * wanted(arm, names)]
    texts = [(form, form.text(arm)) for form in forms]
    for form, text in texts:
        place = folder / f"{arm.file_stem}{form.suffix}" if chosen else path
        place = folder / EFFECTS_FILE if form is EFFECTS else place
        (write or write_text)(place, text)
        stage("compare", place.name)
        files.append(_proved(form, place, text, arm, seed))
        notice(files[-1].findings())
    drawn: tuple[Path, ...] = ()
    if options.draws:
        stage("draw", f"{options.draws} arms")
        drawn = _write_draws(arm, result.draws(options.draws, seed), folder / "draws", hosts)
    return ExportedModel(arm, tuple(files), findings, result.relative_error_percent, drawn)


def _write_draws(
    arm: IdentifiedArm, drawn: Draws, folder: Path, hosts: Sequence[str]
) -> tuple[Path, ...]:
    """Write arms drawn from the posterior about an arm, and ``draws.json`` with ranges and correlations."""
    texts, digits = dict[str, str](), len(str(len(drawn.x)))
    with_effects = wanted(arm, tuple(hosts)) and arm.base.model.added
    for k, (x, theta) in enumerate(zip(drawn.x, drawn.theta, strict=True), start=1):
        one = replace(arm, theta=theta, full=model_of(arm.base, drawn.names, x, arm.full.origin))
        stem = f"{arm.file_stem}_{k:0{digits}d}"
        texts |= {f"{stem}{FORMATS[name].suffix}": FORMATS[name].text(one) for name in hosts}
        if with_effects:
            texts[f"{stem}_{EFFECTS_FILE}"] = EFFECTS.text(one)
    texts["draws.json"] = json.dumps(drawn.facts(), indent=1) + "\n"
    for name, text in texts.items():
        write_text(folder / name, text)
    return tuple(folder / name for name in texts)


#: The file of what simulators' files have no place for.
EFFECTS_FILE = "effects.py"


def identified_arm(
    result: Identification,
    formats: Iterable[str],
    options: ExportOptions = ExportOptions(),
) -> IdentifiedArm:
    """Return what is exported from a result."""
    which, full = options.parameters, result.physical
    if which == "auto":
        bodies = any(FORMATS[name].needs_bodies for name in formats)
        which = "physical" if bodies else result.in_force
    theta = result.reduction.K @ full.x if which == "physical" else result.plain
    return IdentifiedArm(
        base=result.base,
        theta=theta,
        known=result.knowledge,
        full=full_model(result.base, full, theta),
        version=str(result.header.get("dynid", __version__)),
        method=result.method,
        parameter_set=which,
        relative_error_percent=relative_error(result.factors, theta),
        log_sha256=result.log_sha256,
        urdf=options.urdf,
        # Why only the set in force: the residual model is what that set leaves.
        model_error=result.model_error if which == result.in_force else None,
        residual_model=options.residual_model,
    )


def _possible(
    arm: IdentifiedArm, formats: Sequence[str], options: ExportOptions
) -> tuple[Finding, ...]:
    """Return the warning W409 for bodies that cannot exist, where they are wanted all the same.

    Raises:
        NotPhysical: they are not, or the sizes of masses are unknown.
    """
    holding = [name for name in formats if FORMATS[name].needs_bodies]
    bodies, impossible = "/".join(holding), arm.full.impossible_links()
    if arm.base.robot.torque.relative and holding:
        raise NotPhysical(
            "no gain of a drive is known, so the sizes of masses and inertias are unknown",
            why=f"a {bodies} file holds kilograms",
            fix="identify with --loaded LOG --load-mass KG, or export c, python, matlab or yaml, in amperes",
        )
    if not impossible or not holding:
        return ()
    links = ", ".join(str(link) for link in impossible)
    broken = "mass or inertia not positive, or triangle inequality broken"
    what = f"no body has the parameters of link {links}: {broken}"
    if not options.allow_infeasible:
        why = f"simulators refuse such a {bodies} file or replace its inertias silently"
        fix = "export --set physical, or c, python, matlab or yaml, or add --allow-infeasible"
        raise NotPhysical(what, why=why, fix=fix)
    return (Finding("W409", "warning", what, {"links": impossible}),)


def _proved(form: Format, path: Path, text: str, arm: IdentifiedArm, seed: int) -> ExportedFile:
    """Return a file's text with how well each engine that loads it agrees with dynid."""
    exported = ExportedFile(form.name, path, text, form.leaves_out(arm))
    try:
        exported = replace(exported, agreements=tuple(form.check(text, arm, seed)))
    except LoadingFailed as error:
        exported = replace(exported, refused=str(error))
    if form.name not in HOSTS:
        return exported
    where = simulated(arm)
    beside = tuple(where.in_effects_file(mjcf=form.name == "mjcf"))
    return replace(exported, elements=where.numbers, beside=beside)
