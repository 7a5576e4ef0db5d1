"""Disk to nouns and back, without maths: robot files, results, logs; and the files that come with dynid."""

from __future__ import annotations

from pathlib import Path


def packaged(folder: str) -> Path:
    """Return the folder ``robots``, ``trajectories`` or ``docs`` that came with dynid."""
    inside = Path(__file__).parents[1] / f"_{folder}"
    return inside if inside.is_dir() else Path(__file__).parents[3] / folder


def typed(path: Path) -> str:
    """Return what a person types for a file: a robot's name where it came with dynid, else its path.

    The path is relative where the file lies below the working folder.
    """
    if path.parent == packaged("robots"):
        return path.stem
    here = Path.cwd()
    return str(path.relative_to(here) if path.is_relative_to(here) else path)


def pages() -> dict[str, Path]:
    """Return the pages of the documentation by name, such as ``robot-file``."""
    return {path.stem: path for path in sorted(packaged("docs").rglob("*.md"))}
