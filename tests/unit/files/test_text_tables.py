"""Tables as other programs write them, and the paper's text files: read by name, refused with file and line."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.testing import assert_allclose, assert_array_equal

import dynid
from dynid.errors import LogLayout, LogNotFound, WrongUsage
from dynid.files.convert import write_log
from dynid.files.inspect import inspect
from dynid.files.logs import read_log
from dynid.files.robotfile import parse_robot
from dynid.files.tables import in_seconds, read_folder, read_table
from dynid.signals.columns import in_si, robot_columns

OTHERS = yaml.safe_load(Path(__file__).with_name("tables.yaml").read_text(encoding="utf-8"))
FILES, Q, TAU = OTHERS["files"], np.array(OTHERS["q"]), np.array(OTHERS["tau"])


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "log.csv"
    path.write_bytes(text.encode(encoding))
    return path


def robot_of(snippet, tmp_path, names=("shoulder", "elbow", "wrist")):
    joints = "".join(f"  - {{name: {name}}}\n" for name in names)
    text = f"name: x\nconvention: standard\njoints:\n{joints}{snippet}\n"
    return parse_robot(text, tmp_path / "x.yaml")


# ---------------------------------------------------------------- files of other programs
@pytest.mark.parametrize("name", FILES)
def test_a_table_is_read_with_what_is_printed_to_paste(name, tmp_path):
    path = written(tmp_path, FILES[name])
    robot = robot_of(inspect(path).snippet(), tmp_path)
    log = in_si(robot_columns(read_log(path, robot=robot), robot), robot)
    assert_allclose(log.t - log.t[0], OTHERS["t"], rtol=0, atol=1e-6)
    assert_allclose(log.q, Q, rtol=0, atol=1e-12)
    assert_allclose(log.tau, TAU, rtol=0, atol=1e-11)


def test_joints_are_taken_by_their_names_where_a_table_holds_them(tmp_path):
    """What rostopic writes is in the order of the messages, which is that of the alphabet for many drivers."""
    path = written(tmp_path, FILES["rostopic echo -p"])
    names, other = "[shoulder, elbow, wrist]", "[wrist, shoulder, elbow]"
    robot = robot_of(inspect(path).snippet().replace(names, other), tmp_path)
    assert_array_equal(robot_columns(read_log(path, robot=robot), robot).q, Q[:, [2, 0, 1]])


@pytest.mark.parametrize("word", ["1.234", "23:59:59", "two", "the arm was stopped here"])
def test_what_is_no_plain_number_beside_decimal_commas_is_named(word, tmp_path):
    """Points would group thousands: 1.234 must not be read as a number near one."""
    path = written(tmp_path, f"t;q_a;tau_a\n0,1;1,5;2,5\n0,2;{word};3,5\n0,3;1,5;2,5\n")
    with pytest.raises(LogLayout, match=rf"log\.csv:3: '{re.escape(word)}' is not a number"):
        read_log(path, robot=robot_of("", tmp_path, ("a",)))


def test_a_table_in_another_encoding_is_no_text(tmp_path):
    with pytest.raises(LogNotFound, match=r"log\.csv is not a text file"):
        inspect(written(tmp_path, "t,q_\u00e4,tau_\u00e4\n0,1,2\n", "cp1252"))


# ---------------------------------------------------------------- usual names
def test_a_csv_is_read_by_its_header_whatever_the_order(tmp_path):
    text = "tau_b,q_a,t,q_b,tau_a,qd_a,qd_b\n4,1,0.0,2,3,5,6\n40,,0.1,20,30,50,60\n"
    log = read_table(written(tmp_path, text), ())
    assert log.names == ("a", "b")
    assert_array_equal(log.q, [[1, 2], [np.nan, 20]])
    assert_array_equal(log.tau, [[3, 4], [30, 40]])
    assert_array_equal(log.qd, [[5, 6], [50, 60]])


def test_a_joint_without_torque_has_none_and_sensors_come_before_currents(tmp_path):
    path = written(tmp_path, "t,q_a,q_b,tau_a,i_a,i_b\n0,1,2,3,4,5\n")
    log = read_table(path, ())
    assert_array_equal(log.tau, [[4, 5]])
    assert (log.tau_unit, log.qd) == ("A", None)
    assert_array_equal(read_table(path, (), sensors=True).tau, [[3, np.nan]])
    path = written(tmp_path, "t [s],q_a [deg],q_b(deg),tau_a [mNm]\n0,1,2,3\n")
    log = read_table(path, ("a", "b"))
    assert_array_equal(log.tau, [[3, np.nan]])
    assert log.units == {"position": "deg", "effort": "mNm"}
    assert read_table(write_log(log, path), ()).units == log.units


def test_an_unknown_header_is_answered_with_the_columns_to_paste(tmp_path):
    head = "timestamp;actual_q_0;actual_q_1;actual_current_0;actual_current_1"
    with pytest.raises(LogLayout) as caught:
        read_table(written(tmp_path, f"{head}\n0;1;2;3;4\n"), ("a", "b"))
    paste = 'columns: {time: "timestamp", position: "actual_q_{i}", effort: "actual_current_{i}"}'
    assert paste in caught.value.fix
    assert inspect(tmp_path / "log.csv").logs[0].tau_unit == "A"


@pytest.mark.parametrize(("unit", "factor"), [("s", 1.0), ("ms", 1e3), ("us", 1e6), ("ns", 1e9)])
@pytest.mark.parametrize(("start", "count"), [(0.0, 100), (1.7e9, 100), (1.7e9, 1_000_000)])
def test_stamps_tell_their_unit(unit, factor, start, count):
    seconds, said = in_seconds((start + np.arange(count) * 0.008) * factor, "t", "log.csv")
    assert_allclose(np.diff(seconds), 0.008, atol=1e-6)
    evidence = {"unit": unit, "seconds": pytest.approx(0.008 * (count - 1))}
    assert [each.evidence for each in said] == [evidence] * (unit != "s")


# ---------------------------------------------------------------- the paper's folder
ROWS = np.arange(12.0).reshape(4, 3)


def folder(tmp_path, separator=" ", time=None, **extra):
    for key, values in {"position": ROWS, "torque": 10 * ROWS, **extra}.items():
        rows = (separator.join(f"{x:.6f}" for x in row) for row in values)
        (tmp_path / f"{key}.txt").write_text("\n".join(rows) + "\n")
    if time is not None:
        (tmp_path / "time.txt").write_text("\n".join(map(str, time)))
    return tmp_path


@pytest.mark.parametrize("separator", [" ", "\t", ",", ", "])
def test_the_papers_folder_is_read_with_blanks_tabs_or_commas(tmp_path, separator):
    log = read_folder(folder(tmp_path, separator, [0, 0.01, 0.02, 0.03], velocity=5 * ROWS))
    assert_array_equal([log.q, log.qd, log.tau], [ROWS, 5 * ROWS, 10 * ROWS])
    assert_array_equal(log.t, [0, 0.01, 0.02, 0.03])
    assert log.names == ()


def test_columns_follow_their_names_and_the_first_is_time_only_when_its_name_says_so(tmp_path):
    rows = "\n".join(f"{30 * i + 2} {30 * i} {30 * i + 1}" for i in range(4))
    (tmp_path / "torque.txt").write_text(f"c a b\n{rows}")
    for head, start, rate in (("a b c", "", 100), ("time a b c", "{} ", None)):
        rows = "\n".join(start.format(0.5 * i) + "1 2 3" for i in range(4))
        (tmp_path / "position.txt").write_text(f"{head}\n{rows}")
        log = read_folder(tmp_path, rate)
        assert log.names == ("a", "b", "c")
        assert_array_equal(log.tau[:, [0, 2]].T, 30 * np.arange(4) + [[0], [2]])
        assert_array_equal(log.t, np.arange(4) * (0.5 if rate is None else 0.01))


def test_without_time_the_rate_is_asked_for_and_gives_it(tmp_path):
    with pytest.raises(WrongUsage, match="no time") as caught:
        read_folder(folder(tmp_path))
    assert "--rate" in caught.value.fix
    assert_allclose(read_folder(tmp_path, rate=50).t, [0, 0.02, 0.04, 0.06])
    for rate in (0.0, -5.0, float("nan")):
        with pytest.raises(WrongUsage, match="--rate"):
            dynid.load_log(tmp_path, "kuka_lwr4plus", rate=rate)


def test_a_folder_without_torque_is_no_log(tmp_path):
    (folder(tmp_path) / "torque.txt").unlink()
    with pytest.raises(LogNotFound, match=r"torque\.txt"):
        read_folder(tmp_path, rate=10)


@pytest.mark.parametrize(
    ("rows", "said"),
    [
        ("1 2 3\n1 two 3\n1 2 3\n1 2 3\n", r"torque\.txt:2: 'two'"),
        ("1 2 3\n1 2 3\n1 2\n1 2 3\n", r"torque\.txt:3: 2 numbers, expected 3"),
        ("1 2 3\n", "1 rows, expected 4"),
    ],
)
def test_rows_that_do_not_fit_are_named_with_their_line(tmp_path, rows, said):
    (folder(tmp_path) / "torque.txt").write_text(rows)
    with pytest.raises(LogLayout, match=said):
        read_folder(tmp_path, rate=10)
