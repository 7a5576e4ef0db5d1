"""Observation rows of conditioned logs, part after part, with the motion that candidate columns are made from."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import compress, pairwise

import numpy as np

from dynid.arrays import Floats, Ints, Mask
from dynid.estimation.rows import joined, parallel_filtered, rows_of
from dynid.model.base_model import BaseModel
from dynid.model.effects.catalogue import joined_motion
from dynid.model.effects.interface import Effect
from dynid.model.effects.motion import ArmMotion, Joints, ReferenceTorques, Shape
from dynid.signals.conditioned_log import ConditionedLog, arm_motion, with_effects

#: Columns of one effect by joint, such as {joint: (k, M)}.
EffectColumns = dict[int, Floats]


@dataclass(frozen=True)
class GapRows:
    """M instants of n joints with p base parameters, in parts without gaps; N samples of motion in each.

    Attributes:
        logs: the conditioned log of each part, that part alone.
        motions: of each part, at the rate that columns are evaluated at.
        number: of the log of each part, (P,).
        new: whether effects act in each part; not in earlier logs, when what has changed since is looked for, (P,).
        part: number of the part of each row, (M,).
        W: base regressor, (M, n, p).
        tau: torques, (M, n) [N m or N].
        use: rows that count: not clipped, not at rest, (M, n).
        stamp: time on the clock of the log, (M,) [s].
        train: rows that are searched, (M,); all until some are held out.
        held: rows that are held out, (M,).
        coulomb: Coulomb friction of a first fit, which errors at reversals are shares of, (n,) [N m or N].
        reversal: speed within which nobody knows how friction turns, (n,) [rad/s or m/s].
        turns: what other shapes of reversals would change, each one standard deviation, (n, c, M) [N m or N].
    """

    logs: tuple[ConditionedLog, ...]
    motions: tuple[ArmMotion, ...]
    number: Ints
    new: Mask
    part: Ints
    W: Floats
    tau: Floats
    use: Mask
    stamp: Floats
    train: Mask
    held: Mask
    coulomb: Floats
    reversal: Floats
    turns: Floats

    def __len__(self) -> int:
        """Return the number of rows."""
        return len(self.tau)

    @cached_property
    def parts(self) -> list[slice]:
        """Where the rows of each part are."""
        edges = np.searchsorted(self.part, np.arange(len(self.logs) + 1))
        return [slice(*pair) for pair in pairwise(edges.tolist())]

    @cached_property
    def at(self) -> Ints:
        """Number of each row in its part, (M,)."""
        return np.arange(len(self)) - np.searchsorted(self.part, self.part)

    @cached_property
    def t(self) -> Floats:
        """Time on the clock of the motion, (M,) [s]."""
        begins = [log.segments[0] for log in self.logs]
        return self.stamp + np.array([x.elapsed[0] - x.t[0] for x in begins])[self.part]

    @cached_property
    def q(self) -> Floats:
        """Positions under the filter of the torques, (M, n) [rad or m]."""
        return self.filtered([motion.q.T for motion in self.motions]).T

    @cached_property
    def qd(self) -> Floats:
        """Velocities under it, (M, n) [rad/s or m/s]."""
        return self.filtered([motion.qd.T for motion in self.motions]).T

    @cached_property
    def is_new(self) -> Mask:
        """Whether effects act in each row, (M,)."""
        return self.new[self.part]

    @property
    def rate(self) -> float:
        """Rate of the rows [Hz]."""
        return self.logs[0].filter.kept_rate

    @property
    def compared(self) -> bool:
        """Whether earlier logs are among them, and what is looked for acts in the new ones alone."""
        return not self.new.all()

    @cached_property
    def motion(self) -> ArmMotion:
        """All motion in which candidates act, one part after the other."""
        return joined_motion(list(compress(self.motions, self.new)))

    def only(self, chosen: Mask) -> GapRows:
        """Return the rows, of which only the chosen ones, (M,), count."""
        return replace(self, use=self.use & chosen[:, None])

    def with_reference(self, base: BaseModel, theta: Floats) -> GapRows:
        """Return the rows with effects that scale with other base parameters, (p,)."""
        reference = base.torques(theta)
        return replace(self, motions=tuple(replace(x, reference=reference) for x in self.motions))

    def filtered(self, signals: Sequence[Floats]) -> Floats:
        """Return signals of the motion of each part, (..., N) each, under the parallel filter, (..., M)."""
        filtered = [
            parallel_filtered(x.reshape(-1, x.shape[-1]), log.filter).reshape(*x.shape[:-1], -1)
            for x, log in zip(signals, self.logs, strict=True)
        ]
        return np.concatenate(filtered, axis=-1)

    def columns(
        self, effect: Effect, joints: Joints, shapes: Sequence[Shape], *, always: bool = False
    ) -> EffectColumns:
        """Return filtered columns of an effect for G shapes with equally many columns, {joint: (G, k, M)}.

        Args:
            effect: the effect.
            joints: where it sits.
            shapes: those that are tried.
            always: whether it acts in earlier logs too.
        """
        on = list(effect.rows(joints, self.tau.shape[1]))
        columns = np.zeros((len(on), len(shapes), len(effect.amplitudes(shapes[0])), len(self)))
        every = zip(self.parts, self.logs, self.motions, self.new, strict=True)
        for part, log, motion, new in every:
            if (always or new) and self.use[part][:, on].any():
                raw = np.array(effect.tried(motion, joints, shapes))
                kept = parallel_filtered(raw.reshape(-1, len(motion)), log.filter)
                columns[..., part] = np.moveaxis(kept.reshape(*raw.shape[:-1], -1), 2, 0)
        return dict(zip(on, columns, strict=True))


def gap_rows(
    logs: Sequence[ConditionedLog],
    base: BaseModel,
    reference: ReferenceTorques,
    earlier: Sequence[ConditionedLog] = (),
) -> GapRows:
    """Return the rows of conditioned logs, those of earlier ones first.

    Args:
        logs: conditioned logs, in which effects act.
        base: model and base parameters.
        reference: the current model, which effects scale with.
        earlier: conditioned logs in which they do not.
    """
    every = [with_effects(log, base.model, reference) for log in (*earlier, *logs)]
    number = np.repeat(np.arange(len(every)), [len(log.segments) for log in every])
    parts = [replace(log, segments=[segment]) for log in every for segment in log.segments]
    rows, n = joined([rows_of(part, base.observer) for part in parts]), base.robot.n
    return GapRows(
        logs=tuple(parts),
        motions=tuple(
            arm_motion(part.segments[0], part.filter, base.model, reference) for part in parts
        ),
        number=number,
        new=number >= len(earlier),
        part=np.cumsum(rows.begins) - 1,
        W=rows.W,
        tau=rows.tau,
        use=rows.use,
        stamp=rows.t,
        train=np.ones(len(rows.t), dtype=bool),
        held=np.zeros(len(rows.t), dtype=bool),
        coulomb=np.zeros(n),
        reversal=np.zeros(n),
        turns=np.zeros((n, 0, len(rows.t))),
    )


def on_joint(columns: EffectColumns, joint: int, count: int) -> Floats:
    """Return the columns of an effect on one joint, zeros where it does not act there, (k, count)."""
    some = next(iter(columns.values()))
    return columns.get(joint, np.zeros((len(some), count)))


def accelerated(torques: ReferenceTorques, q: Floats, qdd: Floats) -> Floats:
    """Return the torques of all joints by the acceleration of each joint alone, (n, N, n) [N m or N].

    Args:
        torques: the model of the arm.
        q: poses, (N, n) [rad or m].
        qdd: accelerations, (N, n), or those of all poses, (n,) or (1,) [rad/s^2 or m/s^2].
    """
    still = np.zeros_like(q)
    held = torques.rigid(q, still, still)
    pushed = [torques.rigid(q, still, still + qdd * alone) for alone in np.eye(q.shape[1])]
    return np.array(pushed) - held
