"""A position-controlled arm in Pinocchio: neither its equations nor its friction are dynid's."""

import numpy as np
import pinocchio as pin

from arms import pinocchio_model
from dynid import Log

#: Midpoint steps of the physics within one sample of the controller.
SUBSTEPS = 2


def follow_motion(robot, bodies, friction, rotor, motion, controller, encoder, torque, rng):
    """Return the log of an arm whose encoder noise is fed back.

    Args:
        robot: geometry.
        bodies: true bodies.
        friction: of all joints, a ``sim.arm.Friction``.
        rotor: rotor inertias, (n,).
        motion: the command, at the controller's samples.
        controller: stiffness and damping of each joint, (2, n).
        encoder: standard deviation of the positions [rad].
        torque: of the torques, (n,) [N m].
        rng: source of the noise.
    """
    plant = pinocchio_model(robot, bodies, rotor)
    data, step = plant.createData(), float(motion.t[1] - motion.t[0])
    (kp, kd), h = np.array(controller), step / SUBSTEPS
    q, qd = motion.q[0].copy(), motion.qd[0].copy()
    seen = motion.q + encoder * rng.standard_normal(motion.q.shape)
    tau = np.zeros_like(seen)
    slow, before = np.exp(-2 * np.pi * 60.0 * step), None
    speed = qd.copy()
    for k in range(len(seen)):
        seen[k] += q - motion.q[k]
        if before is not None:
            speed = slow * speed + (1 - slow) * (seen[k] - before) / step
        before = seen[k]
        tau[k] = kp * (motion.q[k] - seen[k]) + kd * (motion.qd[k] - speed)
        for _ in range(SUBSTEPS):
            half = qd + 0.5 * h * pin.aba(plant, data, q, qd, tau[k] - friction.torque(qd))
            qdd = pin.aba(plant, data, q + 0.5 * h * qd, half, tau[k] - friction.torque(half))
            q, qd = q + h * half, qd + h * qdd
    # A torque is held from its sample to the next, so the mean of two belongs to the sample between them.
    tau[1:] = 0.5 * (tau[1:] + tau[:-1])
    tau += np.array(torque) * rng.standard_normal(tau.shape)
    return Log(
        motion.t, seen, tau, robot.joint_names, tau_unit="Nm", dh=True, extra={"q_ref": motion.q}
    )
