"""report.html: all sections in one file that needs no network, and the summary for a pull request."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from dynid.reports.gathered import Gathered
from dynid.reports.sections.gap import gap
from dynid.reports.sections.motion import excitation, residual, torque, unseen
from dynid.reports.sections.parameters import parameters
from dynid.reports.sections.physics import physics
from dynid.reports.sections.verdict import limits, next_steps, quality, run, sentences, verdict
from dynid.text import markdown, printable

if TYPE_CHECKING:
    from jinja2 import Environment


@dataclass(frozen=True)
class Section:
    """One section of the report.

    Attributes:
        title: heading.
        anchor: name in links, and of the template ``templates/<anchor>.html``.
        context: returns the values of the template.
    """

    title: str
    anchor: str
    context: Callable[[Gathered], dict[str, Any]]


#: In the order of the page.
SECTIONS = (
    Section("Verdict", "verdict", verdict),
    Section("What to do next", "next", next_steps),
    Section("What was run", "run", run),
    Section("Data quality", "quality", quality),
    Section("Excitation", "excitation", excitation),
    Section("Parameters", "parameters", parameters),
    Section("Measured and predicted torque", "torque", torque),
    Section("Unseen log", "unseen", unseen),
    Section("Where the residual is", "residual", residual),
    Section("Missing effects", "gap", gap),
    Section("Physical possibility", "physics", physics),
    Section("Limits of this result", "limits", limits),
)


def page(gathered: Gathered) -> str:
    """Return the page of what was gathered."""
    from markupsafe import Markup

    environment = templates()
    parts = []
    for number, section in enumerate(SECTIONS, start=1):
        body = environment.get_template(f"{section.anchor}.html").render(section.context(gathered))
        parts.append(
            {
                "number": number,
                "title": section.title,
                "anchor": section.anchor,
                "body": Markup(body),
            }
        )
    return environment.get_template("page.html").render(robot=gathered.robot.name, parts=parts)


def templates() -> Environment:
    """Return the templates of pages: every text is escaped, drawings are dynid's own, the style sheet is at hand."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("dynid.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters["drawing"] = Markup
    environment.globals["style"] = Markup(environment.get_template("style.css").render())
    return environment


def _shown(value: Any) -> Any:  # noqa: ANN401
    """Return what a template shows of a value: text without control characters, markup of our own as it is."""
    return printable(value) if isinstance(value, str) and not hasattr(value, "__html__") else value


def summary(gathered: Gathered) -> str:
    """Return a compact Markdown summary for a pull request."""
    marks = {"good": "🟢", "fair": "🟡", "bad": "🔴", "open": "⚪"}
    lines = [
        f"### {markdown(gathered.robot.name)}",
        "",
        *(markdown(text) for text in sentences(gathered)),
        "",
    ]
    lines += ["| | | |", "| --- | --- | --- |"]
    lines += [
        f"| {marks[light.state]} {light.shown} | {light.title} | {markdown(light.text)} |"
        for light in gathered.judgement.lights
    ]
    lines += ["", "| joint | rms error | unexplained | held out |", "| --- | ---: | ---: | ---: |"]
    for joint, row in zip(gathered.robot.joints, gathered.result.joints, strict=True):
        held = "-" if row.heldout_rms is None else f"{row.heldout_rms:.3g} {joint.torque_unit}"
        lines.append(
            f"| {markdown(row.joint)} | {row.rms:.3g} {joint.torque_unit} | {row.relative_percent:.1f} % | {held} |"
        )
    return "\n".join([*lines, ""])
