"""The program ``dynid``, also ``python -m dynid``."""

import gc
import sys

#: Objects made until Python looks for cycles among them; from its usual 700, that takes a tenth of a short command.
OBJECTS = 20_000


def main() -> None:
    """Run the command line; Ctrl-C ends it as quietly during its own start-up as later."""
    gc.set_threshold(OBJECTS)
    try:
        from dynid.cli.main import main as run

        run()
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)


if __name__ == "__main__":
    main()
