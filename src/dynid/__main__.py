"""The program ``dynid``, also ``python -m dynid``."""

import sys


def main() -> None:
    """Run the command line; Ctrl-C during its own start-up ends it as quietly as later."""
    try:
        from dynid.cli.main import main as run
    except KeyboardInterrupt:
        sys.stderr.write("interrupted\n")
        sys.exit(130)
    run()


if __name__ == "__main__":
    main()
