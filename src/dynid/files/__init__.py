"""Disk to nouns and back, without maths: robot files, results, logs; and the files that come with dynid."""

from __future__ import annotations

from pathlib import Path


def packaged(folder: str) -> Path:
    """Return the folder ``robots``, ``trajectories`` or ``docs`` that came with dynid."""
    inside = Path(__file__).parents[1] / f"_{folder}"
    return inside if inside.is_dir() else Path(__file__).parents[3] / folder


def pages() -> dict[str, Path]:
    """Return the pages of the documentation by name, such as ``robot-file``."""
    return {path.stem: path for path in sorted(packaged("docs").rglob("*.md"))}
