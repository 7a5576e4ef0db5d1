"""An arm from the name of a robot file, from a YAML file or from a URDF."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from dynid.errors import WrongUsage
from dynid.robot import Robot
from dynid.workflows import arguments
from dynid.workflows.arguments import public

if TYPE_CHECKING:
    from dynid.workflows.arguments import RobotLike

URDF = ".urdf"


@public
def load_robot(source: RobotLike, *, base: str | None = None, tip: str | None = None) -> Robot:
    """Return an arm.

    Args:
        source: name of a robot file that comes with dynid, path of a robot file, or path of a URDF; ``arm.urdf#link``
            names the last link of the arm as well; or an arm, which is returned.
        base: first link of the arm in a URDF; None for its root.
        tip: last link of the arm in a URDF; None for where the chain ends.

    Raises:
        WrongUsage: an argument is something else than what is wanted (E101).
        RobotNotFound: there is no such file (E205).
        DynidError: the file has a mistake (E201 to E207), or the URDF does not say which chain is the arm.

    Example:
        dynid.load_robot("kuka_lwr4plus")
    """
    from dynid.files import robotfile

    if not isinstance(source, (str, Path)):
        return arguments.robot(source, "source")
    arguments.path(source, "source")
    base = arguments.optional(base, str, "base", "the name of a link")
    tip = arguments.optional(tip, str, "tip", "the name of a link")
    file, mark, link = str(source).rpartition("#")
    path = Path(file if mark and file.lower().endswith(URDF) else source)
    if path.suffix.lower() != URDF:
        if tip is not None or base is not None:
            raise WrongUsage(
                f"{source} is not a URDF: its chain has one tip", fix="leave out --tip"
            )
        return robotfile.load_robot(source)
    from dynid.workflows.import_urdf import ImportOptions, import_urdf

    if not path.is_file():
        robotfile.find_robot(str(path))  # ends with the message that a missing robot file gets
    found = import_urdf(
        path, ImportOptions(base=base, tip=tip or (link if path != Path(source) else None))
    )
    return replace(
        found.robot, source=str(source), findings=(*found.robot.findings, *found.findings)
    )
