"""``dynid export RUN --format F``: the identified model for simulators and controllers, loaded back and compared."""

from __future__ import annotations

from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from dynid.cli.options import Common, dynid_command
from dynid.errors import ExitStatus, Finding, NotPhysical, WrongUsage

if TYPE_CHECKING:
    from dynid.estimation.result import StoredResult
    from dynid.exporters import Agreement, Format, IdentifiedArm

#: The names of ``dynid.exporters.FORMATS``, repeated here so that help needs no import.
NAMES = ("urdf", "mjcf", "sdf", "yaml", "c", "python", "matlab")


@dynid_command(
    "export",
    examples=(
        "dynid export out/kuka_lwr4plus --format urdf",
        "dynid export out/kuka_lwr4plus --format urdf --urdf lwr.urdf       your own file, new inertial blocks",
        "dynid export out/kuka_lwr4plus --format c --format python",
    ),
)
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--format", "formats", type=click.Choice([*NAMES, "all"]), multiple=True, required=True, help="What to write."
)
@click.option(
    "--urdf",
    type=click.Path(exists=True, dir_okay=False, path_type=Path),
    help="Your URDF, to be kept but for inertias.",
)
@click.option(
    "--set",
    "which",
    type=click.Choice(["auto", "physical", "plain"]),
    default="auto",
    show_default=True,
    help="Physical parameters, the plain estimate, or auto: physical where bodies are written, else what is in force.",
)
@click.option(
    "--allow-infeasible", is_flag=True, help="Write also bodies that cannot exist; simulators may refuse them."
)
def command(
    common: Common, run: Path, formats: tuple[str, ...], urdf: Path | None, which: str, allow_infeasible: bool
) -> ExitStatus:
    """Write the identified model as URDF, MJCF, SDF, YAML, C, Python or MATLAB."""
    from dynid.estimation import result
    from dynid.exporters import FORMATS

    wanted = {name: FORMATS[name] for name in NAMES if name in formats or "all" in formats}
    if urdf is not None and "urdf" not in wanted:
        raise WrongUsage("--urdf is for --format urdf", fix="add --format urdf")
    stored = result.load(parameters_of(run))
    if which == "auto":
        bodies = any(exporter.needs_bodies for exporter in wanted.values())
        which = "physical" if bodies else stored.identification.in_force
    source = source_of(common, stored, which, urdf)
    findings = possible(source, wanted, allow_infeasible)
    common.terminal.findings(findings)
    texts = {name: exporter.text(source) for name, exporter in wanted.items()}
    folder = common.out or stored.path.parent
    files: list[dict[str, Any]] = []
    agreed = True
    for name, exporter in wanted.items():
        path = write(common, folder / f"{source.file_stem}{exporter.suffix}", texts[name])
        facts, fine = checked(common, exporter, path, texts[name], source)
        files.append(facts)
        agreed = agreed and fine
    show(common, files)
    common.terminal.emit_json(
        {
            "schema": "dynid/export/1",
            "robot": stored.robot.name,
            "files": files,
            "impossible_links": list(source.full.impossible_links()),
            "origin": dict(source.full.origin),
            "findings": [asdict(finding) for finding in findings],
            "wrote": [file["path"] for file in files],
        }
    )
    return ExitStatus.DONE if agreed or findings else ExitStatus.LIMIT_NOT_MET


def parameters_of(run: Path) -> Path:
    """Return the parameters.npz of a run given by its folder or by the file."""
    return run / "parameters.npz" if run.is_dir() else run


def source_of(common: Common, stored: StoredResult, which: str, urdf: Path | None) -> IdentifiedArm:
    """Return what is exported, from a stored result."""
    from dynid.exporters import IdentifiedArm, Provenance, full_model
    from dynid.version import __version__
    from dynid.workflows.validate import base_model_of

    base, found = base_model_of(stored, stored.path.parent), stored.identification
    theta = found.physical.theta if which == "physical" else found.plain
    version = str(stored.header.get("dynid", __version__))
    made = Provenance(version, found.method, which, found.relative_error_percent, stored.log_sha256)
    return IdentifiedArm(base, theta, found.knowledge, full_model(base, found.physical, theta), made, urdf)


def possible(source: IdentifiedArm, wanted: dict[str, Format], allowed: bool) -> list[Finding]:
    """Refuse bodies that cannot exist in formats that need bodies, or warn when they are wanted all the same."""
    impossible = source.full.impossible_links()
    holding = [name for name, exporter in wanted.items() if exporter.needs_bodies]
    if not impossible or not holding:
        return []
    links = ", ".join(str(link) for link in impossible)
    what = f"no body has the parameters of link {links}: mass or inertia not positive, or triangle inequality broken"
    if not allowed:
        raise NotPhysical(
            what,
            why=f"simulators refuse such a {'/'.join(holding)} file or replace its inertias silently",
            fix="export --set physical, or c, python, matlab or yaml, or add --allow-infeasible",
        )
    return [Finding("W409", "warning", what, {"links": list(impossible)})]


def write(common: Common, path: Path, text: str) -> Path:
    """Write a file, unless it is there already."""
    from dynid.cli.prompt import may_write
    from dynid.files.artifact import write_text

    if path.is_file() and path.read_bytes() == text.encode() and not common.force:
        common.terminal.stage("reused", f"{path}       (the same bytes)")
    elif may_write(common, path, {}):
        write_text(path, text)
        common.terminal.wrote(path)
    return path


def checked(
    common: Common, exporter: Format, path: Path, text: str, source: IdentifiedArm
) -> tuple[dict[str, Any], bool]:
    """Load a written text and return what came out, and whether it agrees."""
    from dynid.exporters import LoadingFailed

    refused = ""
    agreements: list[Agreement] = []
    with common.terminal.progress() as progress:
        progress.stage("compare", path.name)
        try:
            agreements = exporter.check(text, source, common.seed)
        except LoadingFailed as error:
            refused = str(error)
    fine = not refused and all(agreement.agrees for agreement in agreements)
    if not fine:
        worst = refused or ", ".join(f"{a.engine} differs by {a.largest:.3g}" for a in agreements)
        common.terminal.finding(Finding("W408", "warning", f"{path}: {worst}", {}))
    checks = [
        {
            "engine": a.engine,
            "what": a.what,
            "largest_difference_nm": a.largest,
            "torque_rms_nm": a.torque_rms,
            "states": a.states,
            "agrees": a.agrees,
        }
        for a in agreements
    ]
    leaves_out = list(exporter.leaves_out(source))
    return {
        "format": exporter.name,
        "path": str(path),
        "checks": checks,
        "refused": refused or None,
        "leaves_out": leaves_out,
    }, fine


def show(common: Common, files: list[dict[str, Any]]) -> None:
    """Print what was compared and what the formats leave out."""
    rows = []
    for file in files:
        for check in file["checks"]:
            shown = f"{check['largest_difference_nm']:.1e} of {check['torque_rms_nm']:.3g} N m"
            rows.append([file["format"], check["engine"], check["what"], shown])
        if not file["checks"]:
            rows.append([file["format"], "-", "refused" if file["refused"] else "no program here to load it", "-"])
    common.terminal.table(["format", "loaded in", "compared", "largest difference"], rows, numbers=False)
    for file in files:
        for sentence in file["leaves_out"]:
            common.terminal.answer(f"{file['format']} has no place for {sentence}")
