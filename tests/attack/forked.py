"""Run dynid on an input in a child of its own with little memory and little time, and judge how it ended."""

from __future__ import annotations

import os
import re
import resource
import signal
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

#: What every command may take: memory beyond what Python and the libraries map, and time.
MEMORY, SECONDS = 1 << 30, 60
#: Statuses that the documentation knows, without 70 (internal error).
DOCUMENTED = {0, 1, 2, 3, 4, 5, 6, 7}
#: Markup that became alive in a page: a script or a handler that dynid does not write itself.
MARKUP = re.compile(r"<script[^>]*>\s*alert|<img[^>]+onerror|HACKED_MARKUP[^&<]*<b>", re.I)


#: Files of results that people look at on a terminal, and inputs among them; what would steer it, or turn the text around.
SHOWN = {".md", ".csv", ".tex", ".html", ".xml", ".urdf", ".sdf", ".log", ".svg", ".c", ".py", ".m"}
GIVEN = {"log.csv", "way.csv", "arm.urdf"}
STEERING = re.compile(rb"[\x00-\x08\x0e-\x1f\x7f]|\xe2\x80[\xaa-\xae]")


@dataclass
class Ended:
    words: list[str]
    status: int
    out: str
    err: str
    seconds: float


def load() -> None:
    """Import what the commands import, so that a fork need not: thousands of them then take minutes, not hours."""
    import importlib

    from dynid.cli.main import available, module_of

    for name in [
        *map(module_of, available()),
        "scipy.optimize",
        "scipy.signal",
        "scipy.stats",
        "scipy.sparse.linalg",
        "sympy",
        "matplotlib.backends.backend_agg",
        "matplotlib.figure",
        "jinja2",
        "pyarrow.parquet",
        "sqlite3",
        "rosbags.typesys",
        "yaml",
        "dynid.workflows.identify",
        "dynid.workflows.gap",
        "dynid.workflows.validate",
        "dynid.workflows.trajectory",
        "dynid.workflows.run",
        "dynid.workflows.export",
        "dynid.workflows.compare",
        "dynid.workflows.check",
    ]:
        importlib.import_module(name)


def mapped() -> int:
    """Return how much memory this process maps [bytes]."""
    return int(Path("/proc/self/statm").read_text().split()[0]) * os.sysconf("SC_PAGE_SIZE")


def run(
    words,
    folder: Path,
    seconds: float = SECONDS,
    prepare: Callable[[], object] = lambda: None,
    command=None,
) -> Ended:
    """Run ``dynid WORDS`` in a fork of this process, after ``prepare``; a hang ends as SIGALRM, a memory hog as MemoryError.

    ``command`` is run in its place, and reads its words from the environment.
    """
    out, err = folder.parent / f"{folder.name}.out", folder.parent / f"{folder.name}.err"
    begin = time.monotonic()
    sys.stdout.flush()
    sys.stderr.flush()
    child = os.fork()
    if not child:
        status = 99
        try:
            for number, path in ((1, out), (2, err)):
                handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_TRUNC)
                os.dup2(handle, number)
            os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
            os.chdir(folder)
            os.environ.update(HOME=str(folder.parent), TERM="xterm", LANG="C.UTF-8", NO_COLOR="1")
            sys.stdin, sys.stdout, sys.stderr = (
                os.fdopen(k, mode) for k, mode in ((0, "r"), (1, "w"), (2, "w"))
            )
            most = mapped() + MEMORY
            resource.setrlimit(resource.RLIMIT_AS, (most, most))
            resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
            signal.signal(signal.SIGALRM, signal.SIG_DFL)
            # Why of the processor: on a busy machine the clock says nothing; three times it bounds a wait.
            resource.setrlimit(resource.RLIMIT_CPU, (int(seconds), int(seconds) + 1))
            signal.alarm(3 * int(seconds))
            from dynid.cli import failure
            from dynid.cli.main import run as whole

            failure.prepare_streams()
            prepare()
            status = whole([str(word) for word in words]) if command is None else command()
            failure.silence_streams()
        finally:
            os._exit(status)
    _, how = os.waitpid(child, 0)
    status = os.waitstatus_to_exitcode(how)
    texts = [path.read_text(encoding="utf-8", errors="backslashreplace") for path in (out, err)]
    return Ended([str(word) for word in words], status, *texts, time.monotonic() - begin)


def contents(folder: Path) -> dict[str, bytes]:
    """Return the files of a folder but those of out/; of very long ones the length alone."""
    found = {}
    for path in folder.rglob("*"):
        name = str(path.relative_to(folder))
        # Why no links: what they lead to may be a device, or a file of the kernel whose end never comes.
        if path.is_file() and not path.is_symlink() and not name.startswith("out/"):
            size = path.stat().st_size
            found[name] = path.read_bytes() if size < 1 << 25 else str(size).encode()
    return found


def faults(ended: Ended, folder: Path, before: dict[str, bytes]) -> list[str]:
    """Return what is wrong with how a command ended; ``before`` are the files of the folder then."""
    found = []
    if ended.status not in DOCUMENTED:
        found.append(f"status {ended.status}")
    said = ended.out + ended.err
    if "Traceback" in said or "internal error" in said:
        found.append("traceback")
    if "error[E611]" in ended.err:
        found.append("beyond its memory")
    # Why not a list: escape sequences, and characters that reorder or hide text, are all that is not printable.
    if not said.replace("\n", "").isprintable():
        found.append("control characters on the terminal")
    if ended.status not in (0, 1) and not ended.err.strip():
        found.append("no message")
    if re.search(r'": (-?Infinity|NaN)\b', ended.out):
        found.append("infinity as a value")
    for path in sorted(folder.parent.rglob("*")):
        name = str(path.relative_to(folder.parent))
        if path.stem == "HACKED":  # a job called so has a folder whose name only holds it
            found.append(f"executed: {name}")
        if ".dynid-" in path.name or path.name.startswith("dynid-"):
            found.append(f"litter: {name}")
        if (
            path.suffix in SHOWN
            and path.name not in GIVEN
            and path.is_file()
            and STEERING.search(path.read_bytes())
        ):
            found.append(f"control characters in {name}")
        if (
            path.is_file()
            and path.suffix == ".html"
            and MARKUP.search(path.read_text(errors="replace"))
        ):
            found.append(f"live markup in {name}")
    now = contents(folder)
    found += [
        f"input changed: {name}" for name, content in before.items() if now.get(name) != content
    ]
    found += [f"outside the output folder: {name}" for name in set(now) - set(before)]
    return found
