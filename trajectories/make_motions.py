"""Make the excitation motions that ship with dynid: 10 s at full speed, at alpha 1.0, 0.5 and 0.2.

Run: python trajectories/make_motions.py            plan, write the pictures, leave the motions unreviewed
     python trajectories/make_motions.py --accept   the same after the pictures were looked at
The number of starts ends the search, not the time, so the seed fixes what is found: the same machine makes the same
bytes of every motion, however busy it is.
"""

import shutil
import sys
import tempfile
from pathlib import Path

from dynid.cli.main import run

HERE = Path(__file__).parent
ROBOTS = ("kuka_lwr4plus", "kinova_gen2")
SEARCH = "--duration 10 --segments 6 --cost i --restarts 6 --seconds 3000 --seed 1"
SHOWN = "--preview picture --no-input"


def main() -> int:
    """Plan all motions; the exit status is the first that is not 0."""
    for robot in ROBOTS:
        for alpha in ("1.0", "0.5", "0.2"):
            with tempfile.TemporaryDirectory() as folder:
                words = [
                    "trajectory",
                    robot,
                    "--alpha",
                    alpha,
                    *SEARCH.split(),
                    *SHOWN.split(),
                    "--out",
                    folder,
                    *sys.argv[1:],
                ]
                status = run(words)
                if status:
                    return status
                name = f"{robot}_alpha{alpha}"
                shutil.copy(Path(folder) / "trajectory.npz", HERE / f"{name}.npz")
                shutil.copy(Path(folder) / "preview.png", HERE / f"{name}.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
