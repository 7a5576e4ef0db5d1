"""The folder of a run: where its files lie, whether one is current, and what to remove when it is not."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from dynid.files.artifact import read_header


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
    def trajectory(self) -> Path:
        """The planned motion."""
        return self.path / "trajectory.npz"

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

    def validation(self, log: str, sha256: str) -> RunFolder:
        """Return where a replay goes: named after the log, and after its hash where another log has that name."""
        name = Path(log).stem
        folder = RunFolder(self.path / "validation" / name)
        header = (read_header(folder.motion) if folder.motion.is_file() else None) or {}
        taken = header.get("log_sha256", [sha256]) != [sha256]
        return RunFolder(folder.path.with_name(f"{name}_{sha256[:8]}")) if taken else folder

    def remove_search(self) -> None:
        """Remove what an earlier search left: its pictures and what was driven say nothing of a new one."""
        pictures = ("where.png", "shrink.png", "simulator.png", "effect_*.png")
        left = [path for name in pictures for path in self.path.glob(f"gap/{name}")]
        for path in (*left, self.search, self.simulated):
            path.unlink(missing_ok=True)


def made_from(path: Path) -> Mapping[str, str] | None:
    """Return the inputs that a result file was made from, by name; None where it does not say them."""
    inputs = (read_header(path) or {}).get("inputs")
    return inputs if isinstance(inputs, dict) else None
