"""Run the command line with ``python -m dynid``."""

from dynid.cli.main import main

if __name__ == "__main__":
    main()
