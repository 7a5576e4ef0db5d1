"""The pages of the documentation, which come with dynid."""

from __future__ import annotations

from pathlib import Path


def pages() -> dict[str, Path]:
    """Return the pages of the documentation by name, such as ``robot-file``."""
    from dynid.files.robotfile import packaged

    return {path.stem: path for path in sorted(packaged("docs").rglob("*.md"))}
