"""Write contract.json anew from the code as it is: only where the contract itself was changed on purpose.

python tests/contract/freeze.py
"""

import json
import sys
import tempfile
from pathlib import Path


def main():
    sys.path.insert(0, str(Path(__file__).parents[1]))
    from frozen import TABLE, chapter, errors, options
    from situations import CHAPTERS

    from runner import Runner

    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "help").mkdir()
        dynid = Runner(folder / "help", folder / "help")
        table = {
            "options": options(dynid),
            "errors": errors(dynid),
            "situations": {each: chapter(each, folder / str(i)) for i, each in enumerate(CHAPTERS)},
        }
    TABLE.write_text(json.dumps(table, indent=1) + "\n")


if __name__ == "__main__":
    main()
