"""Formulas of ``dynid gap`` on what its catalogue does not hold: laws that can be written down, nothing, and what cannot.

    python benchmarks/gap_formulas.py --out gap_formulas.json [--seed 1] [--minutes 30] [--table benchmarks/gap_formulas.md]

A law is drawn as an engineer would describe an odd drive: something of a place or a load, times something of speed or
time, often times something of a neighbour, with phases and scales at random. Nothing of dynid is used for that. Laws of
``physics`` come from a second generator, which asks for a cause, the speeds that it acts with, and what makes it grow. The
search was developed with seeds 0 and 1; the table comes from others.
"""

import time
from itertools import count

import numpy as np

import gap_blind as blind
import hidden_effects as hidden
from dynid.gap.analysis import analyse_gap
from dynid.gap.formulas import held_out_squares
from dynid.gap.stepwise_selection import SelectionOptions
from resumable import parser_of, run_cases

SETS = ("law", "clean", "unfit", "physics")
#: What no short formula fits: rings after reversals, contacts, a sensor that wanders, narrow bumps, play, wrong geometry.
UNFIT = ("ringing", "contacts", "wandering", "bumps", "stuck", "geometry")


def place(rng, j):
    """Draw a function of a place or a load and how it reads."""
    kind = rng.choice(["wave", "phase", "load", "sum", "limit"], p=[0.35, 0.2, 0.25, 0.1, 0.1])
    h, where = int(rng.integers(1, 5)), j + int(rng.choice([0, 0, 0, -1, 1]))
    if kind == "wave":
        turn = np.pi / 2 * rng.integers(2)
        return lambda q, rigid: np.sin(h * q[:, where] + turn), f"{'cos' if turn else 'sin'}({h} q{where + 1})"
    if kind == "phase":
        turn = rng.uniform(0, 2 * np.pi)
        return lambda q, rigid: np.cos(h * q[:, where] + turn), f"cos({h} q{where + 1} + {turn:.2f})"
    if kind == "load":
        return lambda q, rigid: rigid[:, where], f"load{where + 1}"
    if kind == "sum":
        other = j + int(rng.choice([-1, 1]))
        return lambda q, rigid: np.sin(h * (q[:, j] + q[:, other])), f"sin({h} q{j + 1} + {h} q{other + 1})"
    share = rng.uniform(0.2, 0.6)

    def limited(q, rigid):
        top = share * np.abs(rigid[:, j]).max()
        return np.clip(rigid[:, j], -top, top)

    return limited, f"limited load{j + 1}"


def rate(rng, j):
    """Draw a function of speed, acceleration or time and how it reads."""
    kind = rng.choice(["v", "|v|", "v^2", "v|v|", "sign", "a", "t"], p=[0.22, 0.22, 0.16, 0.14, 0.1, 0.08, 0.08])
    k = j + int(rng.choice([0, 0, 0, -1, 1]))
    laws = {
        "v": lambda t, v, a: v[:, k], "|v|": lambda t, v, a: np.abs(v[:, k]), "v^2": lambda t, v, a: v[:, k] ** 2,
        "v|v|": lambda t, v, a: v[:, k] * np.abs(v[:, k]), "sign": lambda t, v, a: np.tanh(v[:, k] / 0.003),
        "a": lambda t, v, a: a[:, k], "t": lambda t, v, a: t / 60,
    }  # fmt: skip
    return laws[kind], f"{kind.replace('v', f'v{k + 1}').replace('a', f'a{k + 1}')}" if kind not in ("t", "sign") else (
        "t" if kind == "t" else f"sign(v{k + 1})"
    )


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
        f"sin(q{j + 1})": lambda q, g: np.sin(q[:, j]), f"cos(q{j + 1})": lambda q, g: np.cos(q[:, j]),
        f"sin(q{k + 1})": lambda q, g: np.sin(q[:, k]), f"cos(2 q{j + 1})": lambda q, g: np.cos(2 * q[:, j]),
        f"cos(q{j + 1} + q{k + 1})": lambda q, g: np.cos(q[:, j] + q[:, k]), f"load{j + 1}": lambda q, g: g[:, j],
        f"load{k + 1}": lambda q, g: g[:, k], "": lambda q, g: np.ones(len(q)),
    }  # fmt: skip
    speeds = {
        f"v{j + 1}": lambda t, v, a: v[:, j], f"v{j + 1}|v{j + 1}|": lambda t, v, a: v[:, j] * np.abs(v[:, j]),
        f"v{k + 1}^2": lambda t, v, a: v[:, k] ** 2, f"v{j + 1}^2": lambda t, v, a: v[:, j] ** 2,
        f"|v{k + 1}|": lambda t, v, a: np.abs(v[:, k]), f"a{j + 1}": lambda t, v, a: a[:, j],
        f"a{k + 1}": lambda t, v, a: a[:, k],
    }  # fmt: skip
    grows = {
        "": lambda t, v, a: np.ones(len(t)), "t": lambda t, v, a: t / 60, f"|v{j + 1}|": lambda t, v, a: np.abs(v[:, j]),
        f"|v{k + 1}|": lambda t, v, a: np.abs(v[:, k]), f"sign(v{k + 1})": lambda t, v, a: hidden.sharp(v[:, k]),
    }  # fmt: skip
    odds = [0.5, 0.14, 0.12, 0.12, 0.12]
    words = str(rng.choice(list(causes))), str(rng.choice(list(speeds))), str(rng.choice(list(grows), p=odds))
    return words, tuple(table[word] for table, word in zip((causes, speeds, grows), words, strict=True))


def bumps(rng, j):
    """Return narrow bumps at random places of the joint's travel."""
    at, height = rng.uniform(-1.2, 1.2, 4), rng.normal(size=4)
    return lambda t, q, v, acc, rigid: (height * np.exp(-(((q[:, j, None] - q[:, j].mean() - at) / 0.05) ** 2))).sum(
        axis=1
    )


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
        return hidden.Case(arm, "torque_offset", joint, 0.0, number, hidden.DECOYS[k % len(hidden.DECOYS)]), "nothing"
    if name == "law":
        law, text = draw_law(rng, joint)
        return hidden.Case(arm, "law", joint, size, number, law=law), text
    if name == "physics":
        law, text = draw_physics(rng, joint)
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
        found.append((t, q, tau + np.stack([np.convolve(x, kernel, "same") for x in change.T], axis=1)))
    return found


def run(name, k, seed):
    case, text = draw(name, k, seed)
    base = blind.model_of(case.arm)
    hide = name != "clean" and text != "geometry"
    logs = hidden.simulate(case, hide=hide)
    if text == "geometry":
        logs = with_wrong_links(logs, case.arm, np.random.default_rng(case.seed))
    start = time.process_time()
    seen = analyse_gap(blind.sources_of(logs, base.model), base, None, SelectionOptions(), simulate=False)
    seconds = time.process_time() - start
    row = {
        "set": name, "k": k, "seed": seed, "arm": case.arm, "joint": case.joint, "size": case.size, "hidden": text,
        "verdict": seen.verdict.word, "named": [[f.name, list(f.joints)] for f in seen.verdict.named],
        "remainder": list(seen.verdict.remainder), "seconds": seconds, "chi": seen.search.before.round(2).tolist(),
        "formulas": [[f.joints[0], f.effect.text, f.values, f.std_errors] for f in seen.wording.formulas],
        "clues": [[c.joint, c.signal, c.share, c.repeats, c.near] for c in seen.wording.clues],
    }  # fmt: skip
    if name in ("law", "physics") and (row["formulas"] or row["named"]):
        row["closed"] = closed(seen, case, base)
    return row


def closed(seen, case, base):
    """Return the share of what knowing the truth closes of the held-out error that the formula closes, on its joint."""
    first = blind.make_problem(
        blind.on_one_clock(blind.sources_of(hidden.simulate(case, hide=False), base.model)), base, None
    )
    rms = []
    for problem, effects in (
        (seen.problem, []), (seen.search.problem, [*seen.search.selected, *seen.wording.formulas]), (first, []),
    ):  # fmt: skip
        squares, count = held_out_squares(problem, effects)[case.joint].sum(axis=1)
        rms.append(squares / count)
    return float((rms[0] - rms[1]) / max(rms[0] - rms[2], 1e-12))


def table(rows):
    lines = [
        "| set | cases | seen | formula | on the hidden joint | closes 80 % of what the truth closes | a name does |",
        "|---" * 7 + "|",
    ]
    for name in SETS:
        some = [r for r in rows if r["set"] == name]
        if not some:
            continue
        seen = [r for r in some if r["verdict"] != "nothing_missing"]
        told = [r for r in some if r["formulas"]]
        right = [r for r in told if r["formulas"][0][0] == r["joint"]]
        good = [r for r in some if r.get("closed", 0) >= 0.8]
        by_name = [r for r in good if not r["formulas"]]
        last = (
            f"{len(right)} | {len(good) - len(by_name)} | {len(by_name)}" if name in ("law", "physics") else "- | - | -"
        )
        lines.append(f"| {name} | {len(some)} | {len(seen)} | {len(told)} | {last} |")
    seconds = np.array([r["seconds"] for r in rows])
    lines += ["", f"Processor time a case: median {np.median(seconds):.1f} s, longest {seconds.max():.1f} s.", ""]
    lines += ["| set | hidden | size | said | formula or what came nearest | closed |", "|---|---|---|---|---|---|"]
    for r in rows:
        if r["set"] == "clean" and not r["formulas"]:
            continue
        text = "; ".join(f"joint {j + 1}: {text}" for j, text, *_ in r["formulas"]) or "; ".join(
            f"joint {j + 1} follows {signal} ({100 * share:.0f} %) {near}" for j, signal, share, _, near in r["clues"]
        )
        said = ", ".join([r["verdict"], *(name for name, _ in r["named"])])
        share = f"{r['closed']:.2f}" if "closed" in r else "-"
        what = f"{r['hidden']} on joint {r['joint'] + 1}".replace("|", "\\|")
        lines.append(
            f"| {r['set']} | {what} | {r['size']:.1f} | {said} | {text.replace('|', chr(92) + '|')} | {share} |"
        )
    return "\n".join(lines)


def line(row):
    return (
        f"{row['set']:6} {row['k']:3} {row['hidden']} on {row['joint'] + 1} size {row['size']:.1f} -> {row['verdict']} {row['named']} "
        f"{[x[:2] for x in row['formulas']]} closed {row.get('closed', '-')} {row['clues']} {row['seconds']:.1f} s"
    )


def main():
    parser = parser_of(__doc__, "gap_formulas.json", 30.0, 60)
    parser.add_argument("--only", choices=SETS)
    args = parser.parse_args()
    cases = ((args.only or SETS[number % 4], number if args.only else number // 4) for number in count())
    run_cases(args, cases, run, line, table)


if __name__ == "__main__":
    main()
