"""The sections of the report, one file each, in the order of the page."""

from dynid.reports.sections.excitation import Excitation
from dynid.reports.sections.gap import Gap
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.sections.limits import Limits
from dynid.reports.sections.parameters import Parameters
from dynid.reports.sections.physics import Physics
from dynid.reports.sections.quality import Quality
from dynid.reports.sections.residual import Residual
from dynid.reports.sections.run import Run
from dynid.reports.sections.torque import Torque
from dynid.reports.sections.unseen import UnseenLog
from dynid.reports.sections.verdict import Verdict

SECTIONS: tuple[Section, ...] = (
    Verdict(), Run(), Quality(), Excitation(), Parameters(), Torque(), UnseenLog(), Residual(), Gap(), Physics(),
    Limits(),
)  # fmt: skip

__all__ = ["SECTIONS", "Picture", "Section"]
