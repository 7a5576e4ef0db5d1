"""What is exported, and a format: the text of a file, what it has no place for, and a proof by loading it again."""

from __future__ import annotations

import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np

from dynid.arrays import Floats
from dynid.estimation.residual_model import ModelError
from dynid.exporters.full_model import FullModel
from dynid.model.base_model import BaseModel
from dynid.model.effects.motion import ArmMotion
from dynid.model.reduce import random_states
from dynid.robot import Robot
from dynid.text import file_name

#: Torques (N, n) [N m or N] of positions, velocities and accelerations, each (N, n) [rad or m, and per s and s^2].
Torques = Callable[[Floats, Floats, Floats], Floats]

#: What is said of the residual model where a format has no place for it.
RESIDUAL = "the residual model: the file predicts by the parameters alone"
#: Number of random states that a written file is compared on.
STATES = 1000
#: Time between two of them [s]; effects of the time and of bristles are compared along them.
STEP_S = 0.01


@dataclass(frozen=True)
class IdentifiedArm:
    """What is exported.

    Attributes:
        base: model and base parameters.
        theta: values of the base parameters, (p,).
        known: how well each is known, ``"well"``, ``"negligible"``, ``"roughly"`` or ``"not determined"``, (p,).
        full: one body per link.
        version: dynid that identified the numbers.
        method: estimator.
        parameter_set: ``"physical"`` or ``"plain"``.
        relative_error_percent: 100 |tau - W theta| / |tau| of the fit [%].
        log_sha256: hashes of the logs.
        urdf: the user's own URDF, None to make one.
        warning: what about the numbers cannot be, where they are written all the same.
        model_error: residual model of the result, None where it has none.
        residual_model: whether code predicts with it.
    """

    base: BaseModel
    theta: Floats
    known: tuple[str, ...]
    full: FullModel
    version: str
    method: str
    parameter_set: str
    relative_error_percent: float
    log_sha256: tuple[str, ...]
    urdf: Path | None = None
    warning: str = ""
    model_error: ModelError | None = None
    residual_model: bool = True

    @property
    def predicted_error(self) -> ModelError | None:
        """The residual model that code predicts with, None without."""
        return self.model_error if self.residual_model else None

    @property
    def robot(self) -> Robot:
        """The arm."""
        return self.full.robot

    @property
    def file_stem(self) -> str:
        """Name of its files, without suffix."""
        return file_name(self.robot.slug)

    def head(self, escape: Callable[[str], str], *, holds_residual: bool = False) -> str:
        """Return the line at the head of every file: robot, method, logs, and whether it has the residual model.

        Args:
            escape: function of ``dynid.text`` for the place where the line is written.
            holds_residual: whether the format can hold the residual model.
        """
        residual = ""
        if self.model_error is not None:
            residual = (
                "; with its residual model"
                if holds_residual and self.residual_model
                else "; the parameters alone, without the result's residual model"
            )
        hashes = ", ".join(escape(sha[:12]) for sha in self.log_sha256)
        return (
            f"{escape(self.robot.name)}, identified by dynid {escape(self.version)} ({escape(self.method)}, "
            f"{escape(self.parameter_set)} set, relative error {self.relative_error_percent:.3g} %) "
            f"from logs with sha256 {hashes}{residual}{f'; WARNING: {escape(self.warning)}' if self.warning else ''}"
        )


def motion_of(arm: IdentifiedArm, q: Floats, qd: Floats, qdd: Floats) -> ArmMotion:
    """Return a motion through states, (N, n) each, that are STEP_S apart."""
    t = STEP_S * np.arange(len(q), dtype=np.float64)
    return ArmMotion(t, q, qd, qdd, arm.robot, arm.base.torques(arm.theta), lambda x: x)


@dataclass(frozen=True)
class Agreement:
    """How well a written file agrees with dynid's own torques.

    Attributes:
        engine: program that loaded the file.
        largest: largest difference of a torque [N m or N].
        torque_rms: root mean square of the torques that were compared [N m or N].
        states: number of random states.
        what: what was compared, such as ``"rigid body"``.
        agrees: whether the difference is within the tolerance of the format.
    """

    engine: str
    largest: float
    torque_rms: float
    states: int
    what: str
    agrees: bool


class LoadingFailed(Exception):
    """A program refused the file or could not compute with it; the message is the program's own."""


class Loaded(NamedTuple):
    """A file in an engine: the engine, what is compared, its torques and dynid's own."""

    engine: str
    what: str
    theirs: Torques
    ours: Torques


@dataclass(frozen=True)
class Format:
    """One format.

    Attributes:
        name: name of the format.
        suffix: suffix of its files.
        text: returns the text of the file.
        leaves_out: returns what the format has no place for, one phrase each.
        loaded: loads such a text; None where no program here can.
        needs_bodies: whether it holds one body per link, so that the parameters must be physically possible.
        tolerance: largest difference of a torque that counts as agreement, relative to the torques' root mean square.
    """

    name: str
    suffix: str
    text: Callable[[IdentifiedArm], str]
    leaves_out: Callable[[IdentifiedArm], tuple[str, ...]]
    loaded: Callable[[str, IdentifiedArm], Loaded | None]
    needs_bodies: bool = True
    tolerance: float = 1e-6

    def check(self, text: str, arm: IdentifiedArm, seed: int = 0) -> list[Agreement]:
        """Compare the torques of a file's text with dynid's on random states; nothing where it cannot be loaded.

        The text is loaded, never what lies in the folder of the results.

        Args:
            text: the file's text, as ``Format.text`` made it.
            arm: what it was made from.
            seed: seed of the random states.

        Raises:
            LoadingFailed: a program refused the file.
        """
        states = random_states(arm.robot, STATES, seed)
        try:
            loaded = self.loaded(text, arm)
            if loaded is None:
                return []
            expected, theirs = loaded.ours(*states), loaded.theirs(*states)
        except (ValueError, RuntimeError, SystemError, subprocess.CalledProcessError) as error:
            raise LoadingFailed(" ".join(str(error).split())) from error
        except (OSError, subprocess.TimeoutExpired):
            # Programs may not be run from the folder of temporary files, or the compiler takes too long.
            return []
        difference = float(np.abs(theirs - expected).max())
        largest = difference if np.isfinite(difference) else np.inf
        size = float(np.sqrt(np.mean(expected**2)))
        agrees = largest <= self.tolerance * max(1.0, size)
        return [Agreement(loaded.engine, largest, size, STATES, loaded.what, agrees)]
