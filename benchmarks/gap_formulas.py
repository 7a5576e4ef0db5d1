"""Formulas of ``dynid gap`` on what its catalogue does not hold: laws that can be written down, nothing, and what cannot.

    python benchmarks/gap_formulas.py --out gap_formulas.json [--seed 1] [--minutes 30] [--table benchmarks/gap_formulas.md]

A ``law`` is drawn as an engineer would describe an odd drive: something of a place or a load, times something of speed or
time, often times something of a neighbour, with phases and scales at random. Laws of ``physics`` come from a second generator,
which asks for a cause, the speeds that it acts with, and what makes it grow; those of ``drives`` are the mechanisms of
``odd_laws.py``. Nothing of dynid is used for any. Whether a product of three terms of the library can say a law is looked at
when it is drawn: *said* is the share of what the model cannot absorb of it that the best product explains.
"""

import time
from dataclasses import replace
from itertools import count

import numpy as np

import gap_blind as blind
import hidden_effects as hidden
import odd_laws
from dynid.gap.analysis import analyse_gap
from dynid.gap.formula_rows import FactorRows
from dynid.gap.formulas import held_out_squares, leading
from dynid.gap.significance import whitened_columns
from dynid.gap.stepwise_selection import SelectionOptions
from dynid.model.effects.interface import Effect
from resumable import parser_of, run_cases

SETS = ("law", "clean", "unfit", "physics", "drives")
#: Sets in which a law is hidden, and the share of it from which on a product says it.
LAWS, SAID = ("law", "physics", "drives"), 0.9
#: Share of what knowing the truth closes that is asked for.
CLOSED = 0.8
#: What no short formula fits: rings after reversals, contacts, a sensor that wanders, narrow bumps, play, wrong geometry.
UNFIT = ("ringing", "contacts", "wandering", "bumps", "stuck", "geometry")


def place(rng, j):
    """Draw a function of a place or a load and how it reads."""
    kind = rng.choice(["wave", "phase", "load", "sum", "limit"], p=[0.35, 0.2, 0.25, 0.1, 0.1])
    h, where = int(rng.integers(1, 5)), j + int(rng.choice([0, 0, 0, -1, 1]))
    if kind == "wave":
        turn = np.pi / 2 * rng.integers(2)
        return lambda q, rigid: np.sin(
            h * q[:, where] + turn
        ), f"{'cos' if turn else 'sin'}({h} q{where + 1})"
    if kind == "phase":
        turn = rng.uniform(0, 2 * np.pi)
        return lambda q, rigid: np.cos(
            h * q[:, where] + turn
        ), f"cos({h} q{where + 1} + {turn:.2f})"
    if kind == "load":
        return lambda q, rigid: rigid[:, where], f"load{where + 1}"
    if kind == "sum":
        other = j + int(rng.choice([-1, 1]))
        return lambda q, rigid: np.sin(
            h * (q[:, j] + q[:, other])
        ), f"sin({h} q{j + 1} + {h} q{other + 1})"
    share = rng.uniform(0.2, 0.6)

    def limited(q, rigid):
        top = share * np.abs(rigid[:, j]).max()
        return np.clip(rigid[:, j], -top, top)

    return limited, f"limited load{j + 1}"


def rate(rng, j):
    """Draw a function of speed, acceleration or time and how it reads."""
    kind = rng.choice(
        ["v", "|v|", "v^2", "v|v|", "sign", "a", "t"], p=[0.22, 0.22, 0.16, 0.14, 0.1, 0.08, 0.08]
    )
    k = j + int(rng.choice([0, 0, 0, -1, 1]))
    laws = {
        "v": lambda t, v, a: v[:, k],
        "|v|": lambda t, v, a: np.abs(v[:, k]),
        "v^2": lambda t, v, a: v[:, k] ** 2,
        "v|v|": lambda t, v, a: v[:, k] * np.abs(v[:, k]),
        "sign": lambda t, v, a: np.tanh(v[:, k] / 0.003),
        "a": lambda t, v, a: a[:, k],
        "t": lambda t, v, a: t / 60,
    }
    return laws[
        kind
    ], f"{kind.replace('v', f'v{k + 1}').replace('a', f'a{k + 1}')}" if kind not in (
        "t",
        "sign",
    ) else ("t" if kind == "t" else f"sign(v{k + 1})")


def draw_law(rng, j):
    """Return a law that no effect of the catalogue is, and how it reads."""
    while True:
        a, first = place(rng, j)
        b, second = rate(rng, j)
        three = rng.random() < 0.5
        c, third = rate(rng, j) if three else (lambda t, v, a: 1.0, "")
        words = sorted(filter(None, (second, third)))
        # Why: friction of load or place, a sign that squares, a time that is squared, and gravity's own have names.
        known = words in ([f"sign(v{j + 1})"], [f"|v{j + 1}|"]) and "load" in first
        known |= words == [f"sign(v{j + 1})"] or (three and second == third) or words == ["t"]
        if not known:
            return product(a, b, c), " ".join([first, *words])


def product(a, b, c):
    return lambda t, q, v, acc, rigid: a(q, rigid) * b(t, v, acc) * c(t, v, acc)


def draw_physics(rng, j):
    """Return a law as one who knows machines but not the search would think of it, and how it reads.

    A cause (gravity's angle, a neighbour's angle, the load, or none), the speeds that it acts with, and often something that
    makes it grow: warming up, another speed, a direction.
    """
    while True:
        words, laws = physics(rng, j, j + int(rng.choice([-1, 1])))
        first, second, third = words
        # Why: what inertia and Coriolis torques of links are, or what has a name, is no odd law.
        inertial = not third and "load" not in first and (second[0] == "a" or second.endswith("^2"))
        plain = not third and (not first or second == f"v{j + 1}")
        if not inertial and not plain:
            return product(*laws), " ".join(word for word in words if word)


def physics(rng, j, k):
    """Draw a cause, speeds and growth at joint j and its neighbour k: how they read, and as functions."""
    causes = {
        f"sin(q{j + 1})": lambda q, g: np.sin(q[:, j]),
        f"cos(q{j + 1})": lambda q, g: np.cos(q[:, j]),
        f"sin(q{k + 1})": lambda q, g: np.sin(q[:, k]),
        f"cos(2 q{j + 1})": lambda q, g: np.cos(2 * q[:, j]),
        f"cos(q{j + 1} + q{k + 1})": lambda q, g: np.cos(q[:, j] + q[:, k]),
        f"load{j + 1}": lambda q, g: g[:, j],
        f"load{k + 1}": lambda q, g: g[:, k],
        "": lambda q, g: np.ones(len(q)),
    }
    speeds = {
        f"v{j + 1}": lambda t, v, a: v[:, j],
        f"v{j + 1}|v{j + 1}|": lambda t, v, a: v[:, j] * np.abs(v[:, j]),
        f"v{k + 1}^2": lambda t, v, a: v[:, k] ** 2,
        f"v{j + 1}^2": lambda t, v, a: v[:, j] ** 2,
        f"|v{k + 1}|": lambda t, v, a: np.abs(v[:, k]),
        f"a{j + 1}": lambda t, v, a: a[:, j],
        f"a{k + 1}": lambda t, v, a: a[:, k],
    }
    grows = {
        "": lambda t, v, a: np.ones(len(t)),
        "t": lambda t, v, a: t / 60,
        f"|v{j + 1}|": lambda t, v, a: np.abs(v[:, j]),
        f"|v{k + 1}|": lambda t, v, a: np.abs(v[:, k]),
        f"sign(v{k + 1})": lambda t, v, a: hidden.sharp(v[:, k]),
    }
    odds = [0.5, 0.14, 0.12, 0.12, 0.12]
    words = (
        str(rng.choice(list(causes))),
        str(rng.choice(list(speeds))),
        str(rng.choice(list(grows), p=odds)),
    )
    return words, tuple(
        table[word] for table, word in zip((causes, speeds, grows), words, strict=True)
    )


def bumps(rng, j):
    """Return narrow bumps at random places of the joint's travel."""
    at, height = rng.uniform(-1.2, 1.2, 4), rng.normal(size=4)
    return lambda t, q, v, acc, rigid: (
        height * np.exp(-(((q[:, j, None] - q[:, j].mean() - at) / 0.05) ** 2))
    ).sum(axis=1)


def stuck(rng, j):
    """Return friction that is larger in some seconds than in others."""
    edges, size = np.sort(rng.uniform(0, 150, 12)), rng.normal(size=13)
    return lambda t, q, v, acc, rigid: size[np.searchsorted(edges, t)] * np.tanh(v[:, j] / 0.003)


def draw(name, k, seed):
    """Return the case of a set, how it reads, and the error of the geometry [m]."""
    rng = np.random.default_rng([k, SETS.index(name), seed])
    arm = "lwr4plus" if rng.random() < 0.6 else "kinova_gen2"
    joint, size = int(rng.choice(blind.JOINTS)), float(np.exp(rng.uniform(np.log(1.5), np.log(6))))
    number = 20_000 + 131 * k + 1_000_003 * seed + SETS.index(name)
    if name == "clean":
        return hidden.Case(
            arm, "torque_offset", joint, 0.0, number, hidden.DECOYS[k % len(hidden.DECOYS)]
        ), "nothing"
    if name == "law":
        law, text = draw_law(rng, joint)
        return hidden.Case(arm, "law", joint, size, number, law=law), text
    if name in ("physics", "drives"):
        law, text = draw_physics(rng, joint) if name == "physics" else odd_laws.draw(rng, joint)
        return hidden.Case(arm, "law", joint, size, number, law=law), text
    text = UNFIT[k % len(UNFIT)]
    law = {"bumps": bumps, "stuck": stuck}.get(text)
    case = hidden.Case(arm, text, joint, size, number, law=law(rng, joint) if law else None)
    return case, text


def with_wrong_links(logs, arm, rng):
    """Return logs whose torques are those of links 6 mm longer or shorter, with the joints' own friction."""
    truth, wrong = hidden.load_arm(arm), hidden.load_arm(arm)
    for k in range(1, wrong.n + 1):
        placement = wrong.model.jointPlacements[k]
        placement.translation = placement.translation + 0.006 * rng.normal(size=3)
        wrong.model.jointPlacements[k] = placement
    wrong.data = wrong.model.createData()
    found = []
    for t, q, tau in logs:
        step = t[1] - t[0]
        speed = np.gradient(q, step, axis=0)
        acceleration = np.gradient(speed, step, axis=0)
        change = wrong.torque(q, speed, acceleration) - truth.torque(q, speed, acceleration)
        kernel = np.hanning(21) / np.hanning(21).sum()
        found.append(
            (t, q, tau + np.stack([np.convolve(x, kernel, "same") for x in change.T], axis=1))
        )
    return found


def run(name, k, seed):
    case, text = draw(name, k, seed)
    base = blind.model_of(case.arm)
    hide = name != "clean" and text != "geometry"
    logs = hidden.simulate(case, hide=hide)
    if text == "geometry":
        logs = with_wrong_links(logs, case.arm, np.random.default_rng(case.seed))
    start = time.process_time()
    seen = analyse_gap(
        blind.sources_of(logs, base.model), base, None, SelectionOptions(), simulate=False
    )
    seconds = time.process_time() - start
    row = {
        "set": name,
        "k": k,
        "seed": seed,
        "arm": case.arm,
        "joint": case.joint,
        "size": case.size,
        "hidden": text,
        "verdict": seen.verdict.word,
        "named": [[f.name, list(f.joints)] for f in seen.verdict.named],
        "remainder": list(seen.verdict.remainder),
        "seconds": seconds,
        "chi": seen.search.before.round(2).tolist(),
        "formulas": [
            [f.joints[0], f.effect.text, f.values, f.std_errors]
            for f in seen.formula_results.formulas
        ],
        "clues": [
            [c.joint, c.signal, c.share, c.repeats, c.near] for c in seen.formula_results.clues
        ],
    }
    if name in LAWS:
        bare = blind.on_one_clock(blind.sources_of(hidden.simulate(case, hide=False), base.model))
        without = blind.make_problem(bare, base, None)
        row["said"], row["product"] = said(without, case)
        row["closed"] = closed(seen, case, without) if row["formulas"] or row["named"] else 0.0
    return row


class Hidden(Effect):
    """The torque that was hidden, as a column of its own."""

    name = title = equation = signature = separate = "hidden"

    def __init__(self, law):
        self.law = law

    def amplitudes(self, shape):
        return {"a": "N m"}

    def columns(self, motion, joints, shape):
        return self.law(motion.t, motion.q, motion.qd, motion.qdd, motion.rigid)[None, None]


def said(without, case):
    """Return which share of what the model cannot absorb of a law the best product of the library explains, and which."""
    # Why all rows: what says a law only where it was fitted does not say it.
    whole = replace(without, train=[np.ones(len(s), dtype=bool) for s in without.segments])
    regression = whole.regression()
    column = whitened_columns(regression, Hidden(case.law), (case.joint,), [{}])[case.joint][0, 0]
    Q = regression.basis(case.joint)
    left = column - Q @ (Q.T @ column)
    # Why so large: a price of freedom must not count.
    left *= 1e4 / np.linalg.norm(left)
    e = [left if j == case.joint else each for j, each in enumerate(regression.fit.e)]
    regression.__dict__["fit"] = replace(regression.fit, e=e)
    rows = FactorRows(regression, case.joint)
    rows.screen(regression)
    best = max(leading(regression, rows), key=lambda one: one.score)
    return float(best.gains.sum()) / 1e8, " + ".join(best.terms)


def closed(seen, case, first):
    """Return the share of what knowing the truth closes of the held-out error that the formula closes, on its joint.

    Args:
        seen: the analysis.
        case: what was hidden.
        first: the same motion and noise without it.
    """
    rms = []
    for problem, effects in (
        (seen.problem, []),
        (seen.search.problem, [*seen.search.selected, *seen.formula_results.formulas]),
        (first, []),
    ):
        squares, count = held_out_squares(problem, effects)[case.joint].sum(axis=1)
        rms.append(squares / count)
    return float((rms[0] - rms[1]) / max(rms[0] - rms[2], 1e-12))


def table(rows):
    lines = [
        "| set | cases | seen | formula | closes 80 % of what the truth closes | a name does "
        "| seen, and a product says it | a formula closes 80 % | a name does |",
        "|---" * 9 + "|",
    ]
    for name in SETS:
        some = [r for r in rows if r["set"] == name]
        if not some:
            continue
        seen = [r for r in some if r["verdict"] != "nothing_missing"]
        told = [r for r in some if r["formulas"]]
        numbers = [len(some), len(seen), len(told)]
        if name in LAWS:
            can = [r for r in seen if r["said"] >= SAID]
            numbers += [*closing(some), len(can), *closing(can)]
        lines.append(
            f"| {name} | " + " | ".join(map(str, numbers)) + " |" + " - |" * (8 - len(numbers))
        )
    seconds = np.array([r["seconds"] for r in rows])
    lines += [
        "",
        f"Processor time a case: median {np.median(seconds):.1f} s, longest {seconds.max():.1f} s.",
        "",
    ]
    lines += [
        "| set | hidden | size | a product says | said | formula or what came nearest | closed |",
        "|---" * 7 + "|",
    ]
    for r in rows:
        if r["set"] == "clean" and not r["formulas"]:
            continue
        text = "; ".join(f"joint {j + 1}: {text}" for j, text, *_ in r["formulas"]) or "; ".join(
            f"joint {j + 1} follows {signal} ({100 * share:.0f} %) {near}"
            for j, signal, share, _, near in r["clues"]
        )
        verdict = ", ".join([r["verdict"], *(name for name, _ in r["named"])])
        shares = [f"{r[key]:.2f}" if key in r else "-" for key in ("said", "closed")]
        what = f"{r['hidden']} on joint {r['joint'] + 1}".replace("|", "\\|")
        text = text.replace("|", "\\|")
        lines.append(
            f"| {r['set']} | {what} | {r['size']:.1f} | {shares[0]} | {verdict} | {text} | {shares[1]} |"
        )
    return "\n".join(lines)


def closing(rows):
    """Return how many of some cases a formula closes, and how many a name."""
    good = [r for r in rows if r["closed"] >= CLOSED]
    return len([r for r in good if r["formulas"]]), len([r for r in good if not r["formulas"]])


def line(row):
    return (
        f"{row['set']:6} {row['k']:3} {row['hidden']} on {row['joint'] + 1} size {row['size']:.1f} -> {row['verdict']} {row['named']} "
        f"{[x[:2] for x in row['formulas']]} said {row.get('said', '-')} {row.get('product', '')} closed {row.get('closed', '-')} "
        f"chi {row['chi'][row['joint']]} {row['clues']} {row['seconds']:.1f} s"
    )


def main():
    parser = parser_of(__doc__, "gap_formulas.json", 30.0, 60)
    parser.add_argument(
        "--only", choices=SETS, nargs="+", default=SETS, help="the sets that are drawn from in turn"
    )
    args = parser.parse_args()
    cases = ((args.only[number % len(args.only)], number // len(args.only)) for number in count())
    run_cases(args, cases, run, line, table)


if __name__ == "__main__":
    main()
