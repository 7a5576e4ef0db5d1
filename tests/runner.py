"""Run dynid in its own process with an empty home, an empty folder and no DYNID_* variables."""

import os
import pty
import select
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[1]
TOY = Path(__file__).parent / "cli" / "toy.py"
#: A command that has not ended by then hangs [s].
LIMIT = 90


@dataclass
class Ended:
    status: int
    out: str
    err: str


class Runner:
    def __init__(self, folder, home):
        self.folder = folder
        self.home = home
        self.env = {
            "PATH": os.environ.get("PATH", ""),
            "PYTHONPATH": str(ROOT / "src"),
            "HOME": str(home),
            "TERM": "xterm-256color",
            "LANG": "C.UTF-8",
            "PYTHONDONTWRITEBYTECODE": "1",
        }

    def words(self, args):
        return [
            sys.executable,
            str(TOY) if args[:1] == ("toy",) else "-m",
            *(() if args[:1] == ("toy",) else ("dynid",)),
            *args,
        ]

    def __call__(self, *args, stdin=subprocess.DEVNULL, **env):
        """Run with stdin not a terminal; extra keywords are variables of the environment."""
        done = subprocess.run(
            self.words(args), cwd=self.folder, env={**self.env, **env}, stdin=stdin, capture_output=True, timeout=LIMIT
        )
        return Ended(done.returncode, done.stdout.decode(), done.stderr.decode())

    def start(self, *args, **options):
        return subprocess.Popen(self.words(args), cwd=self.folder, env=self.env, **options)

    def typing(self, *args, keys=(), out=subprocess.PIPE, **env):
        """Run on a pseudo-terminal; each key sequence is typed when the program waits for one."""
        master, slave = pty.openpty()
        process = subprocess.Popen(
            self.words(args), cwd=self.folder, env={**self.env, **env}, stdin=slave, stderr=slave, stdout=out,
            start_new_session=True,
        )  # fmt: skip
        os.close(slave)
        shown, keys, end = b"", list(keys), time.monotonic() + LIMIT
        while time.monotonic() < end:
            ready, _, _ = select.select([master], [], [], 0.05)
            if ready:
                try:
                    block = os.read(master, 65536)
                except OSError:
                    break
                if not block:
                    break
                shown += block
            elif keys and shown.rstrip(b" ").endswith((b"]", b":", b"again", b"rebuild")):
                os.write(master, keys.pop(0).encode())
            elif process.poll() is not None:
                break
        status = process.wait(timeout=5)
        os.close(master)
        answer = process.stdout.read().decode() if process.stdout else ""
        return Ended(status, answer, shown.decode())
