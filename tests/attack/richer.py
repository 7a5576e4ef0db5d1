"""Seeded inputs with every key that a file may have: effects and formulas, drivers and bounds, URLs, names."""

from __future__ import annotations

import io
import json

import numpy as np
from mutate import WORDS, facts
from structured import document

#: Everything that the robot file of ``inputs.ROBOT`` does not say; one block each.
KEYS = (
    "mount: floor",
    "links: all",
    "links: [1, 2]",
    "torque: {source: joint_sensor, noise: 0.1, gain_error: 5%}",
    "torque: {source: motor_current, gain: [1.5, null], relative: true}",
    "torque: {source: motor_torque, noise: [0.1, 0.2]}",
    "driver: {kind: generic, topic: /joint_states, joint_names: [shoulder, elbow], sign: [1, -1], torque_sign: [1, 1], offset: [0, 0.1],\n"
    "  units: {position: rad, velocity: rad/s, effort: Nm}, columns: {time: t, position: 'q_{name}', effort: 'tau_{name}'}}",
    "driver: {kind: generic, effort_topic: /effort, columns: {time: t, position: 'q{i}', velocity: 'qd{i}', effort: 'tau{i}', reference: 'r{i}'}}",
    "simulator: {sign: [1, -1], offset: [0, 0.5]}",
    "tool: {mass: 0.5, com: [0, 0, 0.1], inertia_com: {ixx: 0.001, iyy: 0.001, izz: 0.001}}",
    "known: {total_mass: [1, 20], link_mass: {1: [0, 5]}, com_box: {2: [[-1, -1, -1], [1, 1, 1]]}}",
    "controller: {kp: [100, 50], kd: 5}",
    "coupling: {reduction: [100, 80]}",
    "coupling: {matrix: [[100, 0], [5, 80]]}",
    "coulomb: {shape: threshold, velocity: [0.01, 0.02]}",
    "coulomb: {velocity: 0.05}",
)
#: One effect of each kind, with the parameters that give it its shape.
EFFECTS = (
    "torque_offset",
    "viscous",
    "coulomb",
    "asymmetric_viscous",
    "stribeck, {vs: 0.1, d: 1}",
    "nonlinear_viscous, {p: 2}",
    "load_friction",
    "torque_gain",
    "torque_constant",
    "warmup_friction, {tw: 5}",
    "torque_drift, {tc: 5}",
    "position_friction, {h: 1}",
    "gear_friction, {k: 7}",
    "torque_ripple, {k: 7}",
    "spring, {order: 3, constant: 1}",
    "spring, {order: 1.0e9, constant: 1}",
    "counterbalance",
    "end_stop, {side: 1, q1: 0.1}",
    "motor_inertia",
    "joint_coupling",
    "torque_crosstalk",
    "joint_elasticity",
    "backlash, {b: 0.01}",
    "encoder_offset",
    "presliding_hysteresis, {delta: 0.01}",
    "base_tilt",
    "torque_delay",
    "no_such_effect",
)
FORMULAS = (
    "a",
    "a cos(2 q1) |qd2| + b tau1 qd",
    "a q^2 / (1 + qd^2)",
    "a clip(q, 0.1) - b exp(-qd^2)",
    "a tanh(3 qd) + b sqrt(|q|)",
    "a sign(qd) t",
)
ODD_WORDS = (
    "a q",
    "q^1e308",
    "exp(exp(exp(9 qdd)))",
    "1e400",
    "1e308*1e308",
    "(" * 300,
    "|" * 30,
    "a" * 1001,
    "q99999999999999999999",
    "q0",
    "tau²",
    "q１",
    "é",
    "a / 0",
    "a / (q - q)",
    "a^a",
    "a a",
    "a + a",
    "sqrt(-1)",
    "clip(q)",
    "clip(q, a)",
    "__import__('os')",
    "a.b",
    "lambda",
    "q^-9999",
    "-" * 500,
    "a" + " q" * 400,
    "\x1b[31m",
    "<script>alert(1)</script>",
    "\u202e",
    "a\nb",
    "sin(" * 25 + "q" + ")" * 25,
    "e5",
    "1e",
    "0x1",
    "nan",
    "inf",
)
URLS = (
    "file:///dev/zero",
    "file:///dev/null",
    "file:///nowhere",
    "file://",
    "://",
    "memory://x",
    "memory://",
    "local:///dev/tty",
    "FILE:///etc/passwd",
    "zip://a::file://b.zip",
    "reference://::file:///etc/passwd",
    "simplecache::file:///etc/passwd",
    "data://text/plain,x",
    "a+b://c",
    "dask://x",
    "github://a:b@c/d",
    "file:///proc/self/mem",
    "file:///tmp/\u202e",
    "file:///\x1b[31m",
    "memory://" + "a" * 5000,
    "file://../../etc/passwd",
    "file:///%00",
    "file:///\0",
    "memory://../../HACKED.npz",
    "generic://x",
    "root://x",
    "jupyter://x",
    "git://x",
    "tar://x",
    "libarchive://x",
    "c://x",
)


def _noise(rng: np.random.Generator, text: str) -> str:
    """Return a text with one to three pieces that are copied, cut out, or put in from a list of odd words."""
    for _ in range(rng.integers(1, 4)):
        at = int(rng.integers(0, len(text) + 1))
        word = ODD_WORDS[rng.integers(len(ODD_WORDS))]
        kind = rng.integers(0, 5)
        if kind == 0:
            text = text[:at] + text[at + int(rng.integers(1, 4)) :]
        elif kind == 1:
            text = text[:at] + text
        else:
            text = text[:at] + (" " if kind == 4 else "") + word + text[at:]
    return text


def robot_keys(rng: np.random.Generator, original: str) -> bytes:
    """Return a robot file with keys that most files do not have, now and then with one odd value."""
    text = original
    for key in {str(rng.choice(KEYS)).partition(":")[0]: None for _ in range(rng.integers(1, 5))}:
        text += str(rng.choice([block for block in KEYS if block.startswith(f"{key}:")])) + "\n"
    effects = []
    for _ in range(rng.integers(0, 4)):
        name, _, shape = str(rng.choice(EFFECTS)).partition(", ")
        joints = str(
            rng.choice(
                ["[shoulder]", "[elbow]", "[shoulder, elbow]", "[]", "[wrist]"],
                p=[0.4, 0.3, 0.2, 0.05, 0.05],
            )
        )
        more = f", parameters: {shape}" if shape else ""
        effects.append(f"  - {{effect: {name}, joints: {joints}{more}}}\n")
    if rng.random() < 0.5:
        formula = str(rng.choice(FORMULAS))
        said = json.dumps(_noise(rng, formula) if rng.random() < 0.7 else formula)
        effects.append(
            f"  - {{effect: formula, joints: [elbow], formula: {said}, parameters: {{a: 0.1}}}}\n"
        )
    text += "effects:\n" + "".join(effects) if effects else ""
    return document(rng, text) if rng.random() < 0.6 else text.encode("utf-8", "surrogatepass")


def batch_keys(rng: np.random.Generator, original: str) -> bytes:
    """Return a batch file with hostile names, URLs, stretches and options."""
    jobs = []
    for _ in range(rng.integers(1, 4)):
        job: dict[str, object] = {"robot": "arm.yaml", "logs": ["log.npz"]}
        for _ in range(rng.integers(1, 4)):
            kind, word = (
                rng.integers(0, 9),
                WORDS[rng.integers(len(WORDS))].encode("utf-8", "replace").decode(),
            )
            if kind <= 1:
                job["name"] = str(
                    rng.choice(
                        [
                            word,
                            ".",
                            "..",
                            "con",
                            "a/b",
                            "../x",
                            "x" * 300,
                            "-",
                            "job.json",
                            "Ä\u0301",
                            "\u202e",
                        ]
                    )
                )
            elif kind <= 3:
                job["logs"] = [URLS[rng.integers(len(URLS))]] + (
                    ["log.npz"] if rng.random() < 0.3 else []
                )
            elif kind == 4:
                job["tolerance"] = str(
                    rng.choice(["1", "5%", "1e-300", "1e300", "nan", "1e-3", "-1", "9" * 400])
                )
            elif kind == 5:
                key = str(
                    rng.choice(
                        [
                            "cutoff",
                            "method",
                            "holdout",
                            "out",
                            "from",
                            "config",
                            "debug",
                            "log_file",
                            "limit",
                            "prior",
                            "update",
                            "payload_from",
                            word,
                        ]
                    )
                )
                job["options"] = {
                    key: str(
                        rng.choice(
                            [
                                word,
                                "5",
                                "true",
                                "/dev/zero",
                                "log.npz",
                                "arm.yaml",
                                "../HACKED",
                                "auto",
                            ]
                        )
                    )
                }
            elif kind == 6:
                job["validate"] = [URLS[rng.integers(len(URLS))] if rng.random() < 0.5 else word]
            elif kind == 7:
                job[str(rng.choice(["baseline", "tolerance", "max_unexplained"]))] = str(
                    rng.choice([word, "out", "5%", "nan%", "1e400"])
                )
            else:
                job["robot"] = str(
                    rng.choice([word, "arm.urdf", "/dev/zero", "out", "ur5e\0", "../arm.yaml"])
                )
        jobs.append(job)
    return json.dumps({"jobs": jobs}).encode("utf-8", "replace")


def run_file(rng: np.random.Generator, original: str) -> bytes:
    """Return a run.yaml with other arguments, merged mappings, or odd values."""
    kind = rng.integers(0, 6)
    if kind == 0:
        steps = "".join(
            f"  {b}: &{b} {{<<: [*{a}, *{a}]}}\n"
            for a, b in zip("abcdefghijklmnopqrstuvwx", "bcdefghijklmnopqrstuvwxy", strict=True)
        )
        return (f"{original}gap:\n  a: &a {{x: 1, y: 2}}\n{steps}").encode()
    if kind == 1:
        return (original + "gap: &g {<<: *g}\n").encode()
    if kind == 2:
        words = [
            WORDS[rng.integers(len(WORDS))],
            "--from",
            "out/run.yaml",
            "--limit",
            "samples=1",
            "--json",
            "arm.yaml",
            "log.npz",
            "-h",
            "--version",
        ]
        arguments = [str(rng.choice(words)) for _ in range(rng.integers(0, 6))]
        return ("identify:\n  arguments: " + json.dumps(arguments) + "\n  inputs: {}\n").encode(
            "utf-8", "replace"
        )
    return document(rng, original)


def record(rng: np.random.Generator, original: str) -> bytes:
    """Return the record of a job, or another JSON file, with one odd value."""
    return json.dumps(facts(rng, json.loads(original))).encode("utf-8", "surrogatepass")


def names(rng: np.random.Generator, original: bytes) -> bytes:
    """Return an .npz log whose joints, topic or units have hostile names."""
    with np.load(io.BytesIO(original), allow_pickle=False) as archive:
        arrays = {name: archive[name] for name in archive.files}
    header = json.loads(str(arrays["header"]))
    words = [
        *WORDS,
        "=cmd|' /C calc'!A0",
        "@SUM(1)",
        "a,b;c\td",
        "\ud800",
        "q_ref_a",
        "t",
        "a\x85b",
        "\u2028",
        "{name}",
        "{i}",
        "a/b",
        "shoulder",
    ]
    for key in list(header):
        if key == "joint_names" or rng.random() < 0.2:
            value = header[key]
            word = words[rng.integers(len(words))]
            header[key] = (
                [words[rng.integers(len(words))] for _ in value]
                if isinstance(value, list)
                else word
                if isinstance(value, str)
                else value
            )
    if rng.random() < 0.4:
        header["topic"] = words[rng.integers(len(words))]
    arrays["header"] = np.array(json.dumps(header))
    stream = io.BytesIO()
    np.savez(stream, **arrays)
    return stream.getvalue()


#: Headings of tables of other programs; N stands for a number, J for a joint.
STYLES = (
    ("t", "q_J", "tau_J"),
    ("Zeit [s]", "q N [deg]", "Drehmoment N [Nm]"),
    ("%time", "field.position{N}", "field.effort{N}"),
    ("__time", "/joint_states/J/position", "/joint_states/J/effort"),
    ("timestamp", "actual_q_N", "actual_current_N"),
    ("", "joint_N_position", "joint_N_torque"),
    ("secs;nsecs", "position_N", "effort_N"),
    ("time_ms", "aN", "bN"),
    ("Index", "qN", "iN"),
)
DATES = (
    "2024-03-14 15:09:{}",
    "14.03.2024 15:09:{}",
    "3/14/2024 15:09:{}",
    "15:09:{}",
    "2024-03-14T15:09:{}Z",
    "9999-12-31T23:59:{}-14:00",
    "0000-00-00 00:00:{}",
    "999:59:{}",
    "2024-02-30 1:00:{}",
    "14/14/2024 15:09:{}",
    "-2024-03-14 15:09:{}",
    "2024-03-14 15:09:{}.999999999999",
    "15:09:{},{}",
    "٢٠٢٤-03-14 15:09:{}",
)


def spreadsheet(rng: np.random.Generator, original: str) -> bytes:
    """Return a table as another program writes it: dates, decimal commas, groups, units, empty rows, two columns of stamps."""
    rows = [
        [float(cell) for cell in line.split(",")]
        for line in original.strip().split("\n")[1 : int(rng.choice([3, 30, 200, 900]))]
    ]
    time, position, effort = STYLES[rng.integers(len(STYLES))]
    more = int(rng.choice([2, 2, 2, 1, 7, 40]))
    head = time.split(";") + [
        form.replace("N", str(k + 1)).replace("J", ("shoulder", "elbow", "x" * 99)[min(k, 2)])
        for form in (position, effort)
        for k in range(more)
    ]
    date = DATES[rng.integers(len(DATES))] if rng.random() < 0.4 else ""
    kind, comma = rng.integers(0, 6), rng.random() < 0.3

    def cell(value: float) -> str:
        text = f"{value:,.6f}" if kind == 0 else repr(value * (1e9 if kind == 1 else 1))
        return text.translate(str.maketrans(",.", ".,")) if comma else text

    lines = []
    for row in rows:
        stamp = (
            [str(int(row[0])), str(int(row[0] % 1 * 1e9))]
            if ";" in time
            else [date.format(f"{row[0] % 60:09.6f}", 1) if date else cell(row[0])]
        )
        lines.append(
            [
                *stamp,
                *(cell(row[1 + k % 2]) for k in range(more)),
                *(cell(row[3 + k % 2]) for k in range(more)),
            ]
        )
    for _ in range(rng.integers(0, 3)):
        place, column = int(rng.integers(len(lines))), int(rng.integers(len(head)))
        lines[place][column] = str(
            rng.choice(
                [
                    "",
                    "-",
                    "N/A",
                    "#REF!",
                    "1'000,5",
                    "1.2.3",
                    "12:00",
                    "=1+1",
                    "0x1",
                    "٣",
                    "1e400",
                    "--",
                    " ",
                    '"',
                    "1\u202f000",
                ]
            )
        )
    if rng.random() < 0.2:
        lines.insert(
            0, [str(rng.choice(["[s]", "[rad]", "[Nm]", "(deg)", "", "mA"])) for _ in head]
        )
    if rng.random() < 0.2:
        lines[int(rng.integers(len(lines)))] = []
    if rng.random() < 0.1:
        head = [f"{'1_' * 40}{k}" for k in range(len(head))]
    delimiter = ";" if comma else str(rng.choice([",", ";", "\t", "|", " "]))
    text = "\n".join(delimiter.join(line) for line in [head, *lines])
    how = str(
        rng.choice(["utf-8", "utf-8", "utf-16", "utf-16-le", "cp1252", "utf-8-sig", "utf-32"])
    )
    return text.encode(how, "replace")[: None if rng.random() < 0.9 else -1]
