"""Broken files of every kind: what reads them answers in whole, or raises a mistake and writes nothing."""

import re
import shutil
import warnings

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

import dynid
import twolink
from dynid.cli.main import run
from dynid.errors import DynidError, ExitStatus
from recordings import of_ros2, write_bag, write_mcap

pytestmark = pytest.mark.slow

SEARCH = settings(
    max_examples=140,
    deadline=None,
    derandomize=True,
    database=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture, HealthCheck.too_slow],
)
#: What stands where a number or a name belongs.
ODD = (
    "",
    "nan",
    ".inf",
    "-1",
    "0",
    "1e400",
    "1e-320",
    "9" * 400,
    "true",
    "null",
    "~",
    "'",
    '"',
    ":",
    "[]",
    "{}",
    "[[[[[",
    "&a *a",
    "*a",
    "!!python/object/apply:os.system [false]",
    "<<: *a",
    "|",
    "\x00",
    "\x1b[2J",
    "\ufeff",
    "\u202e",
    "é" * 50,
    "../../etc/passwd",
    "1,5",
    "0x10",
    "012",
    "2-3",
)


@pytest.fixture(scope="module")
def valid(tmp_path_factory):
    """A folder with one good file of each kind, and the arm that they belong to."""
    folder = tmp_path_factory.mktemp("valid")
    twolink.write_arm(folder)
    robot = dynid.load_robot(folder / "arm.yaml")
    log = dynid.load_log(folder / "log.csv", robot)
    log.save(folder / "log.npz")
    short = dynid.Log(log.t[:200], log.q[:200], log.tau[:200], log.names)
    write_bag(folder / "log.bag", short, "/joint_states")
    write_mcap(folder / "log.mcap", of_ros2(short, "/joint_states"))
    dynid.identify(robot, [log]).save(folder / "parameters.npz")
    return folder


@st.composite
def broken_text(draw, text):
    """Return a text with one to three lines or values changed."""
    lines = text.splitlines()
    for _ in range(draw(st.integers(1, 3))):
        k, odd = draw(st.integers(0, len(lines) - 1)), draw(st.sampled_from(ODD))
        words = re.split("([ ,:])", lines[k])
        words[draw(st.integers(0, len(words) - 1))] = odd
        new = ["".join(words)], [], [lines[k]] * 2, [f" {lines[k]}"], [odd]
        lines[k : k + 1] = draw(st.sampled_from(new))
        lines = lines or [""]
    return "\n".join(lines)


@st.composite
def broken_bytes(draw, data):
    """Return bytes of which one to four places are changed, lost, doubled, or of which only the begin is left."""
    data = bytearray(data)
    for _ in range(draw(st.integers(1, 4))):
        # The begin and the end hold headers and indices.
        near = st.integers(0, min(400, len(data)))
        at = draw(st.one_of(st.integers(0, len(data)), near, near.map(lambda k: len(data) - k)))
        few, random = draw(st.integers(1, 64)), draw(st.binary(max_size=16))
        new = b"", bytes(few), b"\xff" * few, data[at : at + few] * 2, random
        data[at : at + few] = draw(st.sampled_from(new))
    if draw(st.integers(0, 3)) == 0:
        del data[draw(st.integers(0, len(data))) :]
    return bytes(data)


def answer(read, path):
    """Return what a reader returns, None where it raises a mistake that says what is wrong."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            return read(path)
        except DynidError as error:
            mistake = error
    assert mistake.code
    assert str(mistake).strip()
    return None


def whole_log(log):
    n, joints = log.q.shape
    assert len(log.t) == n == len(log.tau)
    assert log.tau.shape[1] == joints == len(log.names)
    assert log.qd is None or log.qd.shape == log.q.shape


def finite_robot(robot):
    table = np.array([(j.a, j.d, j.twist, j.theta_offset) for j in robot.joints])
    assert table.shape == (robot.n, 4)
    assert np.all(np.isfinite(table))
    assert np.all(np.isfinite(robot.gravity))


def whole_result(result):
    assert len(result.theta) == len(result.names) == len(result.covariance)
    assert len(result.to_dataframe() if hasattr(result, "to_dataframe") else result.table())


#: Files by what reads them, what a broken one that is read has to be, and how many lines are changed as text.
FILES = {
    "arm.yaml": (dynid.load_robot, finite_robot, 999),
    "log.csv": (None, whole_log, 60),
    "log.npz": (None, whole_log, 0),
    "log.bag": (None, whole_log, 0),
    "log.mcap": (None, whole_log, 0),
    "parameters.npz": (dynid.load, whole_result, 0),
}


@pytest.mark.parametrize("name", FILES)
@SEARCH
@given(data=st.data())
def test_what_reads_a_file_answers_in_whole_or_says_what_is_wrong(valid, tmp_path, name, data):
    robot, path = dynid.load_robot(valid / "arm.yaml"), tmp_path / name
    read, check, lines = FILES[name]
    if lines and data.draw(st.integers(0, 3)):
        text = "\n".join((valid / name).read_text().splitlines()[:lines])
        text = data.draw(broken_text(text))
        path.write_text(text, encoding="utf-8", errors="surrogatepass")
    else:
        path.write_bytes(data.draw(broken_bytes((valid / name).read_bytes())))
    found = answer(read or (lambda path: dynid.load_log(path, robot)), path)
    if found is not None:
        check(found)


@pytest.mark.parametrize(
    ("broken", "line"),
    [
        ("log.bag", "check log.bag --robot arm.yaml"),
        ("log.csv", "identify arm.yaml log.csv --no-report --out out"),
        ("log.npz", "identify arm.yaml log.npz --no-report --out out"),
        ("parameters.npz", "validate parameters.npz unseen.csv --no-plot"),
        ("parameters.npz", "export parameters.npz --format c --out out"),
    ],
)
@settings(SEARCH, max_examples=6)
@given(data=st.data())
def test_commands(valid, tmp_path, monkeypatch, capsys, broken, line, data):
    """A status that is documented, no traceback, and a folder of results that is whole or not there."""
    monkeypatch.chdir(tmp_path)
    shutil.rmtree(tmp_path / "out", ignore_errors=True)
    for path in valid.iterdir():
        shutil.copy(path, tmp_path)
    (tmp_path / broken).write_bytes(data.draw(broken_bytes((valid / broken).read_bytes())))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        status = run(line.split())
    told = capsys.readouterr()
    assert "Traceback" not in told.out + told.err
    assert ExitStatus(status) is not ExitStatus.INTERNAL
    written = sorted((tmp_path / "out").glob("*")) if (tmp_path / "out").exists() else []
    if status:
        assert "error[" in told.err
        assert written == []
    elif line.startswith("identify"):
        assert answer(dynid.load, tmp_path / "out" / "parameters.npz") is not None
