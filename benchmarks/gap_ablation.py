"""Each gate of the gap search switched off alone: what changes on cases of ``gap_stranger.py`` and on recordings.

    python benchmarks/gap_ablation.py --seeds 1 --cases 0-59 [--folder CASES] [--out gap_ablation.jsonl] [--table FILE.md]
    python benchmarks/gap_ablation.py --data ../shared/data      the public recordings, as they are and unchanged pairs

A gate is a condition that can refuse or accept a name or a verdict. Each case runs once with all gates, and each gate
notes whether it decided anything; only then does the case run again without that gate, because the search is
deterministic: a gate that decided nothing changes nothing. Gates that shape every fit run again on every case.
The gates are those of commit ed5053a; run it with ``PYTHONPATH`` at the ``src`` of that commit.
"""

import argparse
import json
import sys
import tempfile
import time
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import numpy as np

import gap_stranger as stranger
from dynid.gap import analysis, change, partial, search, stepwise_selection, verdict
from dynid.gap import problem as problems
from resumable import commit

Stepwise = stepwise_selection.StepwiseSelection


@contextmanager
def patched(*changes):
    """Set attributes everywhere in the search where they have been imported; (module or class, name, value)."""
    undo = []
    for owner, name, value in changes:
        old = getattr(owner, name)
        places = [owner]
        if not isinstance(owner, type):
            loaded = [m for key, m in sys.modules.items() if key.startswith("dynid.gap")]
            places = [m for m in loaded if getattr(m, name, None) is old] or [owner]
        for place in places:
            undo.append((place, name, old))
            setattr(place, name, value)
    try:
        yield
    finally:
        for place, name, old in reversed(undo):
            setattr(place, name, old)


# --- the gates ---------------------------------------------------------------------------------------------------------
# Each: name -> changes that switch it off, what is watched to know whether it decides: (place, name, function, test)

UNDETERMINED, LARGER, LITTLE = verdict.undetermined, verdict._shape_of_larger, verdict._little_explained
DIFFERS, SMALLER, MORE, STRAY = verdict._differs, verdict._not_smaller, verdict.joints_with_more, verdict.unrepeatable
PASSES, SIMPLEST, BEST = Stepwise._passes, Stepwise._simplest, Stepwise._best
SWAP, ELIMINATE, NOTE, ABSORBS = Stepwise._swap, Stepwise._eliminate, Stepwise._note_rivals, Stepwise._possible_absorbs
JUDGE, WHY_NO_PART, AS_PART = verdict.judge, partial.why_no_part, analysis._as_part
PROVING = (
    "not_new",
    "redundant_effects",
    "spoiling",
    "spoiling_replay",
    "weakly_determined",
    "better_explained_by_formula",
)
JOINTS = change.ChangeTest.joints.fget
EXPLAINED, NOISE_OF_FIT, NUISANCE = search.explained_gains, search.with_noise_of_fit, problems.nuisance_columns


def said(text):
    """Return whether a refusal says so."""
    return lambda value, *args: text in value


def undetermined_but(*, size, shape):
    """Return the test of size and shape without one of the two."""

    def test(one):
        if size and one.z < verdict.SURE_Z:
            return UNDETERMINED(one)
        for name in one.free_shape if shape else ():
            if one.shape_z(name) < (verdict.OUTSIDE if name in one.effect.nulls else verdict.SURE_Z):
                return verdict._open_shape(one, name)
        return "" if verdict.possible(one) else "no physical body has these parameters"

    return test


def passes_but(*, small=True, chance=True, score=True):
    """Return the entry to the selection without one of its conditions."""

    def test(self, one):
        tests = max(stepwise_selection.FEWEST_TESTS, len({c.key for c in self.candidates})) * one.effect.trials
        p_value = tests * max(one.test.p_value, one.test.gain_p_value)
        return bool(
            (not score or one.score > 0)
            and (not small or one.test.visible_rms >= stepwise_selection.SMALLEST)
            and (not chance or p_value < self.options.false_alarm)
        )

    return test


def best_but_unclear(self):
    """Return the strongest that passes, without waiting where the strongest of its joint is not sure."""
    balanced = self._most_plausible()
    if balanced is not None:
        return balanced
    ranked = self._ranked(self.regression, self.selected)
    if not self.visibility:
        for score, c in ranked:
            self.visibility[c.key] = max(score.visibility, self.visibility.get(c.key, 0.0))
    while True:
        clear = [(score, c) for score, c in ranked if score.score > 0]
        leading = sorted(
            (self._refined(self.regression, score, c) for score, c in clear[: stepwise_selection.RIVALS]),
            key=lambda one: -one.score,
        )
        for one in leading:
            if self._passes(one):
                if not self._possible_absorbs(one):
                    return self._simplest(one, leading)
                self.barred.add(one.key)
        if not any(one.key in self.barred for one in leading):
            return None
        ranked = [(score, c) for score, c in ranked if c.key not in self.barred]


def more_without_reversals(found):
    """Return the joints with more than noise, rows at reversals counted like others."""
    limit = verdict.NOTHING if found.problem.noise.repeats else verdict.NOTHING_UNSURE
    return tuple(np.flatnonzero(found.after > limit).tolist())


def more_as_sure(found):
    """Return the joints with more than noise, a bound taken for the noise itself."""
    above = (found.between_reversals > verdict.NOTHING) | (found.after > verdict.NOTHING**2)
    return tuple(np.flatnonzero(above).tolist())


def judge_without_closest(found, named, refused, joints):
    """Return the verdict, what was refused not counted as unexplained."""
    result = JUDGE(found, named, [], joints)
    return replace(result, closest=tuple(refused))


def changed_but(*, harm=True, halves=True, louder=True):
    """Return the test of change without one of its conditions."""

    def joints(self):
        unlike = change.BEYOND_HALVES * (self.unlike - 1) if halves else 0
        uneven = change.BEYOND_HALVES * (self.uneven - 1) if halves else 0
        grown = self.growth > 1 + np.maximum(unlike, change.LEAST_GROWTH)
        more = self.more > 1 + np.maximum(uneven, change.LEAST_MORE)
        if harm:
            grown &= self.harm > 1 + change.LEAST_HARM
        return tuple(np.flatnonzero(grown | (more & louder)).tolist())

    return property(joints)


def compare(owner, name, old, new):
    """Watch a function: the gate decides where it would answer something else without it."""
    return [(owner, name, old, lambda value, *args: tuple(np.atleast_1d(value)) != tuple(np.atleast_1d(new(*args))))]


def fires(owner, name, old, decided=lambda value, *args: bool(value)):
    """Watch a function: the gate decides where it returns something."""
    return [(owner, name, old, decided)]


def acts(name, old, of):
    """Watch a step of the selection: it decides where it changes something, as told by ``of``."""

    def step(self, *args):
        before = of(self)
        old(self, *args)
        return of(self) != before

    return [(Stepwise, name, step, lambda value, *args: value)]


#: Watched by nobody: the gate shapes every fit.
ALWAYS = ()


def keys(one):
    """Return what is selected."""
    return [each.key for each in one.selected]


def rivals(one):
    """Return the rivals of what is selected."""
    return [each.rivals for each in one.selected]


def part_limit(name, value, text):
    """Return a limit of partial names switched off."""
    return [(partial, name, value)], fires(analysis, "why_no_part", WHY_NO_PART, said(text))


NO_SIZE, NO_SHAPE = undetermined_but(size=False, shape=True), undetermined_but(size=True, shape=False)
STEPS = {name: getattr(analysis, name) for name in PROVING}
GATES = {
    "entry: visible size 0.3": ([(Stepwise, "_passes", passes_but(small=False))], compare(Stepwise, "_passes", PASSES, passes_but(small=False))),
    "entry: chance 1 %": ([(Stepwise, "_passes", passes_but(chance=False))], compare(Stepwise, "_passes", PASSES, passes_but(chance=False))),
    "entry: score above its freedom": ([(Stepwise, "_passes", passes_but(score=False))], compare(Stepwise, "_passes", PASSES, passes_but(score=False))),
    "entry: joint waits for its strongest": ([(Stepwise, "_best", best_but_unclear)], fires(Stepwise, "_passes", PASSES, lambda value, self, one: not value and one.test.visible_rms >= stepwise_selection.SMALLEST)),
    "entry: the simplest of equals": ([(Stepwise, "_simplest", lambda self, best, others: best)], fires(Stepwise, "_simplest", SIMPLEST, lambda value, self, best, others: value is not best)),
    "entry: possible links absorb it": ([(Stepwise, "_possible_absorbs", lambda self, one: False)], fires(Stepwise, "_possible_absorbs", ABSORBS)),
    "swap": ([(Stepwise, "_swap", lambda self: None)], acts("_swap", SWAP, keys)),
    "eliminate": ([(Stepwise, "_eliminate", lambda self: None)], acts("_eliminate", ELIMINATE, keys)),
    "rivals make it ambiguous": ([(Stepwise, "_note_rivals", lambda self: None)], acts("_note_rivals", NOTE, rivals)),
    "free widths of reversals": ([(problems, "nuisance_columns", lambda segment, nuisance=True: NUISANCE(segment, False))], ALWAYS),
    "explained in earlier logs": ([(search, "explained_gains", lambda *args: {})], fires(search, "explained_gains", EXPLAINED)),
    "noise measured again": ([(search, "with_noise_of_fit", lambda problem, *rest: problem)], fires(search, "with_noise_of_fit", NOISE_OF_FIT, lambda value, problem, *rest: value is not problem)),
    "size 3 standard errors": ([(verdict, "undetermined", NO_SIZE)], compare(verdict, "undetermined", UNDETERMINED, NO_SIZE)),
    "shape determined": ([(verdict, "undetermined", NO_SHAPE)], compare(verdict, "undetermined", UNDETERMINED, NO_SHAPE)),
    "differs between parts": ([(verdict, "_differs", lambda s, one: False)], fires(verdict, "_differs", DIFFERS)),
    "part of a larger one of its family": ([(verdict, "REDUNDANT", 0.0)], fires(verdict, "_shape_of_larger", LARGER, said("same kind"))),
    "trace of a larger one": ([(verdict, "TRACE", 0.0)], fires(verdict, "_shape_of_larger", LARGER, said("remainder"))),
    "held out: smaller": ([(verdict, "_not_smaller", lambda one, i: "")], fires(verdict, "_not_smaller", SMALLER)),
    "share of the gap 70, 85, 92 %": ([(verdict, "_little_explained", lambda s, e, one: "")], fires(verdict, "_little_explained", LITTLE)),
    "does not repeat": ([(verdict, "unrepeatable", lambda s: [])], fires(verdict, "unrepeatable", STRAY)),
    "delay below 0.3 samples": ([(verdict, "SAMPLING", 0.0)], fires(verdict, "refusal", verdict.refusal, lambda value, *args: value == verdict.SMALL_DELAY)),
    "partial names at all": ([(analysis, "_as_part", lambda s, e, one, why, no: why), (analysis, "with_parts", lambda p, o, found, simulate: found)],
        [*fires(analysis, "why_no_part", WHY_NO_PART, lambda *args: True), *fires(analysis, "parts_with_formulas", analysis.parts_with_formulas)]),
    "part: 5 standard errors": part_limit("SURE", 0.0, "a partial effect needs 5"),
    "part: visible 1": part_limit("VISIBLE", 0.0, "a partial effect needs 1"),
    "part: rival 0.6": part_limit("RIVAL", np.inf, "in its place explains"),
    "part: cut-off moves it 20 %": part_limit("MOVED", np.inf, "with the cut-off"),
    "part: a formula does better": part_limit("FORMULA", np.inf, "a short formula"),
    **{f"proof: {name}": ([(analysis, name, lambda *args: [])], fires(analysis, name, STEPS[name])) for name in PROVING},
    "verdict: what is refused is unexplained": ([(verdict, "judge", judge_without_closest)], fires(verdict, "judge", JUDGE, lambda value, *args: value.word != judge_without_closest(*args).word)),
    "verdict: reversals count less": ([(verdict, "joints_with_more", more_without_reversals)], compare(verdict, "joints_with_more", MORE, more_without_reversals)),
    "verdict: twice the margin without repeats": ([(verdict, "joints_with_more", more_as_sure)], compare(verdict, "joints_with_more", MORE, more_as_sure)),
    "change: harm 10 %": ([(change.ChangeTest, "joints", changed_but(harm=False))], compare(change.ChangeTest, "joints", JOINTS, changed_but(harm=False).fget)),
    "change: beyond unlike halves": ([(change.ChangeTest, "joints", changed_but(halves=False))], compare(change.ChangeTest, "joints", JOINTS, changed_but(halves=False).fget)),
    "change: new logs leave more": ([(change.ChangeTest, "joints", changed_but(louder=False))], compare(change.ChangeTest, "joints", JOINTS, changed_but(louder=False).fget)),
}  # fmt: skip


def watching(fired):
    """Return the changes that let all gates note whether they decide; those that watch one function share one call."""
    watched = {}
    for name, (_, watchers) in GATES.items():
        for owner, attribute, old, decided in watchers:
            watched.setdefault((owner, attribute), []).append((name, old, decided))

    def one_call(watchers):
        def call(*args, **more):
            value = watchers[0][1](*args, **more)
            fired.update(name for name, _, decided in watchers if decided(value, *args))
            return value

        return call

    made = {place: one_call(watchers) for place, watchers in watched.items()}
    return [(*place, property(call) if place[1] == "joints" else call) for place, call in made.items()]


def run(folder, truth, known):
    """Search one case and return what is said."""
    import dynid

    there = [folder / log["file"] for log in truth["logs"] if log["there"]]
    earlier = dynid.earlier_logs(known, there) if truth["set"] == "changed" else ()
    begun = time.process_time()
    gap = dynid.find_gap(known, there, earlier=earlier)
    facts = gap.facts()
    told = [[one["effect"], one["joints"]] for one in facts["named"]]
    return stranger.judge(truth, facts, known.delay) | {
        "verdict": facts["verdict"], "told": told, "not_repeatable": list(facts["not_repeatable"]), "seconds": time.process_time() - begun,
    }  # fmt: skip


def case_rows(folder, gates):
    """Return the rows of a case: with all gates, and without each that decided something."""
    import dynid
    from dynid.errors import DynidError

    truth = json.loads((folder / "truth.json").read_text())
    head = {key: truth[key] for key in ("seed", "case", "set", "repeats")}
    head["effects"] = [[one["name"], one["joint"], one["visible"]] for one in truth["effects"]]
    old = [log for log in truth["logs"] if (not log["there"] if truth["set"] == "changed" else log["motion"] < 2)]
    fired = set()
    try:
        known = dynid.identify(folder / "arm.yaml", [folder / log["file"] for log in old])
        with patched(*watching(fired)):
            rows = [head | {"gate": "", "fired": sorted(fired)} | run(folder, truth, known)]
        rows[0]["fired"] = sorted(fired)
    except DynidError as error:
        return [head | {"gate": "", "fired": [], "kind": "refused", "why": str(error), "wrong": [], "sizes": []}]
    for name in gates:
        if name in fired or not GATES[name][1]:
            try:
                with patched(*GATES[name][0]):
                    rows.append(head | {"gate": name} | run(folder, truth, known))
            except (DynidError, ArithmeticError, ValueError, IndexError) as error:
                rows.append(
                    head | {"gate": name, "kind": "failed", "why": repr(error), "wrong": [], "sizes": [], "told": []}
                )
    return rows


# --- recordings --------------------------------------------------------------------------------------------------------


#: Pairs of recordings that something is put into.
INJECTED_INTO = ("LWR4+ 1, 2", "UR10")


def recordings(data, pairs):
    """Yield what is asked of public recordings: a title and a function that returns what is said of it."""
    import gap_real as real

    rng, cache = np.random.default_rng([1, 7]), {}
    for title, (file, logs) in real.AS_THEY_ARE.items():
        yield f"{title} as it is", lambda title=title, file=file, logs=logs: as_it_is(real, data, title, file, logs)
    arms = [arm for arm, _ in zip(real.itertools.cycle(real.SAME_ARM), range(pairs), strict=False)]
    for k, arm in enumerate(arms):
        file, logs = real.SAME_ARM[arm]
        first, second = real.drawn_pair(logs, rng)
        title = f"{arm} unchanged {k}"
        yield title, lambda file=file, first=first, second=second: unchanged(real, data, file, first, second)
    for arm in INJECTED_INTO:
        for name in (*real.INJECTED, *real.NAMELESS):
            yield f"{arm} with {name}", lambda arm=arm, name=name: injected(real, data, arm, name, cache)


def as_it_is(real, data, title, file, logs):
    """Return what is said of recordings that nothing was put into."""
    robot = real.load_robot(file)
    model = real.build_model(replace(robot, coupling=None) if "left out" in title else robot)
    seen = real.look([real.read(data / log, robot) for log in logs], real.BaseModel(model, real.reduce(model)), None)
    return spoken(seen.verdict)


def unchanged(real, data, file, first, second):
    """Return what is said of two recordings between which nothing was changed."""
    robot = real.load_robot(file)
    model = real.build_model(robot)
    base = real.BaseModel(model, real.reduce(model))
    source = real.source_of(real.read(data / first, robot), model)
    known = real.identified([source], base)
    return spoken(real.look([real.read(data / second, robot)], base, known, source).verdict)


def injected(real, data, arm, name, cache):
    """Return what is said of a recording that something was put into, and whether that is right."""
    rng = np.random.default_rng([3, len(arm), len(name)])
    joint, sign = real.drawn(name, arm, data, cache, rng)
    row = real.one(arm, name, joint, sign, data, cache)
    return {"word": row["word"], "named": row["named"], "found": row["found"], "others": row["others"]}


def spoken(said_):
    """Return verdict and names."""
    return {"word": said_.word, "named": [[one.name, list(one.joints)] for one in said_.named]}


def run_recordings(args):
    """Run the recordings that are not there yet, with all gates and without each that decides."""
    rows = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {row["title"] for row in rows}
    for title, ask in recordings(args.data, args.pairs):
        if title in done:
            continue
        fired = set()
        with patched():
            ask()  # what is kept of an arm is made with all gates
        with patched(*watching(fired)):
            new = [{"title": title, "gate": "", "fired": sorted(fired)} | ask()]
        new[0]["fired"] = sorted(fired)
        for name in GATES:
            if name in fired or not GATES[name][1]:
                try:
                    with patched(*GATES[name][0]):
                        new.append({"title": title, "gate": name} | ask())
                except (ArithmeticError, ValueError, IndexError) as error:
                    new.append({"title": title, "gate": name, "word": "failed", "named": [], "why": repr(error)})
        with args.out.open("a") as file:
            file.writelines(json.dumps(row, default=float) + "\n" for row in new)
        rows += new
        moved = [row["gate"] for row in new[1:] if (row["word"], row["named"]) != (new[0]["word"], new[0]["named"])]
        print(f"{title}: {new[0]['word']} {new[0]['named']}  {len(new) - 1} again; {'; '.join(moved)}", flush=True)
    return recordings_table(rows)


def recordings_table(rows):
    """Return what each gate changes on recordings, as Markdown."""
    base = {row["title"]: row for row in rows if not row["gate"]}
    lines = ["| without | decided in | answers changed | which |", "|---|---|---|---|"]

    def text(row):
        names = ", ".join(f"{name} {'-'.join(str(j + 1) for j in joints) or 'arm'}" for name, joints in row["named"])
        return names or row["word"]

    for name in GATES:
        own = [row for row in rows if row["gate"] == name]
        moved = [row for row in own if text(row) != text(base[row["title"]])]
        decided = sum(name in row["fired"] or not GATES[name][1] for row in base.values())
        which = "; ".join(f"{row['title']}: {text(base[row['title']])} -> {text(row)}" for row in moved)
        lines.append(f"| {name} | {decided} | {len(moved)} | {which or '-'} |")
    return "\n".join([f"{len(base)} questions.", "", *lines])


# --- tables ------------------------------------------------------------------------------------------------------------


def rates(rows):
    """Return hits and numbers of the rates that count, by name."""

    def big(name, low, high=99.0):
        return [row for row in rows if row["set"] == name and row["effects"] and low <= stranger.smallest(row) < high]

    def count(chosen, good):
        return sum(map(good, chosen)), len(chosen)

    clean = [row for row in rows if row["set"] == "clean" or (row["set"] == "changed" and not row["effects"])]
    outside = [row for row in rows if row["set"] == "outside"]
    sizes = [each[-1] for row in rows for each in row["sizes"]]
    return {
        "single >= 1": count(big("single", 1), lambda row: row["kind"] == "exact"),
        "single 0.5 to 1": count(big("single", 0.5, 1), lambda row: row["kind"] == "exact"),
        "double >= 0.5": count(big("double", 0.5), lambda row: row["kind"] == "exact"),
        "changed >= 0.5": count(big("changed", 0.5), lambda row: row["kind"] == "exact"),
        "clean: nothing": count(clean, lambda row: row["kind"] == "nothing"),
        "outside: something": count(outside, lambda row: row["kind"] == "something"),
        "cases with a wrong name": count(rows, lambda row: bool(row["wrong"])),
        "sizes inside": (sum(sizes), len(sizes)),
    }


def table(rows):
    """Return the rates with all gates, and what each gate changes, as Markdown."""
    base = {(row["seed"], row["case"]): row for row in rows if not row["gate"]}
    first = rates(list(base.values()))
    lines = ["| rate | all gates |", "|---|---|", *(f"| {k} | {stranger.wilson(*v)} |" for k, v in first.items()), ""]
    lines += ["| without | decided in | answers changed | " + " | ".join(first) + " |", "|---" * (3 + len(first)) + "|"]
    ordered = []
    for name in GATES:
        own = {(row["seed"], row["case"]): row for row in rows if row["gate"] == name}
        decided = sum(name in row["fired"] or not GATES[name][1] for row in base.values())
        now = rates([own.get(key, row) for key, row in base.items()])
        different = sum(
            (row["kind"], sorted(map(str, row.get("told", ())))) != (base[key]["kind"], sorted(map(str, base[key].get("told", ()))))
            for key, row in own.items()
        )  # fmt: skip
        cells = []
        for key, (hits, of) in now.items():
            before = first[key][0]
            cells.append(f"{hits - before:+d} of {of}" if (hits, of) != first[key] else "=")
        ordered.append((different, f"| {name} | {decided} | {different} | " + " | ".join(cells) + " |"))
    return "\n".join([*lines, *(line for _, line in sorted(ordered, key=lambda pair: -pair[0]))])


def main():
    """Run the cases that are not there yet, and print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1")
    parser.add_argument("--cases", default="0-59")
    parser.add_argument("--gates", nargs="*", help="some gates only, by part of their name")
    parser.add_argument("--folder", type=Path, default=Path(tempfile.gettempdir()) / "gap_stranger")
    parser.add_argument("--out", type=Path, default=Path("gap_ablation.jsonl"))
    parser.add_argument("--table", type=Path)
    parser.add_argument("--data", type=Path, help="folder of public recordings: these instead of cases")
    parser.add_argument("--pairs", type=int, default=12, help="of recordings that nothing was changed between")
    args = parser.parse_args()
    if args.data:
        print(run_recordings(args))
        return
    rows = [json.loads(line) for line in args.out.read_text().splitlines()] if args.out.exists() else []
    done = {(row["seed"], row["case"]) for row in rows if not row["gate"]}
    gates = [name for name in GATES if args.gates is None or any(part in name for part in args.gates)]
    print(f"seeds {args.seeds}, cases {args.cases}, code {commit()}", flush=True)
    for seed in stranger.numbers(args.seeds):
        for k in stranger.numbers(args.cases):
            if (seed, k) in done:
                continue
            folder = args.folder / f"{seed}" / f"{k:03d}"
            if not (folder / "truth.json").exists():
                stranger.make_case(folder, seed, k)
            new = case_rows(folder, gates)
            rows += new
            with args.out.open("a") as file:
                file.writelines(json.dumps(row, default=float) + "\n" for row in new)
            moved = [
                f"{r['gate']}: {r['kind']}"
                for r in new[1:]
                if (r["kind"], r.get("told")) != (new[0]["kind"], new[0].get("told"))
            ]
            print(
                f"{seed}/{k:02d} {new[0]['set']:8} {new[0]['kind']}  {len(new) - 1} again; {'; '.join(moved)}",
                flush=True,
            )
    print(table(rows))
    if args.table:
        args.table.write_text(table(rows) + "\n")


if __name__ == "__main__":
    main()
