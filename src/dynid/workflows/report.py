"""The report of a result: one page that needs no network, and a summary for a pull request."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from dynid.answer import Answer, Answered, Facts, judged
from dynid.arguments import public
from dynid.disk import write_text
from dynid.judgement.rules import Judgement
from dynid.loading import ResultLike, as_result
from dynid.progress import Progress, stage
from dynid.reports.gathered import gather
from dynid.reports.page import page, summary
from dynid.runs import RunFolder


@dataclass(frozen=True, repr=False)
class Report(Answered):
    """A report.

    Attributes:
        robot: name of the arm.
        judgement: what is good and what is not, and what to do next.
        html: the page; it needs no network and runs no script.
        markdown: the summary.
    """

    robot: str
    judgement: Judgement
    html: str
    markdown: str

    def save(self, folder: Path | str) -> list[Path]:
        """Write report.html and summary.md to a folder and return their paths."""
        texts = {"report.html": self.html, "summary.md": self.markdown}
        for name, text in texts.items():
            write_text(Path(folder) / name, text)
        return [Path(folder) / name for name in texts]

    def facts(self) -> Facts:
        """Return what the JSON answer of ``dynid report`` says."""
        return {
            "robot": self.robot,
            "verdict": self.judgement.sentences,
            "lights": {light.name: light.state for light in self.judgement.lights},
            "judgement": self.judgement.facts(),
        }

    def answer(self) -> Answer:
        """Return what ``dynid report`` answers."""
        return judged(self.judgement, self.facts())


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
    return Report(result.robot.name, gathered.judgement, page(gathered), summary(gathered))


def renewed(path: Path, *, first: bool = False) -> list[Path]:
    """Write the report beside a result again, where there is one or it is the first, and return its files.

    Why: what is written beside a result makes the page there say less than is known, or something else.
    """
    run = RunFolder.of(path)
    if not (first or run.report.is_file()):
        return []
    return report(path).save(run.path)
