"""An arm from the name of a robot file, from a YAML file or from a URDF."""

from __future__ import annotations

from pathlib import Path

from dynid.robot import Robot


def load_robot(source: str | Path, *, base: str | None = None, tip: str | None = None) -> Robot:
    """Return an arm.

    Args:
        source: name of a robot file that comes with dynid, path of a robot file, or path of a URDF.
        base: first link of the arm in a URDF; None for its root.
        tip: last link of the arm in a URDF; None for where the chain ends.

    Raises:
        RobotNotFound: there is no such file (E205).
        DynidError: the file has a mistake (E201 to E207), or the URDF does not say which chain is the arm.
    """
    from dynid.files import robotfile

    path = Path(source)
    if path.suffix.lower() != ".urdf":
        return robotfile.load_robot(source)
    from dynid.workflows.import_urdf import ImportOptions, import_urdf

    return import_urdf(path, ImportOptions(base=base, tip=tip)).robot
