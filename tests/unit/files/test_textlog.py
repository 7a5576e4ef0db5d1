"""The paper's text files and CSV are read with or without names, and refused with file and line."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

import dynid
from dynid.errors import LogLayout, LogNotFound, WrongUsage
from dynid.files.tables import read_folder

Q = np.arange(12.0).reshape(4, 3)


def folder(tmp_path, names=None, separator=" ", time=None, **extra):
    files = {"position": Q, "torque": 10 * Q, **extra}
    for key, values in files.items():
        head = separator.join(names) + "\n" if names else ""
        rows = "\n".join(separator.join(f"{x:.6f}" for x in row) for row in values)
        (tmp_path / f"{key}.txt").write_text(head + rows + "\n")
    if time is not None:
        (tmp_path / "time.txt").write_text("\n".join(str(t) for t in time))
    return tmp_path


@pytest.mark.parametrize("separator", [" ", "\t", ",", ", "])
def test_the_papers_folder_is_read_with_blanks_tabs_or_commas(tmp_path, separator):
    log = read_folder(
        folder(tmp_path, separator=separator, time=[0, 0.01, 0.02, 0.03], velocity=5 * Q)
    )
    assert_array_equal(log.q, Q)
    assert_array_equal(log.qd, 5 * Q)
    assert_array_equal(log.tau, 10 * Q)
    assert_array_equal(log.t, [0, 0.01, 0.02, 0.03])
    assert log.names == ()


def test_columns_follow_their_names_and_the_first_is_time_only_when_its_name_says_so(tmp_path):
    folder(tmp_path, names=("a", "b", "c"))
    rows = "\n".join(f"{30 * i + 2} {30 * i} {30 * i + 1}" for i in range(4))
    (tmp_path / "torque.txt").write_text(f"c a b\n{rows}")
    log = read_folder(tmp_path, rate=100)
    assert log.names == ("a", "b", "c")
    assert_array_equal(log.tau[:, [0, 2]].T, 30 * np.arange(4) + [[0], [2]])
    rows = "\n".join(f"{0.5 * i} 1 2 3" for i in range(4))
    (tmp_path / "position.txt").write_text(f"time a b c\n{rows}")
    log = read_folder(tmp_path)
    assert log.names == ("a", "b", "c")
    assert_array_equal(log.t, 0.5 * np.arange(4))


def test_without_time_the_rate_is_asked_for(tmp_path):
    with pytest.raises(WrongUsage, match="no time") as caught:
        read_folder(folder(tmp_path))
    assert "--rate" in caught.value.fix


def test_the_rate_gives_the_time(tmp_path):
    assert_allclose(read_folder(folder(tmp_path), rate=50).t, [0, 0.02, 0.04, 0.06])


@pytest.mark.parametrize("rate", [0.0, -5.0, float("nan")])
def test_a_rate_that_is_none_is_refused(tmp_path, rate):
    with pytest.raises(WrongUsage, match="--rate"):
        dynid.load_log(folder(tmp_path), "kuka_lwr4plus", rate=rate)


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
