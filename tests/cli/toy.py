"""A command that uses every part of the frame, run in its own process by the tests: python toy.py toy JOB."""

import signal
import sys
import time
from pathlib import Path

import click

from dynid.answer import Answer
from dynid.cli.commands import COMMANDS, Entry
from dynid.cli.main import main
from dynid.cli.options import dynid_command
from dynid.cli.prompt import ask, confirm
from dynid.errors import Finding, NotFinite
from dynid.table import Table

NAME = "kinova_gen2"


def asks(session, word, given, **_):
    session.answer(ask(session, word, given=given, path="x.npz", effect="coulomb"))


def types_name(session, move, **_):
    confirm(session, NAME, move)
    session.answer("moved")


def values(session, samples, **_):
    session.answer(f"samples {samples} seed {session.seed} quiet {session.quiet} out {session.out}")
    return Answer({"samples": samples, "rms_nm": float("nan")})


def talks(session, word, **_):
    session.stage("stage", f"about {word}")
    session.stage("detail", "only with -v", shown=bool(session.verbose))
    finding = Finding("W316", "warning", f"{word} reads 1.8 Nm at rest")
    first = {"joint": word, "rms error": "0.42 Nm"}
    table = Table([first, {"joint": "joint_2", "rms error": "0.31 Nm"}])
    return Answer({"joint": word}, parts=[finding, table])


def prints_wide(session, **_):
    row = {"joint": "joint_1", **{f"quantity {i}": "1234.5678 Nm" for i in range(9)}}
    session.part(Table([row]))


def works(session, **_):
    progress = session.progress
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
    return Answer({}, limits=["rms = 2 > 1"])


def waits(session, **_):
    from dynid.disk import written_whole

    with written_whole(Path("half.npz")) as stream:
        stream.write(b"half")
        stream.flush()
        session.answer("ready")
        sys.stdout.flush()
        time.sleep(60)


JOBS = {
    "ask": asks,
    "typed": types_name,
    "values": values,
    "talk": talks,
    "wide": prints_wide,
    "work": works,
    "error": fails,
    "crash": crashes,
    "limit": misses_limit,
    "wait": waits,
}


@dynid_command("toy", repeatable=True)
@click.argument("job", type=click.Choice(list(JOBS)))
@click.argument("word", required=False)
@click.option("--given/--not-given", default=None, help="Answer of the question.")
@click.option("--samples", type=int, default=200, help="A number.")
@click.option("--move", allow_from_autoenv=False, help="The robot's name.")
def command(session, job, **words):
    """Do one of the jobs of the tests.

    Examples:
      dynid toy ask P1
    """
    return JOBS[job](session=session, **words) or Answer({})


def install():
    """Make ``toy`` a command of dynid."""
    sys.modules["dynid.cli.toy"] = sys.modules[__name__]
    COMMANDS["toy"] = Entry("toy", "", "a command of the tests")


if __name__ == "__main__":
    signal.alarm(60)
    install()
    main()
