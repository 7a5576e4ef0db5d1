"""The report of a result: one page that needs no network, and a summary for a pull request."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from dynid.arguments import public
from dynid.disk import write_text
from dynid.judgement.judge import Judgement
from dynid.loading import ResultLike, as_result
from dynid.progress import Progress, stage
from dynid.reports.gathered import gather
from dynid.reports.page import page, sentences, summary
from dynid.text import html


@dataclass(frozen=True)
class Report:
    """A report.

    Attributes:
        robot: name of the arm.
        verdict: the answer, why, and what to beware of, in sentences.
        judgement: what is good and what is not, and what to do next.
        html: the page; it needs no network and runs no script.
        markdown: the summary.
    """

    robot: str
    verdict: tuple[str, ...]
    judgement: Judgement
    html: str = field(repr=False)
    markdown: str = field(repr=False)

    def save(self, folder: Path | str) -> list[Path]:
        """Write report.html and summary.md to a folder and return their paths."""
        texts = {"report.html": self.html, "summary.md": self.markdown}
        for name, text in texts.items():
            write_text(Path(folder) / name, text)
        return [Path(folder) / name for name in texts]

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid report`` says."""
        return {
            "schema": "dynid/report/1",
            "robot": self.robot,
            "verdict": list(self.verdict),
            "lights": {light.name: light.state for light in self.judgement.lights},
            "judgement": self.judgement.facts(),
        }

    def _repr_html_(self) -> str:
        said = "".join(f"<p>{html(sentence)}</p>" for sentence in self.verdict)
        lights = (f"{light.name}: {light.state}, {light.text}" for light in self.judgement.lights)
        return f"{said}<ul>{''.join(f'<li>{html(light)}</li>' for light in lights)}</ul>"


@public
def report(result: ResultLike, *, progress: Progress | None = None) -> Report:
    """Make the report of a result and of the files in its folder: validations, stack, search for missing effects.

    Args:
        result: identified parameters, their folder or their file; a new result that was not saved has a report without
            validations.
        progress: reports that the report is made.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).

    Example:
        dynid.report("out/kuka_lwr4plus").save("out/kuka_lwr4plus")
    """
    result = as_result(result)
    stage("report")
    gathered = gather(result)
    return Report(
        result.robot.name,
        tuple(sentences(gathered)),
        gathered.judgement,
        page(gathered),
        summary(gathered),
    )
