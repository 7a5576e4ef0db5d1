"""What studies share: arms, models and motions of the tests, options, answers kept on disk, and tables."""

import argparse
import json
import platform
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
#: Recordings of real arms, beside the project.
DATA = ROOT.parent / "shared" / "data"
MACHINE = f"{platform.machine()}, Python {platform.python_version()}"

sys.path.insert(0, str(ROOT / "tests"))


def arguments(doc, **defaults):
    """Return the options of a study by name, each of the type of its default; False is one without a value."""
    form = argparse.RawDescriptionHelpFormatter
    parser = argparse.ArgumentParser(description=doc, formatter_class=form)
    for name, value in defaults.items():
        kind = {"action": "store_true"} if value is False else {"type": type(value)}
        parser.add_argument(f"--{name}", default=value, **kind)
    return parser.parse_args()


class Answers(dict):
    """Answers by name in a JSON file, so that a study that was interrupted goes on where it was."""

    def __init__(self, path, *, fresh=False):
        super().__init__(json.loads(path.read_text()) if path.is_file() and not fresh else {})
        self.path = path

    def keep(self, name, answer):
        """Keep an answer at once, beside those that another run may have found meanwhile."""
        kept = Answers(self.path) if self else {}
        self.update({**kept, name: answer})
        self.path.parent.mkdir(parents=True, exist_ok=True)
        self.path.write_text(json.dumps(self, indent=1) + "\n")


def markdown(head, rows):
    """Return a table in Markdown: its columns as one text, and its rows of cells."""
    columns = head.split(" | ")
    lines = [columns, ["---"] * len(columns), *rows]
    return "\n".join(f"| {' | '.join(map(str, line))} |" for line in lines)
