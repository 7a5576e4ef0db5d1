"""Figures that a change of the code must not move.

    PYTHONPATH=src python benchmarks/oracle.py   compares with benchmarks/oracle.json; status 1: moves
    ... --redesign            within the wider limits of that file, for a change that moves figures
    ... --only runs,gaps -v   some groups; every entry that moved
    ... --write               writes the figures of these groups anew; limits stay

Only the public API and the command line are used. Recordings of real arms lie in ``--data``
(../shared/data); cases without theirs are skipped, which is said. A move is relative to the entry
itself, or to a thousandth of the largest number beside it where that is more. A limit is the
largest of what stands there: ``relative``, ``absolute``, and ``std_errors`` times the standard
error of the entry; ``may_grow`` allows entries that were not there.
"""

import argparse
import ctypes
import json
import os
import runpy
import subprocess
import sys
import tempfile
import time
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from importlib.util import find_spec
from itertools import repeat
from pathlib import Path
from shutil import which

# Why before NumPy: its linear algebra reads them once. With one kernel and one thread, sums are the
# same on most machines.
os.environ |= {"OPENBLAS_NUM_THREADS": "1", "OPENBLAS_CORETYPE": "Haswell"}

import numpy as np

import dynid
from dynid.errors import DynidError

ROOT = Path(__file__).resolve().parents[1]
TABLE = ROOT / "benchmarks" / "oracle.json"
#: Where the measured package lies: commands run in other folders.
SOURCE = str(Path(dynid.__file__).parents[1])
DATA = ROOT.parent / "shared" / "data"

ARMS = {
    "two_link.yaml": """\
name: two_link
convention: standard
gravity: [0, -9.81, 0]
joints:
  - {name: shoulder, a: 0.4, limits: {position: [-3, 3], velocity: 4, acceleration: 20, torque: 60}}
  - {name: elbow, a: 0.3, limits: {position: [-3, 3], velocity: 5, acceleration: 20, torque: 30}}
prior:
  links:
    - {mass: 3, com: [-0.2, 0, 0], inertia_com: {ixx: 0.01, iyy: 0.05, izz: 0.05}}
    - {mass: 2, com: [-0.15, 0, 0], inertia_com: {ixx: 0.01, iyy: 0.03, izz: 0.03}}
""",
    "three_link.yaml": """\
name: three_link
convention: standard
joints:
  - {name: waist, twist: 1.5707963267948966, d: 0.3, limits: {position: [-3, 3], velocity: 3, acceleration: 15, torque: 80}}
  - {name: shoulder, a: 0.4, limits: {position: [-2, 2], velocity: 3, acceleration: 15, torque: 80}}
  - {name: elbow, a: 0.3, limits: {position: [-2, 2], velocity: 4, acceleration: 20, torque: 40}}
prior: {cylinders: {density: 1500, radius: 0.05}}
""",
    "jaco_6.yaml": """\
name: jaco_6
convention: standard
gravity: [0, 0, 9.81]
joints:
  - {name: jaco_joint_1, a: 0, twist: -1.5707963267948966, d: -0.2755}
  - {name: jaco_joint_2, a: 0.41, twist: -3.141592653589793, d: 0, theta_offset: -1.5707963267948966}
  - {name: jaco_joint_3, a: 0, twist: 1.5707963267948966, d: -0.0098, theta_offset: 1.5707963267948966}
  - {name: jaco_joint_4, a: 0, twist: 1.0471975511965976, d: -0.250061}
  - {name: jaco_joint_5, a: 0, twist: -1.0471975511965976, d: -0.085519}
  - {name: jaco_joint_6, a: 0, twist: 0, d: -0.202759}
driver: {kind: generic, topic: /jaco_22_driver/out/joint_states}
""",
}

#: Robot and recordings: of the project itself, then of the data folder.
RECORDINGS = """
kuka_lwr4plus   | trajectories/lwr4plus_identify.bag trajectories/lwr4plus_validate.bag
kinova_gen2     | trajectories/kinova_gen2_identify.bag trajectories/kinova_gen2_validate.bag
kuka_lwr4plus   | kuka_lwr4plus/run1.bag kuka_lwr4plus/run2.bag kuka_lwr4plus/run3.bag
ur10            | ur10_salerno/exc.npz
staubli_tx40    | tx40/exc.npz
franka_panda    | panda_salerno/exc.npz
rokae_xmate3/rokae.yaml          | rokae_xmate3/joint_all.csv
rokae_xmate3/rokae_motor.yaml    | rokae_xmate3/joint_all.csv
airbot_play/airbot.urdf          | airbot_play/chirp.csv airbot_play/trapezoid.csv
airbot_play/airbot.urdf          | airbot_play/chirp_loaded.csv
shanghai_cobot/shanghai.yaml     | shanghai_cobot/traj1.csv shanghai_cobot/traj2.csv
shanghai_cobot/shanghai.yaml     | shanghai_cobot/traj3.csv
shanghai_cobot/shanghai_raw.yaml | shanghai_cobot/traj1.csv
lbr_med7/med7.urdf               | lbr_med7/med7.csv
so101/so101.yaml | so101/large_amplitude.csv so101/multisine.csv so101/reaching_points.csv
jaco_6.yaml      | jaco2_6dof/example_traj_2017-05-31-17-12-04.bag jaco2_6dof/example_traj.npz
"""
#: Robot, what is fitted, what is predicted: recordings, without the interval after @ [s]; numbers
#: are seeds of simulated logs.
RUNS = """
LWR4+ 1 to 3    | kuka_lwr4plus | kuka_lwr4plus/run1.bag | kuka_lwr4plus/run3.bag
LWR4+ 1, 2 to 3 | kuka_lwr4plus | kuka_lwr4plus/run1.bag kuka_lwr4plus/run2.bag | kuka_lwr4plus/run3.bag
LWR4+ 3 to 1    | kuka_lwr4plus | kuka_lwr4plus/run3.bag | kuka_lwr4plus/run1.bag
UR10            | ur10          | ur10_salerno/exc.npz@18-999 | ur10_salerno/exc.npz@0-18
TX40            | staubli_tx40  | tx40/exc.npz@5-999 | tx40/exc.npz@0-5
Panda           | franka_panda  | panda_salerno/exc.npz@16-999 | panda_salerno/exc.npz@0-16
Rokae A to B    | rokae_xmate3/rokae.yaml | rokae_xmate3/joint_all.csv@10-999 | rokae_xmate3/joint_all.csv@0-10
Rokae B to A    | rokae_xmate3/rokae.yaml | rokae_xmate3/joint_all.csv@0-10 | rokae_xmate3/joint_all.csv@10-999
AIRBOT          | airbot_play/airbot.urdf | airbot_play/chirp.csv | airbot_play/trapezoid.csv
Shanghai        | shanghai_cobot/shanghai.yaml | shanghai_cobot/traj2.csv shanghai_cobot/traj3.csv | shanghai_cobot/traj1.csv
Med 7           | lbr_med7/med7.urdf | lbr_med7/med7.csv@10-999 | lbr_med7/med7.csv@0-10
two_link        | two_link.yaml | 1   | 2
scara           | scara         | 1   | 2
kinova_gen3     | kinova_gen3   | 1 2 | 3
"""
EXPORTED = ("LWR4+ 3 to 1", "UR10")
#: Robot, what is hidden in its simulated logs, options of the search; for changes, four logs were
#: known before them.
GAPS = """
LWR4+ 1, 2        | kuka_lwr4plus   | |
nothing           | two_link.yaml   | |
spring            | two_link.yaml   | spring@1:order=1,constant=0,k1=1.5 |
stribeck          | two_link.yaml   | stribeck@2:a=1.2,vs=0.2,d=1 |
not asked for     | two_link.yaml   | stribeck@2:a=1.2,vs=0.2,d=1 | --effects torque_ripple,end_stop
nonlinear_viscous | two_link.yaml   | nonlinear_viscous@1:a=0.8,p=2 |
hysteresis        | two_link.yaml   | presliding_hysteresis@1:a=1.5,delta=0.05 |
two effects       | two_link.yaml   | end_stop@1:side=1,q1=0.3,a=4 torque_ripple@2:a=0.2,b=0.1,k=14 |
load_friction     | three_link.yaml | load_friction@2:a=0.08 |
nothing changed   | two_link.yaml   | | --ask changed
payload           | two_link.yaml   | payload:form=4,m=0.5,mcx=0,mcy=0,mcz=0 | --ask changed
coulomb_change    | three_link.yaml | coulomb_change@3:c=0.8 | --ask changed
"""
#: The commands of one arm, in one folder; the log simulated with another seed is unseen.
STORY = """
model two_link.yaml
check two_link.yaml
trajectory two_link.yaml --no-optimise --duration 10 --segments 5 --alpha 1 --preview none --accept
check out/two_link/trajectory.npz
simulate two_link.yaml out/two_link/trajectory.npz -o one
simulate two_link.yaml out/two_link/trajectory.npz --seed 1 --payload 0.5 -o two
check one/simulated.npz --robot two_link.yaml
parameters two_link.yaml one/simulated.npz --no-identify
identify two_link.yaml one/simulated.npz
identify two_link.yaml two/simulated.npz --no-report -o other
check out/two_link/parameters.npz
validate out/two_link two/simulated.npz
validate out/two_link one/simulated.npz
validate out/two_link two/simulated.npz --no-plot --max-rms 0.0001 -o limit
gap out/two_link two/simulated.npz --ask changed --no-plot
export out/two_link --format urdf --format mjcf --format python --format c
compare out/two_link other
compare other --baseline out/two_link
report out/two_link
doctor
model no_such_arm
identify two_link.yaml no_such.bag
export other --format urdf -o out/two_link/parameters.npz
"""
#: Keys of answers under which every name is somebody's own, such as that of a parameter.
OWN = {"arrays", "cannot_judge", "evidence", "header", "origin", "parameters", "seconds", "terms"}


# ---------------------------------------------------------------- what groups share
class AbsentError(Exception):
    """A recording is not on this machine."""


def rows(table):
    """Return the rows of a table: the first cell, and the words of each other one."""
    lines = [line.split("|") for line in table.strip().splitlines()]
    return [(name.strip(), [cell.split() for cell in cells]) for name, *cells in lines]


def stored(figures):
    """Return figures as they stand in the file, with 12 digits."""
    text = json.dumps(figures, default=list)
    return json.loads(
        text, parse_float=lambda x: float(f"{float(x):.12g}"), parse_constant=lambda x: x
    )


def summary(columns):
    """Return rms and a random sum of each column: no change of an entry leaves both as they are."""
    x = np.asarray(columns, float).reshape(len(columns), -1)
    weights = np.random.default_rng(0).standard_normal(len(x)) / np.sqrt(len(x))
    return [*np.sqrt(np.mean(x**2, axis=0)), *(weights @ x)]


def place(name, data):
    """Return the path of a file of this script, the project or the data, or the name of an arm."""
    for folder in (Path(), ROOT, data):
        if (folder / name).is_file():
            return str((folder / name).resolve())
    if "/" in name:
        raise AbsentError(name)
    return name


def command(*words):
    """Return exit status and JSON answer of a command line of dynid, run in the working folder."""
    line = [sys.executable, "-m", "dynid", *words, "--json", "--no-input"]
    done = subprocess.run(
        line, env=os.environ | {"PYTHONPATH": SOURCE}, capture_output=True, check=False
    )
    if done.returncode not in range(8):
        raise RuntimeError(f"dynid {' '.join(words)}: {done.stderr.decode()}")
    return done.returncode, json.loads(done.stdout)


def simulated(robot, motion, effects, seed):
    """Return the log of an arm that moves along five sines a joint, inside its limits."""
    random, t = np.random.default_rng(motion), np.arange(0.0, 15.0, 0.01)
    q = np.zeros((3, len(t), robot.n))
    for j, joint in enumerate(robot.joints):
        low, high = joint.limits.position or (-3.0, 3.0)
        q[0, :, j] = (low + high) / 2
        for k in range(1, 6):
            w, size = 2 * np.pi * 0.12 * k, random.uniform(0.4, 0.8) / k
            wave = min(0.3 * (high - low), 1.0) * size * np.exp(1j * (w * t + random.uniform(0, 6)))
            q[..., j] += [wave.imag, w * wave.real, -(w**2) * wave.imag]
    return dynid.simulate(robot, dynid.Motion(t, *q), effects=effects, seed=seed).log


def recording(word, robot, data):
    """Return a checked log: of a file, of one without an interval, or simulated with a seed."""
    if word.isdigit():
        return dynid.load_log(simulated(robot, int(word), [], int(word)), robot)
    name, _, interval = word.partition("@")
    log = dynid.load_log(place(name, data), robot, exclude=[interval] if interval else [])
    # Why: its torques have the other sign than its URDF; and parts with the hash of the whole would
    # count as the same recording.
    log = replace(log, tau=-log.tau) if "med7" in name else log
    return replace(log, sha256="") if interval else log


def fitted(case, data):
    """Return the robot of a run, and its result."""
    (name,), words, _ = dict(rows(RUNS))[case]
    robot = dynid.load_robot(place(name, data))
    logs = [recording(word, robot, data) for word in words]
    return robot, dynid.identify(robot, logs, holdout=None, anyway=case == "Shanghai")


# ---------------------------------------------------------------- groups
def logs(case, data):
    """Measure what is read from a recording, and what is found in it."""
    robot, path = (place(name, data) for name in case.split())
    status, answer = command("check", path, "--robot", robot)
    findings = [answer["error"]] if "error" in answer else answer["findings"]
    codes = {"status": status} | Counter(sorted(each["code"] for each in findings))
    try:
        log = dynid.load_log(path, robot, identify=False)
    except DynidError as error:
        return {"codes": codes, "arrays": {"error": error.code}}
    columns = {"t": log.t - log.t[0], "q": log.q, "qd": log.qd, "tau": log.tau}
    arrays = {key: summary(x) for key, x in columns.items() if x is not None}
    return {"codes": codes, "arrays": {"samples": len(log), "begin": float(log.t[0]), **arrays}}


def runs(case, data):
    """Measure parameters, and how far they are off, expected and seen, on what was not fitted."""
    robot, result = fitted(case, data)
    seen = dynid.validate(result, recording(dict(rows(RUNS))[case][2][0], robot, data))
    return {
        "parameters": dict(zip(result.names, result.theta, strict=True)),
        "std_errors": dict(zip(result.names, result.std_error, strict=True)),
        "fitted_percent": result.relative_error_percent,
        "expected_percent": seen.expected_percent,
        "unseen_percent": seen.relative_error_percent,
        "unseen_rms": [joint.rms for joint in seen.joints],
    }


def models(case, data):
    """Measure which parameters of an arm can be identified, and in which combinations."""
    _, answer = command("model", place(case, data), "-o", "model")
    classes = {name: " ".join(names) for name, names in answer["classes"].items()}
    return {
        "classes": classes,
        "relations": {each["name"]: each["terms"] for each in answer["groups"]},
    }


def exports(case, data):
    """Measure the torques of exported files at 100 random states, each run by what reads it."""
    robot, result = fitted(case, data)
    states = np.random.default_rng(0).uniform(-1.5, 1.5, (100, 3, robot.n))
    for suffix in (".py", ".c", ".urdf", ".xml"):
        dynid.export(result, Path(f"arm{suffix}"))
    parts = states.transpose(1, 0, 2)
    torques = {
        "result": result.inverse_dynamics(*parts),
        "python": runpy.run_path("arm.py")["inverse_dynamics"](*parts),
    }
    for engine, run in {"cc": in_c, "pinocchio": in_pinocchio, "mujoco": in_mujoco}.items():
        if which(engine) or find_spec(engine):
            torques[engine] = run(states)
    return {"torques": {name: summary(tau) for name, tau in torques.items()}}


def in_c(states):
    """Return the torques of arm.c."""
    line = "cc -O1 -ffp-contract=off -shared -fPIC -o arm.so arm.c -lm"
    subprocess.run(line.split(), check=True)
    # Why the whole path: a library of the same name that is loaded already is not loaded again.
    library = ctypes.CDLL(str(Path("arm.so").resolve()))
    function, tau = library.dynid_inverse_dynamics, np.zeros_like(states[:, 0])
    for row, state in zip(tau, states, strict=True):
        function(*(ctypes.c_void_p(x.ctypes.data) for x in (*state, row)))
    return tau


def in_pinocchio(states):
    """Return the torques of arm.urdf, which has no friction there."""
    import pinocchio

    model = pinocchio.buildModelFromUrdf("arm.urdf")
    data = model.createData()
    return np.array([pinocchio.rnea(model, data, *state).copy() for state in states])


def in_mujoco(states):
    """Return the torques of arm.xml without dry friction, which is no torque there."""
    import mujoco

    model = mujoco.MjModel.from_xml_path("arm.xml")
    model.opt.disableflags |= mujoco.mjtDisableBit.mjDSBL_CONSTRAINT
    data, tau = mujoco.MjData(model), []
    for data.qpos[:], data.qvel[:], data.qacc[:] in states:
        mujoco.mj_inverse(model, data)
        tau.append(data.qfrc_inverse.copy())
    return tau


def gaps(case, data):
    """Measure which missing effects are named, and their sizes."""
    (name,), hidden, options = dict(rows(GAPS))[case]
    robot = place(name, data)
    if case.startswith("LWR4+"):
        known = paths = [place(f"kuka_lwr4plus/run{k}.bag", data) for k in (1, 2)]
    else:
        arm, changed = dynid.load_robot(robot), "changed" in options
        effects = [hidden if k == 4 or not changed else [] for k in range(5)]
        logs = [simulated(arm, k // 2, effects[k], k) for k in range(5)]
        paths = [str(log.save(Path(f"log{k}.npz"))) for k, log in enumerate(logs)]
        known, paths = paths[:4], paths[4:] if changed else paths
    command("identify", robot, *known, "--no-report", "-o", "run")
    status, answer = command("gap", "run", *paths, "--no-plot", "--no-apply", *options)
    names = [" ".join((each["effect"], *each["joints"])) for each in answer["named"]]
    sizes = {
        f"{name} {key}": number
        for name, each in zip(names, answer["named"], strict=True)
        for key, number in each["parameters"].items()
    }
    return {
        "names": {"status": status, "verdict": answer["verdict"], **dict.fromkeys(names, 1)},
        "sizes": {key: number["value"] for key, number in sizes.items()},
        "std_errors": {key: number["std_error"] for key, number in sizes.items()},
    }


def answers(case, _):
    """Record exit statuses and JSON keys of the commands of one arm."""
    found = {}
    for line in STORY.strip().splitlines():
        status, answer = command(*line.split())
        found[line] = {"exit status": status} | dict.fromkeys(sorted(set(keys(answer))), 1)
    return {case: found}


def keys(answer, path=""):
    """Yield the paths of an answer, such as ``joints[].rms_nm``."""
    if isinstance(answer, list):
        for item in answer:
            yield from keys(item, f"{path}[]")
    elif isinstance(answer, dict):
        for key, item in answer.items():
            yield f"{path}.{key}".strip(".")
            if not (isinstance(item, dict) and key in OWN):
                yield from keys(item, f"{path}.{key}")


#: The groups with their cases, the slowest first.
GROUPS = {
    "gaps": (gaps, [*dict(rows(GAPS))]),
    "answers": (answers, ["keys"]),
    "exports": (exports, EXPORTED),
    "runs": (runs, [*dict(rows(RUNS))]),
    "logs": (logs, [f"{arm} {log}" for arm, (names,) in rows(RECORDINGS) for log in names]),
    "models": (models, sorted(str(p.relative_to(ROOT)) for p in ROOT.glob("robots/**/*.yaml"))),
}


def measured(group, case, data):
    """Return the figures of one case, None where its recording is absent."""
    begin, (function, _) = time.perf_counter(), GROUPS[group]
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        os.environ |= {"XDG_CACHE_HOME": folder, "XDG_CONFIG_HOME": folder}
        for name, text in ARMS.items():
            Path(name).write_text(text, encoding="utf-8")
        try:
            figures = stored(function(case, data))
        except AbsentError as error:
            figures = None
            print(f"skipped: {group}, {case}: there is no {error}", file=sys.stderr)
        except Exception as error:  # noqa: BLE001 - a figure that moved
            figures = {"crash": f"{type(error).__name__}: {error}"}
        os.chdir(ROOT)
    print(f"{time.perf_counter() - begin:6.1f} s  {group}, {case}", file=sys.stderr)
    return figures


# ---------------------------------------------------------------- comparison
def leaves(figure, path="", size=0.0):
    """Yield every entry of a figure: where it is, what it is, and the largest number beside it."""
    if isinstance(figure, (dict, list)):
        items = figure if isinstance(figure, dict) else dict(enumerate(figure))
        size = max((abs(x) for x in items.values() if isinstance(x, float)), default=0.0)
        for key, item in items.items():
            yield from leaves(item, f"{path} {key}".strip(), size)
    else:
        yield path, figure, size


def moves(old, new, kind, limit):
    """Yield where each entry of a figure is, its relative move, that in limits, both values."""
    before, after, errors = (
        {where: rest for where, *rest in leaves(figure)}
        for figure in (old.get(kind), new.get(kind), old.get("std_errors"))
    )
    for where in before | after:
        (a, size), (b, _) = before.get(where, ("-", 0.0)), after.get(where, ("-", 0.0))
        if isinstance(a, float) and isinstance(b, float):
            scale, error = max(abs(a), abs(b), 1e-3 * size), errors.get(where, [None])[0]
            allowed = max(
                limit.get("relative", 0.0) * scale,
                limit.get("absolute", 0.0),
                limit.get("std_errors", 0.0) * float(error or 0.0),
            )
            yield where, abs(a - b) / (scale or 1.0), abs(a - b) / (allowed or 1e-300), a, b
        else:
            far = 0.0 if a == b or (a == "-" and limit.get("may_grow")) else np.inf
            yield where, far, far, a, b


def compare(table, new, mode, verbose):
    """Print one row for each figure of each group; return whether all are within the limits."""
    print(f"{'figure':<22}{'entries':>9}{'moved':>7}{'most':>10}  where")
    limits, good = table["limits"][mode], True
    for group, cases in new.items():
        old = table["figures"].get(group, {})
        for kind in dict.fromkeys(k for each in (*old.values(), *cases.values()) for k in each):
            limit = limits.get(f"{group} {kind}", limits["every other figure"])
            found = [
                (f"{case}: {where}", *rest)
                for case in cases
                for where, *rest in moves(old.get(case, {}), cases[case], kind, limit)
            ]
            beyond = [each for each in found if each[2] > 1]
            where, most, *_ = max(beyond or found, key=lambda each: each[1], default=("", 0.0))
            print(
                f"{group + ' ' + kind:<22}{len(found):>9}{len(beyond) or 'same':>7}{most:>10.1e}"
                f"  {where if most else ''}"
            )
            for where, far, _, a, b in beyond if verbose else []:
                print(f"    {where}: {a} -> {b}, {far:.1e}")
            good &= not beyond
    print("" if good else f"\n{limits['note']}")
    return good


def main():
    """Measure, then compare or write; return the exit status."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--data", type=Path, default=DATA, help="recordings of real arms")
    parser.add_argument("--only", default=",".join(GROUPS), help="groups, separated by commas")
    parser.add_argument("--redesign", action="store_true", help="compare within the wider limits")
    parser.add_argument("--write", action="store_true", help="write the figures anew")
    parser.add_argument("-v", "--verbose", action="store_true", help="list all that moved")
    options = parser.parse_args()
    begin, new = time.perf_counter(), {}
    cases = [(group, case) for group in options.only.split(",") for case in GROUPS[group][1]]
    with ProcessPoolExecutor(2) as pool:
        found = pool.map(measured, *zip(*cases, strict=True), repeat(options.data.resolve()))
        for (group, case), figures in zip(cases, found, strict=True):
            if figures:
                new.setdefault(group, {})[case] = figures
    table, good = json.loads(TABLE.read_text(encoding="utf-8")), True
    if options.write:
        table["figures"] |= new
        # Why lines: a diff then shows what moved.
        lines = json.dumps(table).replace("}, ", "},\n")
        TABLE.write_text(lines + "\n", encoding="utf-8")
    else:
        good = compare(table, new, "redesign" if options.redesign else "move", options.verbose)
    print(f"{len(cases)} cases, {time.perf_counter() - begin:.0f} s with two processes")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
