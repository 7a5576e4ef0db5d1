"""Find contacts on a log: intervals in which the torque from outside is above a threshold for a stated alarm rate."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from dynid.errors import WrongUsage
from dynid.options import option
from dynid.progress import Progress
from dynid.table import Table
from dynid.workflows import arguments
from dynid.workflows.arguments import public
from dynid.workflows.logs import LogOptions

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from dynid.estimation.contacts import ExternalTorque
    from dynid.robot import Robot
    from dynid.workflows.arguments import LogLike, ResultLike

#: Seconds of the units of a rate.
_HOURS: Mapping[str, float] = {"h": 1.0, "min": 1.0 / 60.0, "day": 24.0}


def _rate(value: Any, name: str) -> float:  # noqa: ANN401
    """Return false alarms an hour from a number, or from a text such as 1/h, 2/min or 5/day."""
    number, _, unit = str(value).replace(" ", "").partition("/")
    try:
        found = float(number) / _HOURS[unit or "h"]
    except (KeyError, ValueError):
        raise WrongUsage(f"{name} '{value}' is not understood", fix=f"{name} 1/h") from None
    if not 1e-6 <= found <= 1e6:
        raise WrongUsage(f"{name} '{value}' cannot be had", fix=f"{name} 1/h")
    return found


@dataclass(frozen=True)
class ContactOptions(LogOptions):
    """How contacts are looked for."""

    false_alarms: float = option(
        1.0,
        "False alarms that the threshold is made for, over all joints: 1/h, 2/min, 5/day.",
        read=_rate,
        metavar="RATE",
        shown="1/h",
    )


@dataclass(frozen=True, repr=False)
class FoundContacts:
    """Contacts on one log.

    Attributes:
        robot: the arm.
        log: name of the log.
        external: the torque from outside, its threshold and the contacts.
    """

    robot: Robot
    log: str
    external: ExternalTorque

    def table(self) -> Table:
        """Return one row per contact: joint, time [s], length [s], largest torque [N m or N]."""
        units = dict(
            zip(
                self.robot.joint_names,
                (joint.torque_unit for joint in self.robot.joints),
                strict=True,
            )
        )
        start = self.external.begin
        return Table(
            [
                {
                    "joint": each.joint,
                    "from [s]": round(each.start - start, 3),
                    "to [s]": round(each.end - start, 3),
                    "peak": float(f"{each.peak:.4g}"),
                    "unit": units[each.joint],
                }
                for each in self.external.contacts
            ]
        )

    def sentence(self) -> str:
        """Return the answer in one sentence."""
        found, hours = self.external, (self.external.t[-1] - self.external.t[0]) / 3600.0
        alarms = f"{found.false_alarms * hours:.2g} false alarms are to be expected on it"
        count = len(found.contacts)
        if not count:
            return f"No contact: the torque from outside stays below the threshold of every joint; {alarms}."
        if found.changed:
            return (
                f"The arm has changed since it was identified, perhaps by a load or warm gears: {count} times the "
                "torque from outside is above the threshold, too often for touches."
            )
        joints = len({each.joint for each in found.contacts})
        return (
            f"{count} contact{'s' * (count > 1)} on {joints} joint{'s' * (joints > 1)}; {alarms}."
        )

    def facts(self) -> dict[str, Any]:
        """Return what the JSON answer of ``dynid contacts`` says."""
        return {
            "schema": "dynid/contacts/1",
            "robot": self.robot.name,
            "log": self.log,
            **self.external.facts(),
        }

    def plot(self) -> Figure:
        """Return a figure of the torque from outside and its threshold, joint by joint."""
        from dynid.reports.contacts import contacts_figure

        return contacts_figure(self.external, self.robot, self.log)

    def __repr__(self) -> str:
        """Return the answer and the table."""
        return "\n".join(
            [self.sentence(), *([repr(self.table())] if self.external.contacts else [])]
        )


@public
def contacts(
    result: ResultLike,
    log: LogLike,
    options: ContactOptions | None = None,
    *,
    progress: Progress | None = None,
    **changes: Any,  # noqa: ANN401
) -> FoundContacts:
    """Find when and where something touched an arm.

    Args:
        result: identified parameters, their folder or their file.
        log: the recording, or its path.
        options: rate of false alarms, and how the log is read.
        progress: reports how far the work is.
        changes: single options by name, such as ``false_alarms="10/h"``; see ``dynid.ContactOptions``.

    Raises:
        WrongUsage: an argument or option is something else than what is wanted (E101).
        DynidError: the first serious fault of the log.

    Example:
        dynid.contacts("out/kuka_lwr4plus", "day3.bag", false_alarms="1/h")
    """
    from dynid.workflows.logs import checked_log

    options, progress = (
        arguments.options(ContactOptions, options, changes),
        arguments.progress(progress),
    )
    result = arguments.result(result)
    log = arguments.log(log, result.robot, options)
    progress.stage("observe")
    checked = checked_log(log, result.robot, options, identify=False)
    found = result.external_torque(checked, options.false_alarms)
    return FoundContacts(result.robot, str(log.source or log.name), found)


def save_figure(found: FoundContacts, path: Path) -> Path:
    """Write the picture."""
    from dynid.reports.figures import write_figure

    return write_figure(found.plot(), path)
