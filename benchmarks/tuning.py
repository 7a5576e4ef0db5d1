"""What each tuning number is worth: every constant of the tables ``tuning.py`` at half and at double its value.

    PYTHONPATH=src python benchmarks/tuning.py [--folder signals ...] [--minutes 60]     go on where the last piece ended
    python benchmarks/tuning.py --page > benchmarks/tuning.md                            the page of all that is there

A fixed set of quick figures is taken with the constant patched, in a process of its own (a fork, where the constant is
read when it is used), and compared with the same figures of the table as it is. A folder gets the figures that it can influence. Rows are kept in benchmarks/tuning.jsonl.
Whole numbers stay whole and at least 1; a number below 1 without a unit stays below 1; several numbers in one constant
change together. A change counts from 0.1 % on: what differs less decides nothing.

The recordings of real arms in ../shared/data are not part of the project; without them their figures are left out.
"""

from __future__ import annotations

import argparse
import ast
import atexit
import contextlib
import gc
import importlib
import io
import json
import math
import os
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
sys.path[:0] = [
    *map(str, (HERE, HERE / "patched", HERE.parent / "tests", HERE.parent / "tests" / "physics"))
]

import numpy as np  # noqa: E402
from constants import PATCH, WATCH, apply  # noqa: E402

DATA = next(
    (f / "shared/data" for f in HERE.parents if (f / "shared/data").is_dir()), Path("nowhere")
)
SHIPPED = HERE.parent / "trajectories"
KEPT = HERE / "tuning.jsonl"
#: A figure that changes by less than this share has not changed.
SAME = 1e-3

Figures = dict[str, float | str]


# ---------------------------------------------------------------- figures
def real() -> Figures:
    """Torque errors on motions of real arms that were not fitted, and the errors that were expected [%]."""
    import dynid
    from real_arms import part

    found: Figures = {}
    if not DATA.is_dir():
        return found
    arm = dynid.load_robot("kuka_lwr4plus")
    runs = {k: dynid.load_log(DATA / f"kuka_lwr4plus/run{k}.bag", arm) for k in (1, 2, 3)}
    pairs = [
        ("LWR4+ run 1 -> 3", arm, runs[1], runs[3]),
        ("LWR4+ run 3 -> 2", arm, runs[3], runs[2]),
    ]
    for name, recording, seconds in (
        ("ur10", "ur10_salerno", 13.0),
        ("staubli_tx40", "tx40", 3.5),
        ("franka_panda", "panda_salerno", 13.0),
    ):
        arm = dynid.load_robot(name)
        log = dynid.load_log(DATA / recording / "exc.npz", arm)
        pairs.append(
            (
                f"{name} {seconds} s",
                arm,
                part(log, 0.0, seconds),
                replace(part(log, seconds, 1e9), sha256=""),
            )
        )
    for name, arm, fitted, unseen in pairs:
        result = dynid.identify(arm, [fitted], dynid.IdentifyOptions(holdout=None))
        seen = dynid.validate(result, unseen)
        found |= {
            f"{name} error %": seen.relative_error_percent,
            f"{name} expected %": seen.expected_percent or math.nan,
        }
    return found


def simulated_arms() -> Figures:
    """True parameters inside their intervals [%], errors, and true over expected error, on arms of random lumps."""
    import dynid
    import random_arms

    rows = []
    for name, seed, hidden in (
        ("kuka_lwr4plus", 0, ()),
        ("ur5e", 1, ("angle", "load", "ripple", "stribeck")),
        ("staubli_tx40", 2, ("delay",)),
        ("franka_panda", 3, ("stribeck",)),
    ):
        robot = replace(dynid.load_robot(name), coupling=None)
        rows.append(
            random_arms.judged(
                random_arms.Arm(robot, 100 + seed, random_arms.ARMS[name]), seed, hidden
            )
        )
    x = np.array(rows)
    return {
        "in intervals %": 100 * float(x[:, 0].mean()),
        "in plain intervals %": 100 * float(x[:, 1].mean()),
        "simulated error %": float(np.exp(np.log(x[:, 3]).mean())),
        "true over expected": float(np.median(x[:, 5])),
        "residual models of 4": float(x[:, 6].sum()),
    }


def methods() -> Figures:
    """Error on the other shipped recording by each estimator [%], the delay, and a payload that is not there."""
    import dynid

    arm = dynid.load_robot("kuka_lwr4plus")
    fitted, unseen = (
        dynid.load_log(SHIPPED / f"lwr4plus_{k}.bag", arm) for k in ("identify", "validate")
    )
    found: Figures = {}
    for method in ("auto", "wls", "ols", "irls", "ridge"):
        result = dynid.identify(arm, [fitted], dynid.IdentifyOptions(method=method))
        found[f"{method} error %"] = dynid.validate(result, unseen).relative_error_percent
        found[f"{method} held out %"] = result.heldout_relative_error_percent or math.nan
        found[f"{method} says"] = " ".join(sorted({each.code for each in result.findings}))
        found[f"{method} std errors"] = float(np.exp(np.log(result.std_error).mean()))
    return found


def mistakes() -> Figures:
    """Mistakes in right robot files: how many of twenty are named, and how many right files are called wrong."""
    import mapping

    found: Figures = {}
    named = alarms = 0
    for k, (name, shown, source) in enumerate(mapping.recordings(7)[:10]):
        *_, alarm, answers = mapping.one((name, shown, source, 30, 0, k))
        alarms += bool(alarm)
        named += sum(word in ("first", "tied", "absorbed") for _, word, _ in answers[:2])
        found[f"{shown} mistakes"] = " ".join(word for _, word, _ in answers[:2])
    return found | {"named": named, "false alarms of 10": alarms}


def spoilt() -> Figures:
    """What is found in a recording that is spoilt in some eighty ways: the codes, or that of the refusal."""
    import dynid
    from dynid.errors import DynidError

    arm, found = dynid.load_robot("kuka_lwr4plus"), {}
    for path in spoilt_logs():
        try:
            read = dynid.load_log(path, arm)
            # Why without delay: finding it takes most of the time, and is done elsewhere.
            more = (
                ()
                if "times" in path.stem
                else dynid.observe(arm, [read], dynid.LogOptions(delay=0.0)).findings
            )
        except DynidError as error:
            found[path.stem] = error.code
        else:
            codes = sorted({each.code for each in (*read.findings, *more)})
            found[path.stem] = f"{' '.join(codes)}; {len(read.t)} samples"
    return found


@cache
def spoilt_logs() -> list[Path]:
    """Write the spoilt recordings, once for all forks."""
    import dynid

    arm = dynid.load_robot("kuka_lwr4plus")
    log = dynid.load_log(SHIPPED / "lwr4plus_validate.bag", arm)
    folder = Path(tempfile.mkdtemp(prefix="spoilt-"))
    atexit.register(shutil.rmtree, folder, ignore_errors=True)
    paths = []
    for name, columns in ways(log.t - log.t[0], np.array(log.q), np.array(log.tau), arm):
        paths.append(folder / f"{name}.npz")
        dynid.Log(names=arm.joint_names, units={"position": "rad", "effort": "Nm"}, **columns).save(
            paths[-1]
        )
    return paths


def ways(t: Any, q: Any, tau: Any, arm: Any) -> Iterator[tuple[str, dict[str, Any]]]:
    """Yield names and columns of spoilt recordings: each mistake in several sizes, so that thresholds lie between."""
    rng, n, dt = np.random.default_rng(3), len(t), float(np.median(np.diff(t)))
    qd = np.gradient(q, t, axis=0)

    def some(share: float) -> Any:
        return rng.random(n) < share

    yield "as it is", {"t": t, "q": q, "tau": tau}
    yield "with velocity", {"t": t, "q": q, "qd": qd, "tau": tau}
    for factor in (0.6, 0.75, 0.85, 1.2, 1.3, 20.0, 57.3, 150.0, 0.0175, -0.4, -1.0):
        yield f"velocity times {factor}", {"t": t, "q": q, "qd": factor * qd, "tau": tau}
    yield (
        "velocities swapped",
        {"t": t, "q": q, "qd": qd[:, [1, 0, *range(2, q.shape[1])]], "tau": tau},
    )
    for noise in (0.02, 0.1, 0.5):
        yield (
            f"velocity noise {noise}",
            {"t": t, "q": q, "qd": qd + noise * rng.normal(size=q.shape), "tau": tau},
        )
    for factor in (1.5, 2.5, 5.0, 57.3):
        yield f"position times {factor}", {"t": t, "q": factor * q, "tau": tau}
    for factor in (0.001, 2.0, 5.0, 10.0, 1000.0):
        yield f"torque times {factor}", {"t": t, "q": q, "tau": factor * tau}
    for lost in (0.02, 0.08, 0.2):
        kept = ~some(lost)
        yield f"{lost} of the samples lost", {"t": t[kept], "q": q[kept], "tau": tau[kept]}
    for gap in (4, 8, 30, 100):
        kept = np.arange(n) % (20 * gap) >= gap
        yield f"gaps of {gap}", {"t": t[kept], "q": q[kept], "tau": tau[kept]}
    for pause in (0.3, 0.8, 5.0):
        yield (
            f"pauses of {pause} s",
            {"t": t + pause * (t > t[n // 3]) + pause * (t > t[2 * n // 3]), "q": q, "tau": tau},
        )
    for jitter in (0.03, 0.1, 0.3, 0.45):
        stamps = np.maximum.accumulate(t + jitter * dt * rng.uniform(-1, 1, n)) + 1e-9 * np.arange(
            n
        )
        yield f"stamps stray by {jitter}", {"t": stamps, "q": q, "tau": tau}
    for share in (0.05, 0.15, 0.3):
        stamps = t.copy()
        doubled = np.flatnonzero(some(share)[1:]) + 1
        stamps[doubled] = stamps[doubled - 1]
        yield (
            f"{share} of the stamps twice",
            {"t": np.maximum.accumulate(stamps), "q": q, "tau": tau},
        )
    for share in (0.03, 0.08, 0.3):
        last = np.maximum.accumulate(np.where(some(share), 0, np.arange(n)))
        yield f"{share} of the samples held", {"t": t, "q": q[last], "tau": tau[last]}
    for share in (0.5, 0.7, 0.9):
        limit = share * np.abs(tau).max(axis=0)
        yield f"torque clipped at {share}", {"t": t, "q": q, "tau": np.clip(tau, -limit, limit)}
    for size in (3.0, 10.0, 100.0):
        yield (
            f"spikes of {size}",
            {"t": t, "q": q, "tau": tau + size * tau.std(axis=0) * some(0.002)[:, None]},
        )
    for seconds in (0.5, 1.5, 4.0, 8.0):
        kept = t < seconds
        yield f"{seconds} s", {"t": t[kept], "q": q[kept], "tau": tau[kept]}
    for rate in (8, 15, 30, 45):
        step = max(1, round(1 / (rate * dt)))
        yield f"at {rate} Hz", {"t": t[::step], "q": q[::step], "tau": tau[::step]}
    for span in (0.0003, 0.003, 0.015, 0.1):
        still = q.copy()
        still[:, 3] = q[0, 3] + span * (q[:, 3] - q[0, 3]) / np.ptp(q[:, 3])
        yield f"a joint moves {span} rad", {"t": t, "q": still, "tau": tau}
    for step in (1e-4, 1e-3, 1e-2):
        yield f"position steps of {step}", {"t": t, "q": np.round(q / step) * step, "tau": tau}
    for offset in (0.02, 0.05, 0.2):
        rated = np.array([joint.limits.torque or 100.0 for joint in arm.joints])
        yield f"torque offset of {offset}", {"t": t, "q": q, "tau": tau + offset * rated}
    for late in (0.004, 0.02, 0.1):
        shifted = np.stack([np.interp(t - late, t, column) for column in tau.T], axis=1)
        yield f"torque {late} s late", {"t": t, "q": q, "tau": shifted}
    turned = q.copy()
    turned[n // 2 :, 6] += 2 * np.pi
    yield "a full turn", {"t": t, "q": turned, "tau": tau}
    for rows in (30, 80, 400):
        where = np.r_[0 : n // 2, n // 2 - rows : n]
        yield (
            f"{rows} rows again",
            {"t": dt * np.arange(len(where)), "q": q[where], "tau": tau[where]},
        )
    for rest in (0.2, 0.5, 3.0):
        where = np.r_[0 : n // 2, np.full(round(rest / dt), n // 2), n // 2 : n]
        noise = 1e-5 * rng.normal(size=(len(where), q.shape[1]))
        yield (
            f"{rest} s at rest",
            {"t": dt * np.arange(len(where)), "q": q[where] + noise, "tau": tau[where]},
        )
    yield "time in milliseconds", {"t": 1000 * t, "q": q, "tau": tau}
    yield "no weight", {"t": t, "q": q, "tau": tau - tau.mean(axis=0)}


def relations() -> Figures:
    """Rank and formulas of all robot files, and one imported back from a URDF."""
    import zlib

    import dynid
    from dynid.files.robotfile import known_robots

    found: Figures = {}
    for name in known_robots():
        reduction = dynid.base_model(dynid.load_robot(name)).reduction
        found[name] = (
            f"rank {reduction.rank}, formulas {zlib.crc32(repr(reduction.formulas).encode()):08x}"
        )
    return found


def named() -> Figures:
    """What the gap search names where an effect is hidden, and how much of the gap it closes."""
    import gap_blind

    found: Figures = {}
    for name, k in (("single", 0), ("single", 8), ("double", 1), ("clean", 0)):
        row = gap_blind.run(name, k, 41)
        found[f"{name} {k} names"] = f"{row['verdict']} {row['named']}"
    return found


def plans() -> Figures:
    """What short plans are worth that a search of one start ends with."""
    import dynid

    found: Figures = {}
    for name, basis in (
        ("scara", "quintic"),
        ("scara", "fourier"),
        ("ur3e", "quintic"),
        ("scara", "spline"),
    ):
        options = dynid.PlanOptions(
            alpha=1.0, duration=6.0, segments=3, basis=basis, restarts=1, seconds=600.0, processes=1
        )
        facts = dynid.plan_trajectory(dynid.load_robot(name), options).facts()
        of = f"{name} {basis}"
        found |= {
            f"{of} condition": facts["condition_number_scaled"],
            f"{of} error N m": facts["expected_torque_error_nm"],
            f"{of} nearest m": facts["closest_m"] or math.nan,
            f"{of} noise": float(np.sum(facts["torque_noise_nm"])),
            f"{of} weakest": str(facts["weakest"])[:60],
            f"{of} other speeds": str(
                [(each["alpha"], f"{each['torque_error']:.3g}") for each in facts["ladder"]]
            ),
            f"{of} assumed": str(facts["assumed_limits"])[:60],
        }
    return found


def reading() -> Figures:
    """What is read of recordings of several formats: samples and their sum, or the code of the refusal."""
    import dynid
    from dynid.errors import DynidError

    arm = dynid.load_robot("kuka_lwr4plus")
    log = dynid.load_log(SHIPPED / "lwr4plus_validate.bag", arm)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        paths = [SHIPPED / "lwr4plus_identify.bag", SHIPPED / "lwr4plus_validate.bag"]
        for suffix in ("npz", "csv", "tsv", "parquet", "mcap", "db3", "bag"):
            paths.append(folder / f"log.{suffix}")
            words = [
                sys.executable,
                "-m",
                "dynid",
                "convert",
                str(paths[1]),
                "--to",
                str(paths[-1]),
            ]
            subprocess.run(words, check=False, capture_output=True)
        heading = (
            "a program wrote this\n" * 30
            + "t,"
            + ",".join(f"{k}_{j}" for k in ("q", "tau") for j in arm.joint_names)
        )
        rows = [
            ",".join(f"{x:.6f}" for x in (t, *q, *tau))
            for t, q, tau in zip(log.t, log.q, log.tau, strict=True)
        ]
        (folder / "headed.csv").write_text("\n".join([heading, *rows]))
        (folder / "semicolon.csv").write_text(
            "\n".join([heading, *rows][1:]).replace(",", ";").replace(".", ",")
        )
        found: Figures = {}
        for path in [*paths, folder / "headed.csv", folder / "semicolon.csv"]:
            try:
                read = dynid.load_log(path, arm)
            except (DynidError, OSError) as error:
                found[path.name] = getattr(error, "code", type(error).__name__)
            else:
                found[path.name] = (
                    f"{len(read.t)} samples, {float(np.abs(read.q).sum() + np.abs(read.tau).sum()):.6g}"
                )
    return found


def driven() -> Figures:
    """A demonstration with a hidden spring, simulated and replayed, and a simulated log."""
    import dynid
    from dynid.cli.main import run

    stream = io.StringIO()
    with tempfile.TemporaryDirectory() as folder, contextlib.redirect_stdout(stream):
        status = run(["demo", "--effect", "spring", "--json", "--quiet", "--out", folder])
    gap = json.loads(stream.getvalue())["gap"] if status == 0 else {}
    found: Figures = {
        "status": float(status),
        "verdict": gap.get("verdict", ""),
        "named": str(len(gap.get("named", []))),
    }
    for name in (
        "heldout_before_nm",
        "heldout_after_nm",
        "simulation_before",
        "simulation_after",
        "noise_floor_nm",
    ):
        numbers = np.array(gap.get("gap", {}).get(name) or [math.nan], dtype=float)
        found[name] = float(np.nansum(numbers))
    log = dynid.simulate(
        dynid.load_robot("kuka_lwr4plus"), SHIPPED / "kuka_lwr4plus_alpha1.0.npz"
    ).log
    found["simulated"] = f"{len(log.t)} samples, {float(np.abs(log.tau).sum()):.6g}"
    return found


SETS: dict[str, tuple[Callable[[], Figures], ...]] = {
    "model": (relations, real, named),
    "files": (reading,),
    "signals": (real, spoilt),
    "diagnose": (mistakes,),
    "estimation": (real, simulated_arms, methods),
    "trajectory": (plans,),
    "sim": (driven,),
    "gap": (named,),
}


# ---------------------------------------------------------------- constants
@dataclass(frozen=True)
class Constant:
    """One number, or several in one name, of a table.

    Attributes:
        folder: of dynid.
        name: in its tuning.py.
        value: number or tuple of numbers.
        unit: what stands in square brackets in its comment; "" for none.
    """

    folder: str
    name: str
    value: Any
    unit: str

    def at(self, factor: float) -> Any:
        """Return the value times a factor, of the same kind."""
        one = self._one
        return (
            tuple(one(x, factor) for x in self.value)
            if isinstance(self.value, tuple)
            else one(self.value, factor)
        )

    def _one(self, value: float, factor: float) -> float:
        if isinstance(value, int):
            return max(1, round(factor * value)) if value else 0
        if 0 < value < 1 <= factor * value and not self.unit:
            return (1 + value) / 2
        return factor * value


def constants(folder: str) -> list[Constant]:
    """Return the constants of a folder's table."""
    module = importlib.import_module(f"dynid.{folder}.tuning")
    text = Path(str(module.__file__)).read_text()
    lines, found = text.splitlines(), []
    for node in ast.parse(text).body:
        targets = (
            node.targets
            if isinstance(node, ast.Assign)
            else [node.target]
            if isinstance(node, ast.AnnAssign)
            else []
        )
        for target in [
            each for t in targets for each in (t.elts if isinstance(t, ast.Tuple) else [t])
        ]:
            value = getattr(module, target.id, None) if isinstance(target, ast.Name) else None
            parts = value if isinstance(value, tuple) and value else (value,)
            if all(isinstance(part, int | float) and not isinstance(part, bool) for part in parts):
                above = node.lineno - 1
                while above and lines[above - 1].startswith("#"):
                    above -= 1
                comment = " ".join(lines[above : node.end_lineno])
                unit = re.search(r"\[([^\]\d]+)\]", comment)
                found.append(Constant(folder, target.id, value, unit.group(1) if unit else ""))
    return found


# ---------------------------------------------------------------- measuring
@cache
def measure_from(folder: str) -> Callable[[tuple[str, str, Any] | None], Figures]:
    """Return what takes a folder's figures: in a fork of this process, which has derived the arms and imported all."""
    if folder == "model":
        return partial(afresh, folder)
    from forkserver import derive, load

    if spoilt in SETS[folder]:
        spoilt_logs()
    derive("kuka_lwr4plus", "kinova_gen2", "ur10", "staubli_tx40", "franka_panda", "ur5e")
    load(False)
    gc.freeze()
    early = bound_early(folder)
    return lambda patched: (afresh if patched and patched[1] in early else forked)(folder, patched)


def bound_early(folder: str) -> set[str]:
    """Return the constants that are taken while modules are imported, such as defaults of arguments."""
    found = set()
    for path in (
        Path(str(importlib.import_module(f"dynid.{folder}.tuning").__file__)).parents[1]
    ).rglob("*.py"):
        tree = ast.parse(path.read_text())
        bodies = [n.body for n in ast.walk(tree) if isinstance(n, ast.FunctionDef)]
        late = {each for body in bodies for statement in body for each in ast.walk(statement)}
        late |= {
            each for n in ast.walk(tree) if isinstance(n, ast.Lambda) for each in ast.walk(n.body)
        }
        found |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and n not in late}
    return found


def forked(folder: str, patched: tuple[str, str, Any] | None) -> Figures:
    """Return a folder's figures from a fork."""
    reader, writer = os.pipe()
    child = os.fork()
    if not child:
        os.close(reader)
        try:
            if patched:
                os.environ[PATCH] = json.dumps(patched)
            apply()
            answer = json.dumps(figures(folder))
        except BaseException as error:  # noqa: BLE001 - whatever it is, it is told
            answer = json.dumps({"failure": f"{type(error).__name__}: {error}"[:200]})
        with os.fdopen(writer, "w") as stream:
            stream.write(answer)
        os._exit(0)  # leaves what the parent removes at its end
    os.close(writer)
    with os.fdopen(reader) as stream:
        answer = stream.read()
    os.waitpid(child, 0)
    return json.loads(answer) if answer else {"failure": "killed"}


def afresh(folder: str, patched: tuple[str, str, Any] | None) -> Figures:
    """Return a folder's figures from a process of its own."""
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
    environment.pop(PATCH, None)
    if patched:
        environment[PATCH] = json.dumps(patched)
    words = [sys.executable, __file__, "--figures", folder]
    done = subprocess.run(
        words, env=environment, capture_output=True, text=True, timeout=900, check=False
    )
    if done.returncode:
        return {"failure": (done.stderr.strip().splitlines() or ["killed"])[-1][:200]}
    return json.loads(done.stdout.splitlines()[-1])


def watched(
    folder: str, measured: Callable[[tuple[str, str, Any] | None], Figures]
) -> tuple[Figures, set[str]]:
    """Return a folder's figures and the constants that are read for them; without those no run is needed."""
    with tempfile.TemporaryDirectory() as name:
        path = Path(name) / "read"
        path.touch()
        os.environ[WATCH] = json.dumps([f"dynid.{folder}.tuning", str(path)])
        try:
            found = measured(None)
        finally:
            del os.environ[WATCH]
        return found, set(path.read_text().split()) | bound_early(folder)


def figures(folder: str) -> Figures:
    """Return a folder's figures here; a set that fails is a figure, too."""
    found: Figures = {}
    for each in SETS[folder]:
        began = time.process_time()
        try:
            found |= each()
        except Exception as error:
            if PATCH not in os.environ:
                raise
            found[each.__name__] = f"{type(error).__name__}: {error}"[:100]
        found[f"{each.__name__} s"] = time.process_time() - began
    return found


def changes(before: Figures, after: Figures) -> dict[str, list[float | str]]:
    """Return the figures that differ; times count where they are not within a factor of 1.5."""
    found = {}
    for name, was in before.items():
        now = after.get(name, "none")
        if isinstance(was, str) or isinstance(now, str):
            same = was == now
        elif name.endswith(" s") and not name[0].isdigit():
            same = was < 1 or 1 / 1.5 < now / was < 1.5
        else:
            same = abs(now - was) <= SAME * abs(was) or (math.isnan(now) and math.isnan(was))
        if not same:
            found[name] = [was, now]
    return found


def kept() -> list[dict[str, Any]]:
    """Return the rows that are there."""
    return [json.loads(line) for line in KEPT.read_text().splitlines()] if KEPT.is_file() else []


def study(folders: list[str], minutes: float) -> None:
    """Measure what is not there yet, until the time is over."""
    from resumable import commit

    end = time.monotonic() + 60 * minutes
    os.environ["PYTHONPATH"] = os.pathsep.join(
        [str(HERE / "patched"), os.environ.get("PYTHONPATH", "")]
    )
    for folder in folders:
        done = {(row["folder"], row["name"], row["way"], str(row["at"])) for row in kept()}
        asked = [
            (constant, way, constant.at(factor))
            for constant in constants(folder)
            for way, factor in (("half", 0.5), ("double", 2.0))
        ]
        open_ = [
            each
            for each in asked
            if (folder, each[0].name, each[1], str(_plain(each[2]))) not in done
        ]
        if not open_:
            continue
        measured = measure_from(folder)
        before, read = watched(folder, measured)
        if "failure" in before:
            raise SystemExit(f"{folder}: {before['failure']}")
        for constant, way, value in open_:
            if time.monotonic() > end:
                return
            row = {
                "folder": folder,
                "name": constant.name,
                "value": _plain(constant.value),
                "unit": constant.unit,
                "way": way,
                "at": _plain(value),
                "commit": commit(),
                "figures": len(before),
            }
            row["read"] = constant.name in read
            if value == constant.value or constant.name not in read:
                row["changed"] = {}
            else:
                row["changed"] = changes(
                    before, measured((f"dynid.{folder}.tuning", constant.name, value))
                )
            with KEPT.open("a") as stream:
                stream.write(json.dumps(row) + "\n")
            print(folder, constant.name, way, _plain(value), cell(row), file=sys.stderr, flush=True)


def _plain(value: Any) -> Any:
    return list(value) if isinstance(value, tuple) else value


# ---------------------------------------------------------------- the page
def shown(value: float | str | list[float]) -> str:
    """Return a figure as a cell shows it."""
    if isinstance(value, list):
        return ", ".join(map(shown, value))
    return value.strip("; ") or "nothing" if isinstance(value, str) else f"{value:.4g}"


def cell(row: dict[str, Any] | None) -> str:
    """Return the changes of a row, the first three of them written out."""
    if row is None:
        return "not measured"
    if not row.get("read", True):
        return "not read"
    changed = list(row["changed"].items())
    text = "; ".join(f"{name}: {shown(was)} -> {shown(now)}" for name, (was, now) in changed[:3])
    more = f"; {len(changed) - 3} more" if len(changed) > 3 else ""
    return (text + more).replace("|", "/") or "-"


def page() -> str:
    """Return the page of all rows."""
    rows = {(row["folder"], row["name"], row["way"]): row for row in kept()}
    lines = ["# What each tuning number is worth", "", INTRODUCTION]
    names = list(dict.fromkeys(key[:2] for key in rows))
    nothing: list[str] = []
    unread: list[str] = []
    for folder in dict.fromkeys(folder for folder, _ in names):
        sets = ", ".join(f"{each.__name__.replace('_', ' ')}" for each in SETS[folder])
        commits = sorted({row["commit"] for key, row in rows.items() if key[0] == folder})
        lines += ["", f"## {folder}", "", f"Figures: {sets}. Commit {', '.join(commits)}.", ""]
        lines += [
            "| constant | value | unit | at half | at double |",
            "| --- | --- | --- | --- | --- |",
        ]
        for name in [name for each, name in names if each == folder]:
            half, double = (rows.get((folder, name, way)) for way in ("half", "double"))
            row = half or double
            assert row is not None
            lines.append(
                f"| {name} | {shown(row['value'])} | {row['unit']} | {cell(half)} | {cell(double)} |"
            )
            if half and double and not half["changed"] and not double["changed"]:
                (nothing if half.get("read", True) else unread).append(f"`{folder}.{name}`")
    lines += [
        "",
        "## Numbers that are read and change no figure",
        "",
        ", ".join(nothing) or "None.",
        "",
    ]
    lines += [
        "These are candidates for removal; some decide about situations that the figures do not hold."
    ]
    lines += ["", "## Numbers that no figure reads", "", ", ".join(unread) or "None.", ""]
    lines += [
        "Nothing is known of these; tests hold the situations that they decide about, or none does."
    ]
    return "\n".join(lines)


INTRODUCTION = """\
`python benchmarks/tuning.py` sets each constant of the tables `tuning.py` to half and to double its value and
takes a fixed set of quick figures of what the folder can influence; shown is what changes by more than 0.1 %, "-" where
nothing does, "not read" where no figure comes to the place where the constant is used. Several numbers in one constant change together; whole numbers stay whole; shares stay below 1.

- *real*: torque errors on unseen motions of real arms (LWR4+ run 1 -> 3 and 3 -> 2, UR10 after 13 s, TX40 after 3.5 s,
  Panda after 13 s) and the errors that were expected; *simulated arms*: true parameters in their intervals, four arms;
- *methods*: five estimators on the shipped recording; *mistakes*: twenty wrong robot files and ten right ones;
- *spoilt*: what is found in a recording that is spoilt in some eighty ways; *reading*: recordings of nine kinds;
- *relations*: base parameters of all robot files; *named*: four cases of the gap search; *plans*: four short plans; *driven*:
  the demonstration with a hidden spring. Processor times count where they change by half."""


def main() -> None:
    """Measure, or print."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--folder",
        nargs="+",
        choices=SETS,
        help="tables that are studied (default: all that are there)",
    )
    parser.add_argument("--minutes", type=float, default=60.0)
    parser.add_argument("--figures", choices=SETS, help="print the figures of a folder as JSON")
    parser.add_argument("--page", action="store_true", help="print the page of what is there")
    given = parser.parse_args()
    if given.figures:
        print(json.dumps(figures(given.figures)))
    elif given.page:
        print(page())
    else:
        import dynid

        root = Path(str(dynid.__file__)).parent
        study(
            given.folder or [each for each in SETS if (root / each / "tuning.py").is_file()],
            given.minutes,
        )


if __name__ == "__main__":
    main()
