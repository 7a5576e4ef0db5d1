"""Tables as other programs write them: read with what ``dynid check`` says to paste, and with the same numbers."""

import codecs
import re

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from dynid.errors import LogLayout, LogNotFound
from dynid.files.inspect import inspect
from dynid.files.logs import read_log
from dynid.files.robotfile import parse_robot
from dynid.signals.columns import in_si, robot_columns

N, JOINTS = 60, 3
RNG = np.random.default_rng(5)
T = np.arange(N) * 0.008
Q, QD, TAU = (np.round(RNG.uniform(-scale, scale, (N, JOINTS)), 6) for scale in (2.0, 1.0, 40.0))
NAMES = ("shoulder", "elbow", "wrist")


def table(header, *columns, start=0, delimiter=",", form=repr, head="", end="\n"):
    """Return a table; a name with ``{}`` stands for all joints, a column is (N,) or (N, k), of numbers or words."""
    names = []
    for name in header.split("|"):
        names += [name.format(k) for k in range(start, start + JOINTS)] if "{}" in name else [name]
    rows = [[] for _ in range(N)]
    for column in columns:
        for row, value in zip(rows, column, strict=True):
            values = np.ravel(value).tolist()
            row.extend(each if isinstance(each, str) else form(each) for each in values)
    lines = [delimiter.join(names), *(delimiter.join(row) for row in rows)]
    return head + "".join(line + end for line in lines)


EXCEL = codecs.BOM_UTF8.decode() + table(
    "Zeit [s]|Position {} [rad]|Drehmoment {} [Nm]",
    T,
    Q,
    TAU,
    start=1,
    delimiter=";",
    form=lambda x: f"{x:.6f}".replace(".", ","),
    end="\r\n",
)
PLOTJUGGLER = table(
    "|".join(
        ["__time"]
        + [
            f"/joint_states/{name}/{kind}"
            for kind in ("position", "velocity", "effort")
            for name in NAMES
        ]
        + ["/battery/voltage"]
    ),
    T,
    Q,
    QD,
    TAU,
    [""] * N,
)
FILES = {
    "European Excel, empty rows at its end": EXCEL + ";;;;;;\r\n" * 3,
    "units in a second line": table(
        "time|pos_{}|trq_{}", T, np.rad2deg(Q), TAU, head="Recorded by A. Person;2024-05-01\n"
    ).replace("trq_2\n", "trq_2\n[s],[deg],[deg],[deg],[Nm],[Nm],[Nm]\n"),
    "quoted names": table(
        '"Time, s"|'
        + "|".join(f'"{name}, {kind}"' for kind in ("position", "torque") for name in NAMES),
        T,
        Q,
        TAU,
    ),
    "rostopic echo -p": table(
        "%time|field.header.seq|field.header.stamp|field.header.frame_id|field.name{}|field.position{}|"
        "field.velocity{}|field.effort{}",
        np.round(T * 1e9 + 1.7e18),
        np.arange(N),
        np.round(T * 1e9 + 1.7e18),
        ["base"] * N,
        *([name] * N for name in NAMES),
        Q,
        QD,
        TAU,
        form=lambda x: f"{x:.0f}" if x == round(x) else repr(x),
    ),
    "PlotJuggler": "".join(
        # A row for each message of any topic; cells of the others are empty.
        line + ("\n" + ",".join([f"{T[k - 1] + 0.004}"] + [""] * 9 + ["7"]) if k else "") + "\n"
        for k, line in enumerate(PLOTJUGGLER.splitlines())
    ),
    "ur_rtde": table(
        "timestamp|target_q_{}|target_qd_{}|actual_q_{}|actual_qd_{}|actual_TCP_speed_{}|target_moment_{}|"
        "actual_torque_{}",
        T + 421.5,
        -Q,
        -QD,
        Q,
        QD,
        Q,
        -TAU,
        TAU,
        delimiter=" ",
    ),
    "libfranka": table(
        "duration| success rate| q[{}]| q_d[{}]|dq[{}]|dq_d[{}]|tau_J[{}]|tau_ext_hat_filtered[{}]|sent commands|"
        "q_d[{}]|" + "".join(f"O_T_EE_d[{k}]|" for k in range(16)) + "tau_J_d[{}]",
        T * 1e3,
        np.ones(N),
        Q,
        -Q,
        QD,
        -QD,
        TAU,
        0 * TAU,
        [""] * N,
        -Q,
        np.zeros((N, 16)),
        -TAU,
    ),
    "names in German letters": table(
        "t|" + "|".join(f"Gelenk_{x}.{kind}" for kind in ("position", "moment") for x in "äöü"),
        T,
        Q,
        TAU,
    ),
}


def robot_of(snippet, tmp_path, names=NAMES):
    joints = "".join(f"  - {{name: {name}}}\n" for name in names)
    return parse_robot(
        f"name: x\nconvention: standard\njoints:\n{joints}{snippet}\n", tmp_path / "x.yaml"
    )


def pasted(path, tmp_path):
    """Return what is read with the part of a robot file that was printed, in SI units."""
    found = inspect(path)
    assert found.snippet(), found.columns
    robot = robot_of(found.snippet(), tmp_path)
    return in_si(robot_columns(read_log(path, robot=robot), robot), robot)


@pytest.mark.parametrize("name", FILES)
def test_a_table_is_read_with_what_is_printed_to_paste(name, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(FILES[name].encode())
    log = pasted(path, tmp_path)
    assert len(log) == N
    assert_allclose(log.t - log.t[0], T, rtol=0, atol=1e-6)
    assert_allclose(log.q, Q, rtol=0, atol=1e-12)
    assert_allclose(log.tau, TAU, rtol=0, atol=1e-11)


def test_joints_are_taken_by_their_names_where_a_table_holds_them(tmp_path):
    """What rostopic writes is in the order of the messages, which is that of the alphabet for many drivers."""
    path = tmp_path / "log.csv"
    path.write_text(FILES["rostopic echo -p"])
    robot = robot_of(
        inspect(path).snippet().replace("[shoulder, elbow, wrist]", "[wrist, shoulder, elbow]"),
        tmp_path,
    )
    assert_array_equal(robot_columns(read_log(path, robot=robot), robot).q, Q[:, [2, 0, 1]])


def test_a_row_of_words_among_the_numbers_is_named(tmp_path):
    path = tmp_path / "log.csv"
    lines = table("t|q_{}|tau_{}", T, Q, TAU).splitlines()
    path.write_text("\n".join([*lines[:30], "the arm was stopped here", *lines[30:]]))
    with pytest.raises(LogLayout, match=r"log\.csv:31"):
        read_log(path, robot=robot_of("", tmp_path, ("0", "1", "2")))


@pytest.mark.parametrize("word", ["1.234", "23:59:59", "two"])
def test_what_is_no_plain_number_beside_decimal_commas_is_named(word, tmp_path):
    """Points would group thousands: 1.234 must not be read as a number near one."""
    path = tmp_path / "log.csv"
    path.write_text(f"t;q_a;tau_a\n0,1;1,5;2,5\n0,2;{word};3,5\n0,3;1,5;2,5\n")
    with pytest.raises(LogLayout, match=rf"log\.csv:3: '{re.escape(word)}' is not a number"):
        read_log(path, robot=robot_of("", tmp_path, ("a",)))


def test_a_table_in_another_encoding_is_no_text(tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes("t,q_\u00e4,tau_\u00e4\n0,1,2\n".encode("cp1252"))
    with pytest.raises(LogNotFound, match=r"log\.csv is not a text file"):
        inspect(path)
