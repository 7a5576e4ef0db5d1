"""Is the robot file wrong about this arm, or its driver about the torques? Asked of a checked log."""
