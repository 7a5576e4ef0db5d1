"""Loop 2a, plan an exciting motion: limits and model -> trajectory.npz, previewed and checked before anything moves."""
