"""What an exporter takes and gives: text, what the format cannot hold, and a check by loading the file again."""

from __future__ import annotations

import subprocess
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dynid.exporters.full_model import WholeArm
from dynid.model.reduce import random_states
from dynid.model.store import BaseModel

Floats = NDArray[np.float64]
Torques = Callable[[Floats, Floats, Floats], Floats]

#: Random states that a written file is compared on.
STATES = 1000


@dataclass(frozen=True)
class Source:
    """What is exported.

    Attributes:
        base: model and base parameters.
        theta: values of the base parameters, (p,).
        known: how well each is known, ``"well"``, ``"roughly"`` or ``"not determined"``, (p,).
        full: one body a link; None for formats that need only base parameters.
        made_from: one line for the file's head: robot, method, logs.
        urdf: the user's own URDF, None to make one.
    """

    base: BaseModel
    theta: Floats
    known: tuple[str, ...]
    full: WholeArm
    made_from: str
    urdf: Path | None = None


@dataclass(frozen=True)
class Agreement:
    """How well a written file agrees with dynid's own torques.

    Attributes:
        engine: who loaded it.
        largest: largest difference of a torque [N m or N].
        torque_rms: size of the torques compared [N m or N].
        states: number of random states.
        what: what was compared, such as ``"rigid body"``.
    """

    engine: str
    largest: float
    torque_rms: float
    states: int
    what: str


class LoadingFailed(Exception):
    """A program refused the file or could not compute with it; the message is the program's own."""


class Exporter(ABC):
    """One format.

    Attributes:
        suffix: of the file.
        help: what it is for.
        needs_bodies: whether it holds one body a link, so that the set must be physically possible.
        tolerance: largest difference of a torque that counts as agreement, relative to their size.
    """

    suffix: str
    help: str
    needs_bodies = True
    tolerance = 1e-6

    @abstractmethod
    def text(self, source: Source) -> str:
        """Return the file's text."""

    @abstractmethod
    def leaves_out(self, source: Source) -> tuple[str, ...]:
        """Return what the format has no place for, one sentence each."""

    @abstractmethod
    def loaded(self, path: Path, source: Source) -> Iterator[tuple[str, str, Torques, Torques]]:
        """Load the file in each engine that is installed; yield its name, what is compared, its torques, dynid's."""

    def allowed(self, agreement: Agreement) -> float:
        """Return the largest difference that counts as agreement [N m or N]."""
        return self.tolerance * max(1.0, agreement.torque_rms)

    def check(self, path: Path, source: Source, seed: int = 0) -> list[Agreement]:
        """Compare the file's torques with dynid's on random states.

        Raises:
            LoadingFailed: a program refused the file.
        """
        q, qd, qdd = random_states(source.base.robot, STATES, seed)
        found = []
        try:
            for engine, what, theirs, ours in self.loaded(path, source):
                expected = ours(q, qd, qdd)
                largest = float(np.abs(theirs(q, qd, qdd) - expected).max())
                size = float(np.sqrt(np.mean(expected**2)))
                found.append(Agreement(engine, largest if np.isfinite(largest) else np.inf, size, STATES, what))
        except (ValueError, RuntimeError, subprocess.CalledProcessError) as error:
            raise LoadingFailed(" ".join(str(error).split())) from error
        return found
