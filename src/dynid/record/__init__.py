"""Loop 2b, on the arm: trajectory.npz -> log.bag, the paper's text files and manifest.yaml.

Everything is checked before a joint moves, watched while it moves, and stopped when anything is not as it should be.
"""
