"""Arms with known bodies, and the engines' builders of tests/physics."""

import sys
from pathlib import Path

sys.path.insert(0, str(Path(__file__).parents[2] / "physics"))
