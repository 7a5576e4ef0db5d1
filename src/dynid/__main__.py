"""The program ``dynid``, also ``python -m dynid``."""

import gc
import os
import signal


def _stop(number: int, frame: object) -> None:
    """End at once: nothing was opened or written yet."""
    try:
        os.write(2, b"interrupted\n")
    finally:
        os._exit(130)


def _stoppable() -> None:
    """Let Ctrl-C and SIGTERM end the program as quietly during its own start-up as later."""
    for number in (signal.SIGINT, signal.SIGTERM):
        # Why: a shell that starts a program in the background, or nohup, wants it to ignore them.
        if signal.getsignal(number) is not signal.SIG_IGN:
            signal.signal(number, _stop)


#: Objects made until Python looks for cycles among them; from its usual 700, that takes a tenth of a short command.
OBJECTS = 20_000


_stoppable()


def main() -> None:
    """Run the command line."""
    gc.set_threshold(OBJECTS)
    from dynid.cli.main import main as run

    run()


if __name__ == "__main__":
    main()
