"""The parts of the reference that are made from the code: codes and effects.

They stand in their pages between two comments; ``make docs`` writes them anew, as a hook of mkdocs.
"""

from collections import Counter
from pathlib import Path

from dynid.codes import codes, page
from dynid.model.effects.catalogue import CATALOGUE

BEGIN, END = "<!-- made by docs/generate.py -->\n", "\n<!-- end -->"
TOPICS = ("", "The command line", "Robot file", "Logs and results", "What the data can tell")
TOPICS += ("Safety", "The machine", "Decisions")
#: What is said of an effect that is not as most are: where it acts, and which question finds it.
WHERE = {"pair": "acts on a joint and depends on another one", "arm": "acts on the whole arm"}
USES = {
    ("frozen",): "found by --ask changed only: a new fit absorbs it",
    ("arm",): "found by --ask arm: only implausible links imitate it",
}


def errors() -> list[str]:
    """Return every code of the catalogue; an exit status is given where it is not the usual one of the topic."""
    lines, pages = [], {code: page(code) for code in codes()}
    for topic, title in enumerate(TOPICS):
        here = {code: parts for code, parts in pages.items() if code[1] == str(topic)}
        exits = Counter(parts["exit"] for parts in here.values() if "exit" in parts)
        if not exits:
            continue
        usual = exits.most_common(1)[0][0]
        lines += ["", f"## {title}", "", f"Exit status {usual}, unless noted."]
        for code, parts in here.items():
            what, fix = parts["what"], ""
            if "exit" in parts:
                what = f"{what.rstrip('.')}; {parts['why']}."
                fix = parts["fix"].replace("<", "&lt;").replace("*", "\\*")
                noted = f" Exit status {parts['exit'][0]}." if parts["exit"] != usual else ""
                fix = f" **Fix**: {fix}.{noted}"
            lines += ["", f"### {code}", "", what + fix]
    return lines


def effects() -> list[str]:
    """Return every torque effect of the catalogue."""
    lines = []
    for one in CATALOGUE.values():
        sizes = one.amplitudes(dict.fromkeys(one.shape_units, 1.0))
        lines += ["", f"## `{one.name}`: {one.title}", "", f"    {one.equation}", ""]
        sized = [
            f"{label} " + ", ".join(f"`{name}` [{unit or '1'}]" for name, unit in units.items())
            for label, units in (("amplitudes", sizes), ("shape", one.shape_units))
            if units
        ]
        unlike = [text for text in (WHERE.get(one.scope), USES.get(one.uses)) if text]
        lines += [f"- {'; '.join(sized + unlike)}"]
        lines += [f"- residual: {one.signature}. Separated by: {one.separate}"]
    return lines


def on_pre_build(config: object = None) -> None:
    """Write the pages whose part is not what the code says."""
    for name, lines in {
        "errors": errors(),
        "effects": effects(),
    }.items():
        path = Path(__file__).parent / "reference" / f"{name}.md"
        before = path.read_text(encoding="utf-8")
        head, rest = before.split(BEGIN)
        text = head + BEGIN + "\n".join(lines) + END + rest.split(END)[1]
        if text != before:
            path.write_text(text, encoding="utf-8")
