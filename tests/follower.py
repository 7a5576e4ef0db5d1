"""A position-controlled arm in Pinocchio: neither its equations nor its friction are dynid's."""

import numpy as np
import pinocchio as pin


def follow_motion(plant, friction, motion, controller, noise, *, smooth=60.0, substeps=2):
    """Return positions as the encoders see them and torques, (N, n) each, of an arm whose noise is fed back.

    Args:
        plant: Pinocchio's arm.
        friction: torques against velocities.
        motion: the command, at the controller's samples.
        controller: stiffness and damping of each joint, (2, n).
        noise: of the encoders, (N, n) [rad].
        smooth: cut-off of the controller's velocity [Hz], 0 for plain differences.
        substeps: midpoint steps of the physics within one sample of the controller.
    """
    data, step = plant.createData(), float(motion.t[1] - motion.t[0])
    (kp, kd), h = np.array(controller), step / substeps
    keep = np.exp(-2 * np.pi * smooth * step) if smooth else 0.0
    q, qd = motion.q[0].copy(), motion.qd[0].copy()
    seen, tau, speed = noise.copy(), np.zeros_like(noise), qd.copy()
    for k in range(len(seen)):
        seen[k] += q
        if k:
            speed = keep * speed + (1 - keep) * (seen[k] - seen[k - 1]) / step
        tau[k] = kp * (motion.q[k] - seen[k]) + kd * (motion.qd[k] - speed)
        for _ in range(substeps):
            # Why the midpoint: with Euler's steps positions lag by half a step, which looks like viscous friction.
            half = qd + 0.5 * h * pin.aba(plant, data, q, qd, tau[k] - friction(qd))
            qdd = pin.aba(plant, data, q + 0.5 * h * qd, half, tau[k] - friction(half))
            q, qd = q + h * half, qd + h * qdd
    return seen, tau
