"""Run dynid in its own process with an empty home, an empty folder and no DYNID_* variables."""

import os
import pty
import select
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path

from forkserver import ROOT, TOY, Command, server

#: A command that has not ended by then hangs [s].
LIMIT = 300


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
        """Run with stdin not a terminal, in a fork; extra keywords are variables of the environment."""
        with (
            tempfile.TemporaryFile() as out,
            tempfile.TemporaryFile() as err,
            Path(os.devnull).open() as nothing,
        ):
            given = nothing if stdin is subprocess.DEVNULL else stdin
            streams = [
                each if isinstance(each, int) else each.fileno() for each in (given, out, err)
            ]
            status = Command(server(), args, self.folder, {**self.env, **env}, streams).wait(LIMIT)
            out.seek(0)
            err.seek(0)
            return Ended(status, out.read().decode(), err.read().decode())

    def fresh(self, *args, stdin=subprocess.DEVNULL, **env):
        """Run the same in a new interpreter, where its start matters."""
        done = subprocess.run(
            self.words(args),
            cwd=self.folder,
            env={**self.env, **env},
            stdin=stdin,
            capture_output=True,
            timeout=LIMIT,
        )
        return Ended(done.returncode, done.stdout.decode(), done.stderr.decode())

    def start(self, *args, **options):
        return subprocess.Popen(self.words(args), cwd=self.folder, env=self.env, **options)

    def typing(self, *args, keys=(), **env):
        """Run on a pseudo-terminal, in a fork; each key sequence is typed when the program waits for one."""
        master, slave = pty.openpty()
        out = tempfile.TemporaryFile()  # noqa: SIM115
        process = Command(
            server(), args, self.folder, {**self.env, **env}, [slave, out.fileno(), slave]
        )
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
            elif process.ended():
                break
        status = process.wait(5)
        os.close(master)
        with out:
            out.seek(0)
            return Ended(status, out.read().decode(), shown.decode())
