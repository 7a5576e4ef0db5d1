"""A command that uses every part of the frame, run in its own process by the tests: python toy.py toy JOB."""

import importlib.machinery
import signal
import sys
import time
import types
from pathlib import Path

import click

from dynid.cli import main as frame
from dynid.cli.options import Common, dynid_command
from dynid.cli.prompt import ask, confirm, input_hashes, may_write
from dynid.cli.runfile import write_run
from dynid.errors import ExitStatus, Finding, NotFinite

NAME = "kinova_gen2"


def asks(common, word, given, **_):
    common.terminal.answer(ask(common, word, given=given, path="x.npz", effect="coulomb").value)


def types_name(common, move, **_):
    confirm(common, NAME, "type the robot's name to start", given=move)
    common.terminal.answer("moved")


def writes(common, word, samples, **_):
    from dynid.npz import write_artifact  # NumPy comes with it, and most jobs do without

    path, inputs = (
        common.folder("arm") / "result.npz",
        input_hashes({"log": Path(word)}, {"samples": samples}),
    )
    if may_write(common, path, inputs):
        write_artifact(path, "dynid/toy/1", {"inputs": inputs}, {})
        common.terminal.wrote(path)
        write_run(path.parent, inputs)


def values(common, samples, **_):
    common.terminal.answer(
        f"samples {samples} seed {common.seed} quiet {common.quiet} out {common.out}"
    )
    common.terminal.emit_json({"schema": "dynid/toy/1", "samples": samples, "rms_nm": float("nan")})


def talks(common, word, **_):
    terminal = common.terminal
    terminal.stage("stage", f"about {word}")
    terminal.detail("detail", "only with -v")
    terminal.finding(Finding("W316", "warning", f"{word} reads 1.8 Nm at rest"))
    terminal.table(("joint", "rms error"), ((word, "0.42 Nm"), ("joint_2", ("0.31 Nm", "red"))))
    terminal.emit_json({"schema": "dynid/toy/1", "joint": word})


def prints_wide(common, **_):
    common.terminal.table(
        ("joint", *(f"quantity {i}" for i in range(9))), [("joint_1", *("1234.5678 Nm",) * 9)]
    )


def works(common, **_):
    with common.terminal.progress() as progress:
        progress.stage("quick")
        progress.advance(1, 2, "soon")
        progress.stage("slow")
        for i in range(8):
            time.sleep(0.1)
            progress.advance(i, 8, "link 1")
        progress.stage("slow", "done")


def fails(**_):
    raise NotFinite("joint_4 torque is not a number\nin 12 samples", where="log.bag:322")


def crashes(**_):
    raise ZeroDivisionError("something unforeseen")


def misses_limit(**_):
    return ExitStatus.LIMIT_NOT_MET


def waits(common, **_):
    from dynid.disk import written_whole

    with written_whole(Path("half.npz")) as stream:
        stream.write(b"half")
        stream.flush()
        common.terminal.answer("ready")
        sys.stdout.flush()
        time.sleep(60)


JOBS = {
    "ask": asks,
    "typed": types_name,
    "write": writes,
    "values": values,
    "talk": talks,
    "wide": prints_wide,
    "work": works,
    "error": fails,
    "crash": crashes,
    "limit": misses_limit,
    "wait": waits,
}


@dynid_command("toy", examples=("dynid toy ask P1",), repeatable=True)
@click.argument("job", type=click.Choice(list(JOBS)))
@click.argument("word", required=False)
@click.option("--given/--not-given", default=None, help="Answer of the question.")
@click.option("--samples", type=int, default=200, help="A number.")
@click.option("--move", allow_from_autoenv=False, help="The robot's name.")
def command(common: Common, job, **words):
    """Do one of the jobs of the tests."""
    return JOBS[job](common=common, **words)


def install():
    """Make ``toy`` a command of dynid."""
    module = types.ModuleType("dynid.cli.toy")
    module.command = command
    module.__spec__ = importlib.machinery.ModuleSpec("dynid.cli.toy", None)
    sys.modules["dynid.cli.toy"] = module
    frame.COMMANDS["toy"] = frame.Entry("", "a command of the tests")


if __name__ == "__main__":
    signal.alarm(60)
    install()
    frame.main()
