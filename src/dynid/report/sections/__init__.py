"""The sections of the report, one file each, in the order of the page."""

from dynid.report.sections.excitation import Excitation
from dynid.report.sections.gap import Gap
from dynid.report.sections.interface import Picture, Section
from dynid.report.sections.limits import Limits
from dynid.report.sections.parameters import Parameters
from dynid.report.sections.physics import Physics
from dynid.report.sections.quality import Quality
from dynid.report.sections.residual import Residual
from dynid.report.sections.run import Run
from dynid.report.sections.torque import Torque
from dynid.report.sections.unseen import UnseenLog
from dynid.report.sections.verdict import Verdict

SECTIONS: tuple[Section, ...] = (
    Verdict(), Run(), Quality(), Excitation(), Parameters(), Torque(), UnseenLog(), Residual(), Gap(), Physics(),
    Limits(),
)  # fmt: skip

__all__ = ["SECTIONS", "Picture", "Section"]
