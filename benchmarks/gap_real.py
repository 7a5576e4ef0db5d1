"""``dynid gap`` on recordings of real arms: what it names as they are, and how often it finds what is put into them.

    python benchmarks/gap_real.py [--data ../shared/data] [--draws 30] [--unchanged 24] [--out gap_real.json]

With ``--unchanged``: pairs of recordings, and parts of recordings, of one arm that nothing was put into, drawn from the seed; each
is asked what has changed.

The model is identified on one recording (or the first part of one) and kept; the injected thing is in another (the
rest). On the joint that shows it most it is twice as large as what the kept model leaves unexplained in that recording,
of either sign, and is put in by NumPy and Pinocchio alone. Joints whose gain or zero would have to be off by more than
LARGEST to be so large are not drawn.
"""

import itertools
import json
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.ndimage import convolve1d

import study
from arms import pinocchio_model, pinocchio_torques
from dynid.errors import LogTooShort
from dynid.estimation.estimate import estimate, last_share
from dynid.estimation.stack import stack_logs
from dynid.files.logs import read_log
from dynid.files.robotfile import load_robot
from dynid.gap.analysis import analyse_gap
from dynid.gap.candidates import SelectionOptions
from dynid.gap.problem import make_problem
from dynid.robot import Body
from dynid.signals.checks import prepare
from dynid.signals.columns import take_samples
from dynid.signals.conditioned_log import condition_log
from models import base_of
from runner import rows

CUTOFF = 10.0
#: Size of what is put in, over the residual of the joint that shows it most.
SIZE = 2.0
#: Largest gain [1] and zero [rad] that are put in.
LARGEST = {"torque_gain": 0.3, "encoder_offset": 0.2}
#: Robot, recording that the model is identified on, recording that is searched.
ARMS = """
LWR4+ 1, 2 | kuka_lwr4plus | kuka_lwr4plus/run1.bag | kuka_lwr4plus/run2.bag
LWR4+ 2, 1 | kuka_lwr4plus | kuka_lwr4plus/run2.bag | kuka_lwr4plus/run1.bag
LWR4+ 1, 3 | kuka_lwr4plus | kuka_lwr4plus/run1.bag | kuka_lwr4plus/run3.bag
UR10       | ur10          | ur10_salerno/exc.npz:0:0.6 | ur10_salerno/exc.npz:0.6:1
"""
#: Robot, and its recordings as they are.
RECORDED = """
LWR4+ | kuka_lwr4plus | kuka_lwr4plus/run1.bag kuka_lwr4plus/run2.bag kuka_lwr4plus/run3.bag
UR10  | ur10          | ur10_salerno/exc.npz
TX40  | staubli_tx40  | tx40/exc.npz
Panda | franka_panda  | panda_salerno/exc.npz
"""
WHOLE_ARM = ("payload", "torque_delay")
INJECTED = (*WHOLE_ARM, "torque_offset", "coulomb_change", "torque_gain", "encoder_offset")
#: Changes that have no name: a joint that shakes between 1 and 4 Hz, and a torque that follows its speed and two positions.
NAMELESS = ("vibration", "odd_cross")


def read(path, robot):
    """Return a prepared log, or the part of one that ``path:from:to`` names in shares of its length."""
    name, *part = str(path).split(":")
    log = prepare(read_log(Path(name), robot=robot), robot, identify=False)
    if not part:
        return log
    a, b = (round(float(x) * len(log)) for x in part)
    return take_samples(log, np.arange(a, b))


def source_of(log, base):
    return condition_log(log, base.model, cutoff=CUTOFF)


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
    return convolve1d(x, window / window.sum(), axis=0, mode="nearest")


class Kept:
    """The model that is kept of an arm, the recording that is searched, and what the model leaves of it."""

    def __init__(self, file, first, second, data):
        self.robot = load_robot(file)
        self.base, self.log = base_of(self.robot), read(data / second, self.robot)
        self.source = source_of(read(data / first, self.robot), self.base)
        stack = stack_logs([self.source], self.base)
        holdout = last_share(stack, 0.2)
        self.found = estimate(stack, method="wls", holdout=holdout, drop_weak=True)
        self.bare = self.look(self.log)
        alone = [source_of(self.log, self.base)]
        alone = make_problem(alone, self.base, self.found).rows
        left = np.where(alone.use, alone.tau - alone.W @ self.found.plain, np.nan)
        self.residual = np.sqrt(np.nanmean(left**2, axis=0))

    def look(self, log):
        """Return what is said of a log beside the kept model."""
        return look([log], self.base, self.found, [self.source])

    def gravity(self, q):
        rest, observer = np.zeros_like(q), self.base.observer
        return observer.dense(q, rest, rest) @ self.found.plain

    def unit_torque(self, name, joint):
        """Return the torque of what is put in at size 1, (N, n)."""
        t, q, tau = self.log.t, self.log.q, self.log.tau
        if name == "payload":
            return ball_torque(self.robot, t, q)
        if name == "torque_delay":
            return np.gradient(smooth(tau, t), t, axis=0)
        found = np.zeros_like(q)
        if name == "encoder_offset":
            found[:, joint] = 1e-3
            return (self.gravity(q + found) - self.gravity(q)) / 1e-3
        qd = smooth(np.gradient(q, t, axis=0), t)[:, joint]
        rng = np.random.default_rng(len(t) + joint)
        shaking = rng.uniform([1, 0], [4, 7], (12, 2))
        found[:, joint] = {
            "torque_offset": 1.0,
            "coulomb_change": np.tanh(qd / 0.02),
            "torque_gain": tau[:, joint],
            "vibration": sum(np.sin(2 * np.pi * f * t + p) for f, p in shaking),
            "odd_cross": np.cos(q[:, joint] + 2 * np.roll(q, -1, axis=1)[:, joint]) * qd,
        }[name]
        return found

    def torque(self, name, joint):
        """Return the torque of what is put in at size 1, (N, n), and how large it has to be."""
        torque = self.unit_torque(name, joint)
        return torque, SIZE / np.max(np.sqrt(np.mean(torque**2, axis=0)) / self.residual)

    def drawn(self, name, rng):
        """Return a joint, and a sign."""
        joints = [
            j
            for j in range(self.robot.n)
            if self.torque(name, j)[1] <= LARGEST.get(name, np.inf)
            and np.ptp(self.log.q[:, j]) > 0.1
        ]
        return int(rng.choice(joints)), float(rng.choice([-1.0, 1.0]))

    def inject(self, name, joint, sign):
        """Return the log with something in it, and how large it is."""
        t, q, tau = self.log.t, self.log.q.copy(), self.log.tau
        torque, size = self.torque(name, joint)
        size *= sign if name not in ("payload", "torque_delay", *NAMELESS) else 1.0
        if name == "torque_delay":
            tau = np.stack([np.interp(t - size, t, column) for column in tau.T], axis=1)
        elif name == "encoder_offset":
            q[:, joint] += size
        else:
            tau = tau + size * torque
        return replace(self.log, q=q, tau=tau, qd=None), float(size)

    def one(self, name, joint, sign):
        """Return what is said of the recording with something in it."""
        altered, size = self.inject(name, joint, sign)
        seen = self.look(altered)
        place = [] if name in WHOLE_ARM else [joint]
        named = [[f.name, list(f.joints)] for f in seen.named]
        before = [[f.name, list(f.joints)] for f in self.bare.named]
        return {
            "effect": name,
            "joint": joint,
            "size": size,
            "named": named,
            "found": [name, place] in named,
            "among": any((name, tuple(place)) in f.rivals for f in seen.named),
            "others": [n for n in named if n != [name, place] and n not in before],
            "word": seen.verdict,
        }


def look(logs, base, kept=None, earlier=()):
    sources, options = [source_of(log, base) for log in logs], SelectionOptions()
    return analyse_gap(sources, base, kept, options, possible=True, earlier=earlier)


def unchanged(data, draws, seed):
    """Print the endings of drawn pairs of recordings, or parts of them, between which nothing was changed."""
    rng = np.random.default_rng([seed, 7])
    for arm, file, logs in itertools.islice(itertools.cycle(rows(RECORDED)), draws):
        pair = drawn_pair(logs.split(), rng)
        # Why: half of the shortest recording is refused.
        with suppress(LogTooShort):
            bare = Kept(file, *pair, data).bare
            named = ", ".join(f"{f.name} {places(f.joints)}" for f in bare.named) or "-"
            differ = [j + 1 for j in bare.remainder] or "-"
            print(arm, *pair, bare.verdict, named, differ, flush=True)


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
    lines = []
    for title, file, logs in rows(RECORDED):
        robot = load_robot(file)
        seen = look([read(data / log, robot) for log in logs.split()[:2]], base_of(robot))
        ratio = seen.improvement.after / np.maximum(seen.improvement.before, 1e-12)
        said = [*((f, "named") for f in seen.named), *seen.closest]
        for f, why in said:
            ends = [f"{100 * (end - 1):+.0f}" for end in seen.improvement.ratio[f.joint]]
            change = f"{100 * (ratio[f.joint] - 1):+.0f} % ({' to '.join(ends)})"
            lines.append([title, seen.verdict, f.name, places(f.joints), change, why])
        if not said:
            lines.append([title, seen.verdict, *"----"])
    return lines


def places(joints):
    return "-".join(str(k + 1) for k in joints) or "arm"


def table(natural, answers):
    head = "recording | verdict | candidate | joint | held-out error of its joint | said"
    text = study.markdown(head, natural)
    lines = []
    for (arm, *_), name in itertools.product(rows(ARMS), (*INJECTED, "all", *NAMELESS)):
        names = INJECTED if name == "all" else (name,)
        some = [a for a in answers if a["arm"] == arm and a["effect"] in names]
        counts = (
            sum(a["found"] for a in some),
            sum(a["among"] and not a["found"] for a in some),
            sum(not a["named"] for a in some),
            sum(a["word"] == "unexplained" for a in some),
        )
        others = sorted({f"{n} {places(p)}" for a in some for n, p in a["others"]})
        lines.append([arm, name, len(some), *counts, ", ".join(others) or "-"])
    head = "recordings | put in | draws | right name and joint | among names that fit equally well"
    head += " | not named | told as unexplained | other names that were not there before"
    title = f"Put in at {SIZE:g} times the residual, model kept:"
    return f"{text}\n\n{title}\n\n{study.markdown(head, lines)}"


def main():
    out = Path("gap_real.json")
    args = study.arguments(__doc__, data=study.DATA, draws=30, unchanged=0, seed=1, out=out)
    if args.unchanged:
        unchanged(args.data, args.unchanged, args.seed)
        return
    natural = as_they_are(args.data)
    print(study.markdown("as they are | | | | | ", natural), flush=True)
    rng, answers = np.random.default_rng(args.seed), []
    kept = {arm: Kept(*words, args.data) for arm, *words in rows(ARMS)}
    for k, arm in itertools.product(range(args.draws), kept):
        name = (*INJECTED, *NAMELESS)[k % (len(INJECTED) + len(NAMELESS))]
        found = kept[arm].one(name, *kept[arm].drawn(name, rng))
        answers.append({"arm": arm, **found})
        args.out.write_text(json.dumps(answers))
        print(*answers[-1].values(), flush=True)
    print(table(natural, answers))


if __name__ == "__main__":
    main()
