"""The version of dynid, apart from the public names so that reading it imports nothing else."""

__version__ = "0.1.0"
