"""Tables as other programs write them: read with what ``dynid check`` says to paste, and with the same numbers."""

import codecs
from datetime import datetime, timedelta, timezone

import numpy as np
import pytest

from dynid.errors import LogLayout
from dynid.files.logs import inspect_log, read_log
from dynid.files.robotfile import parse_robot
from dynid.signals.columns import in_si, robot_columns

N, JOINTS = 60, 3
RNG = np.random.default_rng(5)
T = np.arange(N) * 0.008
Q, QD, TAU = (np.round(RNG.uniform(-scale, scale, (N, JOINTS)), 6) for scale in (2.0, 1.0, 40.0))
NAMES = ("shoulder", "elbow", "wrist")
START = datetime(2024, 2, 29, 23, 59, 59, 900000, tzinfo=timezone.utc)


def table(header, *columns, delimiter=",", form=repr, head="", end="\n"):
    """Return a table; each column is (N,) or (N, k), of numbers or of words."""
    rows = [[] for _ in range(N)]
    for column in columns:
        for row, value in zip(rows, column, strict=True):
            values = np.ravel(value).tolist()
            row.extend(each if isinstance(each, str) else form(each) for each in values)
    lines = [delimiter.join(header), *(delimiter.join(row) for row in rows)]
    return head + "".join(line + end for line in lines)


def german(value):
    """Return a number as a spreadsheet shows it in Germany, with points between thousands."""
    return f"{value:,.6f}".translate(str.maketrans(",.", ".,"))


def each(form, start=0):
    return [form.format(k) for k in range(start, start + JOINTS)]


def dated(form, utc=True):
    stamps = (START + timedelta(seconds=t) for t in T)
    return [
        stamp.strftime(form)[:-3] if form.endswith("%f") else stamp.strftime(form)
        for stamp in stamps
    ]


EXCEL = codecs.BOM_UTF8.decode() + table(
    ["Zeit [s]", *each("Position {} [rad]", 1), *each("Drehmoment {} [Nm]", 1)],
    T,
    Q,
    TAU,
    delimiter=";",
    form=lambda x: f"{x:.6f}".replace(".", ","),
    end="\r\n",
)
HEADER = ["Time", *each("J{} angle", 1), *each("J{} torque", 1)]
FILES = {
    "European Excel": EXCEL.encode(),
    "European Excel, empty rows at its end": (EXCEL + ";;;;;;\r\n" * 3).encode(),
    "Excel, Unicode text": table(HEADER, T, Q, TAU, delimiter="\t").encode("utf-16"),
    "Windows 1252": table(
        ["t", *each("Winkel {} [\u00b0]"), *each("Moment {} [Nm]")], T, np.rad2deg(Q), TAU
    ).encode("cp1252"),
    "tabs": table(HEADER, T, Q, TAU, delimiter="\t").encode(),
    "bars": table(HEADER, T, Q, TAU, delimiter=" | ").encode(),
    "thousands, decimal commas": table(
        ["t [ms]", *each("q{} [rad]"), *each("tau{} [mNm]")],
        T * 1e3,
        Q,
        TAU * 1e3,
        delimiter=";",
        form=german,
    ).encode(),
    "thousands, quoted": table(
        ["t_ms", *each("q{}"), *each("tau{} [mNm]")],
        T * 1e3,
        Q,
        TAU * 1e3,
        form=lambda x: f'"{x:,.6f}"',
    ).encode(),
    "thousands, apostrophes": table(
        ["t_ms", *each("q{}"), *each("tau{} (mNm)")],
        T * 1e3,
        Q,
        TAU * 1e3,
        delimiter=";",
        form=lambda x: f"{x:,.6f}".replace(",", "'"),
    ).encode(),
    "units in a second line": table(
        ["time", *each("pos_{}"), *each("trq_{}")],
        T,
        np.rad2deg(Q),
        TAU,
        head="Recorded by A. Person;2024-05-01\n",
    )
    .replace("trq_2\n", "trq_2\n[s],[deg],[deg],[deg],[Nm],[Nm],[Nm]\n")
    .encode(),
    "groups in a first line": (
        "Time,Position,,,Torque,,\n,1,2,3,1,2,3\n" + table(["x"], T, Q, TAU).partition("\n")[2]
    ).encode(),
    "quoted names": table(
        [
            '"Time, s"',
            *(f'"{name}, position"' for name in NAMES),
            *(f'"{name}, torque"' for name in NAMES),
        ],
        T,
        Q,
        TAU,
    ).encode(),
    "rostopic echo -p": table(
        [
            "%time",
            "field.header.seq",
            "field.header.stamp",
            "field.header.frame_id",
            *each("field.name{}"),
            *each("field.position{}"),
            *each("field.velocity{}"),
            *each("field.effort{}"),
        ],
        np.round(T * 1e9 + 1.7e18),
        np.arange(N),
        np.round(T * 1e9 + 1.7e18),
        ["base"] * N,
        *([name] * N for name in NAMES),
        Q,
        QD,
        TAU,
        form=lambda x: f"{x:.0f}" if x == round(x) else repr(x),
    ).encode(),
    "bagpy": table(
        [
            "Time",
            "header.seq",
            "header.stamp.secs",
            "header.stamp.nsecs",
            *each("name_{}"),
            *each("position_{}"),
            *each("velocity_{}"),
            *each("effort_{}"),
        ],
        T,
        np.arange(N),
        np.full(N, 1.7e9),
        T * 1e9,
        *([name] * N for name in NAMES),
        Q,
        QD,
        TAU,
    ).encode(),
    "seconds and nanoseconds": table(
        ["stamp.sec", "stamp.nanosec", *each("position_{}"), *each("effort_{}")],
        1_700_000_000 + np.floor(T + 0.9).astype(int),
        np.round((T + 0.9) % 1.0 * 1e9).astype(int),
        Q,
        TAU,
    ).encode(),
    "PlotJuggler": "".join(
        # A row for each message of any topic; cells of the others are empty.
        line + ("\n" + ",".join([f"{T[k - 1] + 0.004}"] + [""] * 9 + ["7"]) if k else "") + "\n"
        for k, line in enumerate(
            table(
                [
                    "__time",
                    *(
                        f"/joint_states/{name}/{kind}"
                        for kind in ("position", "velocity", "effort")
                        for name in NAMES
                    ),
                    "/battery/voltage",
                ],
                T,
                Q,
                QD,
                TAU,
                [""] * N,
            ).splitlines()
        )
    ).encode(),
    "ur_rtde": table(
        [
            "timestamp",
            *each("target_q_{}"),
            *each("target_qd_{}"),
            *each("actual_q_{}"),
            *each("actual_qd_{}"),
            *each("actual_TCP_speed_{}"),
            *each("target_moment_{}"),
            *each("actual_torque_{}"),
        ],
        T + 421.5,
        -Q,
        -QD,
        Q,
        QD,
        Q,
        -TAU,
        TAU,
        delimiter=" ",
    ).encode(),
    "libfranka": table(
        [
            "duration",
            " success rate",
            *each(" q[{}]"),
            *each(" q_d[{}]"),
            *each("dq[{}]"),
            *each("dq_d[{}]"),
            *each("tau_J[{}]"),
            *each("tau_ext_hat_filtered[{}]"),
            "sent commands",
            *each("q_d[{}]"),
            *(f"O_T_EE_d[{k}]" for k in range(16)),
            *each("tau_J_d[{}]"),
        ],
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
    ).encode(),
    "KUKA Sunrise": table(
        [
            "ZeitSek",
            "ZeitNsec",
            *each("axisQMsr_LBR_iiwa_14_R820_1_A{}", 1),
            *each("axisQCmd_LBR_iiwa_14_R820_1_A{}", 1),
            *each("axisTauMsr_LBR_iiwa_14_R820_1_A{}", 1),
            *each("axisTauExtMsr_LBR_iiwa_14_R820_1_A{}", 1),
        ],
        np.full(N, 1_500_000_000),
        np.round(T * 1e9).astype(int),
        Q,
        -Q,
        TAU,
        0 * TAU,
        delimiter=" ",
    ).encode(),
    "KUKA FRI": table(
        [
            "Time [ms]",
            *each("msrJntPos A{}", 1),
            *each("cmdJntPos A{}", 1),
            *each("msrJntTrq A{}", 1),
            *each("estExtJntTrq A{}", 1),
        ],
        T * 1e3,
        Q,
        -Q,
        TAU,
        0 * TAU,
    ).encode(),
    "microseconds": table(
        ["time", *each("q{}"), *each("tau{}")], np.round(T * 1e6).astype(int), Q, TAU
    ).encode(),
    "dates, ISO 8601": table(
        ["time", *each("q{}"), *each("tau{}")], dated("%Y-%m-%dT%H:%M:%S.%fZ"), Q, TAU
    ).encode(),
    "dates of pandas": table(
        ["", *each("q{}"), *each("tau{}")], dated("%Y-%m-%d %H:%M:%S.%f"), Q, TAU
    ).encode(),
    "dates, German": table(
        ["Zeit", *each("q{}"), *each("tau{}")],
        dated("%d.%m.%Y %H:%M:%S,%f"),
        Q,
        TAU,
        delimiter=";",
        form=lambda x: repr(x).replace(".", ","),
    ).encode(),
    "dates, American": table(
        ["Time", *each("q{}"), *each("tau{}")], dated("%m/%d/%Y %H:%M:%S.%f"), Q, TAU
    ).encode(),
    "names in German letters": table(
        ["t", *(f"Gelenk_{x}.position" for x in "äöü"), *(f"Gelenk_{x}.moment" for x in "äöü")],
        T,
        Q,
        TAU,
    ).encode(),
}


def robot_of(snippet, tmp_path, names=NAMES):
    joints = "".join(f"  - {{name: {name}}}\n" for name in names)
    return parse_robot(
        f"name: x\nconvention: standard\njoints:\n{joints}{snippet}\n", tmp_path / "x.yaml"
    )


def pasted(path, tmp_path):
    """Return what is read with the part of a robot file that was printed, in SI units."""
    found = inspect_log(path)
    assert found.snippet(), found.columns
    robot = robot_of(found.snippet(), tmp_path)
    return in_si(robot_columns(read_log(path, robot=robot), robot), robot)


@pytest.mark.parametrize("name", FILES)
def test_a_table_is_read_with_what_is_printed_to_paste(name, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(FILES[name])
    log = pasted(path, tmp_path)
    assert len(log) == N
    np.testing.assert_allclose(log.t - log.t[0], T, rtol=0, atol=1e-6)
    np.testing.assert_allclose(log.q, Q, rtol=0, atol=1e-12)
    np.testing.assert_allclose(log.tau, TAU, rtol=0, atol=1e-11)


def test_joints_are_taken_by_their_names_where_a_table_holds_them(tmp_path):
    """What rostopic writes is in the order of the messages, which is that of the alphabet for many drivers."""
    path = tmp_path / "log.csv"
    path.write_bytes(FILES["rostopic echo -p"])
    robot = robot_of(
        inspect_log(path).snippet().replace("[shoulder, elbow, wrist]", "[wrist, shoulder, elbow]"),
        tmp_path,
    )
    np.testing.assert_array_equal(
        robot_columns(read_log(path, robot=robot), robot).q, Q[:, [2, 0, 1]]
    )


@pytest.mark.parametrize("index", ["unnamed", "named", "dates", "words", "rows"])
def test_a_parquet_of_pandas_is_read_with_its_index(index, tmp_path):
    pandas = pytest.importorskip("pandas")
    path = tmp_path / "log.parquet"
    frame = pandas.DataFrame(np.hstack([Q, TAU]), columns=[*each("q_{}"), *each("tau_{}")])
    frame.index = {
        "unnamed": pandas.Index(T),
        "named": pandas.Index(T, name="time"),
        "words": pandas.Index(dated("%Y-%m-%dT%H:%M:%S.%f+01:00"), name="time"),
        "dates": pandas.DatetimeIndex([START + timedelta(seconds=t) for t in T]),
        "rows": frame.index,
    }[index]
    if index == "rows":
        frame["t"] = T
    frame.to_parquet(path)
    log = read_log(path, robot=robot_of("", tmp_path, ("0", "1", "2")))
    np.testing.assert_allclose(log.t - log.t[0], T, rtol=0, atol=1e-6)
    np.testing.assert_array_equal(log.tau, TAU)


def test_a_row_of_words_among_the_numbers_is_named(tmp_path):
    path = tmp_path / "log.csv"
    lines = table(["t", *each("q_{}"), *each("tau_{}")], T, Q, TAU).splitlines()
    path.write_text("\n".join([*lines[:30], "the arm was stopped here", *lines[30:]]))
    with pytest.raises(LogLayout, match=r"log\.csv:31"):
        read_log(path, robot=robot_of("", tmp_path, ("0", "1", "2")))
