"""What decides in this folder: thresholds, counts and shares, each with its unit and what it rests on."""

#: Share of a joint's torque that the plain fit may leave before ``identify`` asks whether the robot file is wrong.
UNEXPLAINED = 0.05
#: Share of the roughly expected weight that the fit must have found at the heaviest joint, else it is asked as well.
WEIGHT = 0.2
#: Poses that the weight is compared in.
POSES_OF_WEIGHT = 500
