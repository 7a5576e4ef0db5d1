"""The program ``dynid``, also ``python -m dynid``."""

import os
import sys


def main() -> None:
    """Run the command line; Ctrl-C during its own start-up ends it as quietly as later."""
    try:
        from dynid.cli.main import main as run
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.stderr.flush()
        os._exit(130)  # Why: see failure.leave
    run()


if __name__ == "__main__":
    main()
