"""Loop 2a, plan an excitation motion: limits and model -> trajectory.npz, seen and judged before anything moves."""
