"""``dynid gap`` on recordings of real arms: what it names as they are, and how often it finds what is put into them.

    python benchmarks/gap_real.py [--data ../shared/data] [--draws 30] [--unchanged 24] [--out gap_real.json] [--table benchmarks/gap_real.md]

With ``--unchanged``: pairs of recordings, and parts of recordings, of one arm that nothing was put into, drawn from the seed; each
is asked what has changed.

The model is identified on one recording (or the first part of one) and kept; the injected thing is in another (the
rest). On the joint that shows it most it is twice as large as what the kept model leaves unexplained in that recording,
of either sign, and is put in by NumPy and Pinocchio alone. Joints whose gain or zero would have to be off by more than
LARGEST to be so large are not drawn.
"""

import argparse
import itertools
import json
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

import study
from arms import pinocchio_model, pinocchio_torques
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.stack import stack_logs
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot
from dynid.gap.analysis import analyse_gap
from dynid.gap.candidates import SelectionOptions
from dynid.gap.problem import kept_model, make_problem
from dynid.robot import Body
from dynid.signals.checks import prepare
from dynid.signals.columns import take_samples
from dynid.signals.conditioned_log import condition_log
from models import base_of

CUTOFF = 10.0
#: Size of what is put in, over the residual of the joint that shows it most.
SIZE = 2.0
#: Largest gain [1] and zero [rad] that are put in.
LARGEST = {"torque_gain": 0.3, "encoder_offset": 0.2}
#: Robot, recording that the model is identified on, recording that is searched.
ARMS = {
    "LWR4+ 1, 2": ("kuka_lwr4plus", "kuka_lwr4plus/run1.bag", "kuka_lwr4plus/run2.bag"),
    "LWR4+ 2, 1": ("kuka_lwr4plus", "kuka_lwr4plus/run2.bag", "kuka_lwr4plus/run1.bag"),
    "LWR4+ 1, 3": ("kuka_lwr4plus", "kuka_lwr4plus/run1.bag", "kuka_lwr4plus/run3.bag"),
    "UR10": ("ur10", "ur10_salerno/exc.npz:0:0.6", "ur10_salerno/exc.npz:0.6:1"),
}
AS_THEY_ARE = {
    "LWR4+": ("kuka_lwr4plus", ("kuka_lwr4plus/run1.bag", "kuka_lwr4plus/run2.bag")),
    "UR10": ("ur10", ("ur10_salerno/exc.npz",)),
    "TX40": ("staubli_tx40", ("tx40/exc.npz",)),
    "TX40, its coupling left out": ("staubli_tx40", ("tx40/exc.npz",)),
    "Panda": ("franka_panda", ("panda_salerno/exc.npz",)),
}
INJECTED = (
    "payload",
    "torque_offset",
    "coulomb_change",
    "torque_delay",
    "torque_gain",
    "encoder_offset",
)
WHOLE_ARM = ("torque_delay", "payload")
#: Changes that have no name: a joint that shakes between 1 and 4 Hz, and a torque that follows its speed and two positions.
NAMELESS = ("vibration", "odd_cross")
#: Recordings of one arm that nothing was put into.
SAME_ARM = {
    "LWR4+": ("kuka_lwr4plus", tuple(f"kuka_lwr4plus/run{k}.bag" for k in (1, 2, 3))),
    "UR10": ("ur10", ("ur10_salerno/exc.npz",)),
    "TX40": ("staubli_tx40", ("tx40/exc.npz",)),
    "Panda": ("franka_panda", ("panda_salerno/exc.npz",)),
}


def read(path, robot):
    """Return a prepared log, or the part of one that ``path:from:to`` names in shares of its length."""
    name, *part = str(path).split(":")
    log = prepare(read_log(Path(name), robot=robot), robot, identify=False)
    if not part:
        return log
    a, b = (round(float(x) * len(log)) for x in part)
    return take_samples(log, np.arange(a, b))


def source_of(log, model, cutoff=CUTOFF):
    return condition_log(log, model, cutoff=cutoff)


def identified(sources, base):
    stacked = stack_logs(sources, base)
    return estimate(stacked, method="wls", holdout=last_share(stacked, 0.2), drop_weak=True)


def ball_torque(robot, t, q):
    """Return torques of one kilogram at the last link, (N, n)."""
    qd = smooth(np.gradient(q, t, axis=0), t)
    qdd = smooth(np.gradient(qd, t, axis=0), t)
    ball = Body(1.0, (0.01, 0.02, 0.04), (1e-4, 0, 0, 1e-4, 0, 1e-4))
    model = pinocchio_model(robot, [*[Body(0.0)] * (robot.n - 1), ball])
    return pinocchio_torques(model, q, qd, qdd)


def smooth(x, t, seconds=0.1):
    width = max(1, round(seconds / np.median(np.diff(t)))) | 1
    window = np.hanning(width + 2)[1:-1]
    return np.stack(
        [
            np.convolve(np.pad(c, width // 2, mode="edge"), window / window.sum(), "valid")
            for c in x.T
        ],
        axis=1,
    )


def unit_torque(name, joint, log, robot, torque_of):
    """Return the torque of what is put in at size 1, (N, n)."""
    t, q, tau = log.t, log.q, log.tau
    if name == "payload":
        return ball_torque(robot, t, q)
    if name == "torque_delay":
        return np.gradient(smooth(tau, t), t, axis=0)
    if name == "encoder_offset":
        away = q.copy()
        away[:, joint] += 1e-3
        return (torque_of(away) - torque_of(q)) / 1e-3
    qd = smooth(np.gradient(q, t, axis=0), t)
    rng = np.random.default_rng(len(t) + joint)
    own = {
        "torque_offset": lambda: 1.0,
        "coulomb_change": lambda: np.tanh(qd[:, joint] / 0.02),
        "torque_gain": lambda: tau[:, joint],
        "vibration": lambda: sum(
            np.sin(2 * np.pi * f * t + p) for f, p in rng.uniform([1, 0], [4, 7], (12, 2))
        ),
        "odd_cross": lambda: (
            np.cos(q[:, joint] + 2 * q[:, (joint + 1) % q.shape[1]]) * qd[:, joint]
        ),
    }
    found = np.zeros_like(q)
    found[:, joint] = own[name]()
    return found


def size_of(torque, residual):
    """Return how large it has to be."""
    return SIZE / np.max(np.sqrt(np.mean(torque**2, axis=0)) / residual)


def inject(name, joint, sign, log, robot, residual, torque_of):
    """Return the log with something in it, and how large it is."""
    t, q, tau = log.t, log.q.copy(), log.tau
    torque = unit_torque(name, joint, log, robot, torque_of)
    signed = name not in ("payload", "torque_delay", *NAMELESS)
    size = (sign if signed else 1.0) * size_of(torque, residual)
    if name == "torque_delay":
        tau = np.stack([np.interp(t - size, t, column) for column in tau.T], axis=1)
    elif name == "encoder_offset":
        q[:, joint] += size
    else:
        tau = tau + size * torque
    return replace(log, q=q, tau=tau, qd=None), float(size)


def drawn(name, arm, data, cache, rng):
    """Return a joint, and a sign."""
    _, _, log, _, _, residual, robot, gravity = known_of(arm, data, cache)
    joints = [
        j
        for j in range(robot.n)
        if size_of(unit_torque(name, j, log, robot, gravity), residual) <= LARGEST.get(name, np.inf)
        and np.ptp(log.q[:, j]) > 0.1
    ]
    return int(rng.choice(joints)), float(rng.choice([-1.0, 1.0]))


def known_of(arm, data, cache):
    """Return the kept model of an arm, the recording that is searched, and what the model leaves of it."""
    if arm not in cache:
        file, first, second = ARMS[arm]
        robot = load_robot(file)
        base = base_of(robot)
        source = source_of(read(data / first, robot), base.model)
        found = identified([source], base)
        log = read(data / second, robot)
        bare = look([log], base, found, source)
        alone = make_problem([source_of(log, base.model)], base, kept_model(found)).rows
        left = np.where(alone.use, alone.tau - alone.W @ found.plain, np.nan)
        residual = np.sqrt(np.nanmean(left**2, axis=0))

        def gravity(q):
            rest = np.zeros_like(q)
            return base.model.observer(base.reduction.base).dense(q, rest, rest) @ found.plain

        cache[arm] = base, found, log, source, bare, residual, robot, gravity
    return cache[arm]


def one(arm, name, joint, sign, data, cache):
    base, found, log, source, bare, residual, robot, gravity = known_of(arm, data, cache)
    altered, size = inject(name, joint, sign, log, robot, residual, gravity)
    start = time.process_time()
    seen = look([altered], base, found, source)
    seconds = time.process_time() - start
    place = [] if name in WHOLE_ARM else [joint]
    named = [[f.name, list(f.joints)] for f in seen.verdict.named]
    before = {(f.name, f.joints) for f in bare.verdict.named}
    return {
        "arm": arm,
        "effect": name,
        "joint": joint,
        "size": size,
        "named": named,
        "found": [name, place] in named,
        "among": any((name, tuple(place)) in f.rivals for f in seen.verdict.named),
        "others": [n for n in named if n != [name, place] and (n[0], tuple(n[1])) not in before],
        "values": [f.values for f in seen.verdict.named if f.name == name],
        "closest": [[f.name, list(f.joints), why] for f, why in seen.verdict.closest],
        "seconds": seconds,
        "word": seen.verdict.word,
        "differ": [j + 1 for j in seen.verdict.remainder],
    }


def look(logs, base, found, earlier=None):
    sources = [source_of(log, base.model) for log in logs]
    kept = None if found is None else kept_model(found)
    return analyse_gap(
        sources,
        base,
        kept,
        SelectionOptions(),
        possible=True,
        simulate=False,
        earlier=[earlier] if earlier else (),
    )


def unchanged(data, draws, seed):
    """Print the endings of drawn pairs of recordings, or parts of them, between which nothing was changed."""
    rng = np.random.default_rng([seed, 7])
    for arm in itertools.islice(itertools.cycle(SAME_ARM), draws):
        file, logs = SAME_ARM[arm]
        pair = drawn_pair(logs, rng)
        robot = load_robot(file)
        base = base_of(robot)
        first, second = (read(data / part, robot) for part in pair)
        source = source_of(first, base.model)
        verdict = look([second], base, identified([source], base), source).verdict
        named = ", ".join(f"{f.name} {places(f.joints)}" for f in verdict.named) or "-"
        differ = [j + 1 for j in verdict.remainder] or "-"
        print(arm, *pair, verdict.word, named, differ, flush=True)


def drawn_pair(logs, rng):
    """Return two recordings, each most of one, or two parts of the same."""
    if len(logs) > 1 and rng.random() < 0.5:
        return tuple(
            f"{log}:{rng.uniform(0, 0.3):.2f}:{rng.uniform(0.7, 1):.2f}"
            for log in rng.permutation(logs)[:2]
        )
    log, at = rng.choice(logs), rng.uniform(0.35, 0.65)
    return tuple(rng.permutation([f"{log}:0:{at:.2f}", f"{log}:{at:.2f}:1"]))


def as_they_are(data):
    """Return what is named in recordings that nothing was put into."""
    rows = []
    for title, (file, logs) in AS_THEY_ARE.items():
        robot = load_robot(file)
        # The reader goes on taking the gears out; only the columns of the motor that turns with its neighbour are gone.
        base = base_of(replace(robot, coupling=None) if "left out" in title else robot)
        seen = look([read(data / log, robot) for log in logs], base, None)
        ratio = seen.improvement.after / np.maximum(seen.improvement.before, 1e-12)
        said = [*((f, "named") for f in seen.verdict.named), *seen.verdict.closest]
        for f, why in said:
            after, interval = ratio[f.joint], seen.improvement.ratio[f.joint]
            ends = " to ".join(f"{100 * (end - 1):+.0f}" for end in interval)
            change = f"{100 * (after - 1):+.0f} % ({ends})"
            rows.append([title, seen.verdict.word, f.name, places(f.joints), change, why])
        if not said:
            rows.append([title, seen.verdict.word, "-", "-", "-", "-"])
    return rows


def places(joints):
    return "-".join(str(k + 1) for k in joints) or "arm"


def table(natural, rows):
    head = "recording | verdict | candidate | joint | held-out error of its joint | said"
    text = study.markdown(head, natural)
    if not rows:
        return text
    lines = []
    for arm, name in itertools.product(ARMS, (*INJECTED, "all", *NAMELESS)):
        names = INJECTED if name == "all" else (name,)
        some = [r for r in rows if r["arm"] == arm and r["effect"] in names]
        counts = (
            sum(r["found"] for r in some),
            sum(r["among"] and not r["found"] for r in some),
            sum(not r["named"] for r in some),
            sum(r["word"] == "unexplained" for r in some),
        )
        others = sorted({f"{n} {places(p)}" for r in some for n, p in r["others"]})
        lines.append([arm, name, len(some), *counts, ", ".join(others) or "-"])
    head = "recordings | put in | draws | right name and joint | among names that fit equally well"
    head += " | not named | told as unexplained | other names that were not there before"
    title = f"Put in at {SIZE:g} times the residual, model kept:"
    return f"{text}\n\n{title}\n\n{study.markdown(head, lines)}"


def main():
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--data", type=Path, default=study.DATA)
    parser.add_argument("--draws", type=int, default=30, help="of each pair of recordings")
    text = "pairs that nothing was put into; nothing else is run then"
    parser.add_argument("--unchanged", type=int, default=0, help=text)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("gap_real.json"))
    parser.add_argument("--table", type=Path)
    args = parser.parse_args()
    if args.unchanged:
        unchanged(args.data, args.unchanged, args.seed)
        return
    natural = as_they_are(args.data)
    print(table(natural, []), flush=True)
    rng = np.random.default_rng(args.seed)
    rows, cache = [], {}
    for k, arm in itertools.product(range(args.draws), ARMS):
        name = (*INJECTED, *NAMELESS)[k % (len(INJECTED) + len(NAMELESS))]
        rows.append(one(arm, name, *drawn(name, arm, args.data, cache, rng), args.data, cache))
        args.out.write_text(json.dumps(rows))
        r = rows[-1]
        size, spent = f"{r['size']:.3g}", f"{r['seconds']:.1f} s"
        said = (r["found"], r["named"], r["closest"], spent)
        print(arm, name, r["joint"], size, *said, flush=True)
    text = table(natural, rows)
    print(text)
    if args.table:
        args.table.write_text(text + "\n")


if __name__ == "__main__":
    main()
