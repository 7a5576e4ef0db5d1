"""What measuring adds to the truth: torque noise, encoder steps, velocity noise, jitter of the time stamps."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from dynid.log import Log
from dynid.sim.track import SimulatedRun


@dataclass(frozen=True)
class Sensors:
    """Sensors of all joints; every noise is white and normal.

    Attributes:
        torque_noise: standard deviation, (n,) [N m or N].
        position_step: resolution of the encoders [rad or m]; 0 for none.
        velocity_noise: standard deviation [rad/s or m/s]; None when the driver gives no velocity.
        stamp_jitter: standard deviation of stamp minus sampling time [s].
    """

    torque_noise: tuple[float, ...]
    position_step: float
    velocity_noise: float | None
    stamp_jitter: float

    @classmethod
    def perfect(cls, n: int) -> Sensors:
        """Return sensors that tell the truth."""
        return cls((0.0,) * n, 0.0, 0.0, 0.0)

    def measure(self, truth: SimulatedRun, names: tuple[str, ...], rng: np.random.Generator) -> Log:
        """Return the log of a recording.

        Args:
            truth: what the arm did.
            names: names of the columns.
            rng: source of the noise.
        """
        period = float(truth.t[1] - truth.t[0])
        jitter = np.clip(rng.normal(0.0, self.stamp_jitter, len(truth.t)), -0.45 * period, 0.45 * period)
        q = np.round(truth.q / self.position_step) * self.position_step if self.position_step else truth.q
        tau = truth.tau + rng.normal(0.0, 1.0, truth.tau.shape) * np.array(self.torque_noise)
        qd = None if self.velocity_noise is None else truth.qd + rng.normal(0.0, self.velocity_noise, truth.qd.shape)
        return Log(truth.t + jitter, q, tau, names, qd, tau_unit="Nm", extra={"q_ref": truth.q_ref})
