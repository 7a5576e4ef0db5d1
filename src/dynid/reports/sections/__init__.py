"""The sections of the report in the order of the page."""

from dynid.reports.sections.gap import gap
from dynid.reports.sections.interface import Picture, Section
from dynid.reports.sections.motion import excitation, residual, torque, unseen
from dynid.reports.sections.next_steps import next_steps
from dynid.reports.sections.parameters import parameters
from dynid.reports.sections.physics import physics
from dynid.reports.sections.verdict import limits, quality, run, verdict

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

__all__ = ["SECTIONS", "Picture", "Section"]
