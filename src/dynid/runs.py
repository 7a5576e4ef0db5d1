"""The folder of a run: where its files lie, what they were made from, and what a new search removes."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path


@dataclass(frozen=True)
class RunFolder:
    """A folder with the files of one arm's run; none has to be there."""

    path: Path

    @classmethod
    def of(cls, run: Path) -> RunFolder:
        """Return the folder of a run given by itself or by a file in it."""
        return cls(run if run.is_dir() else run.parent)

    @property
    def model(self) -> tuple[Path, Path]:
        """The regressor and its base parameters."""
        return self.path / "regressor.npz", self.path / "fullregressor.npz"

    @property
    def stack(self) -> Path:
        """The rows of the training logs."""
        return self.path / "fullnumericregressor.npz"

    @property
    def motion(self) -> Path:
        """Measured and predicted torques of the training logs."""
        return self.path / "estimatedmotion.npz"

    @property
    def parameters(self) -> Path:
        """The result."""
        return self.path / "parameters.npz"

    @property
    def report(self) -> Path:
        """The page about the result."""
        return self.path / "report.html"

    @property
    def search(self) -> Path:
        """What the search for missing effects found; its pictures lie in ``gap/``."""
        return self.path / "gap.npz"

    @property
    def simulated(self) -> Path:
        """What was driven in a simulator after a search."""
        return self.path / "simulator_gap.npz"

    @property
    def validations(self) -> list[Path]:
        """The replays of other logs."""
        return sorted(self.path.glob("validation/*/estimatedmotion.npz"))

    def remove_search(self) -> None:
        """Remove what an earlier search left: its pictures and what was driven say nothing of a new one."""
        pictures = ("gap/where.png", "gap/shrink.png", "gap/simulator.png", "gap/effect_*.png")
        for name in (*pictures, self.search.name, self.simulated.name):
            for path in self.path.glob(name):
                path.unlink(missing_ok=True)
