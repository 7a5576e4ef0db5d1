"""Lets studies import what they share with the tests: arms, models and motions."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[1] / "tests"))
