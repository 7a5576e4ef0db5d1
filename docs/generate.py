"""The parts of the reference that are made from the code: codes and effects.

They stand in their pages between two comments; ``make docs`` writes them anew, as a hook of mkdocs.
"""

from pathlib import Path

from dynid.codes import codes, page
from dynid.model.effects.catalogue import CATALOGUE

BEGIN, END = "<!-- made by docs/generate.py -->\n", "\n<!-- end -->"
TOPICS = ("", "The command line", "Robot file", "Logs and results", "What the data can tell")
TOPICS += ("Safety", "The machine", "Decisions")
WHERE = {"joint": "a joint", "pair": "a joint, and another one it depends on", "arm": "the arm"}
USES = {
    ("refit", "frozen"): "found by --ask numbers and --ask changed",
    ("frozen",): "found by --ask changed only: identifying again absorbs it",
    ("arm",): "found by --ask arm: only implausible links imitate it",
}


def errors() -> list[str]:
    """Return every code of the catalogue."""
    lines, topic = [], ""
    for code in codes():
        if code[1] != topic:
            topic = code[1]
            lines += ["", f"## {TOPICS[int(topic)]}"]
        parts = page(code)
        lines += ["", f"### {code}", "", parts.pop("what"), *[""][: len(parts)]]
        for label, text in parts.items():
            escaped = text.replace("<", "&lt;").replace("*", "\\*")
            lines.append(f"- **{label}**: {escaped}")
    return lines


def effects() -> list[str]:
    """Return every torque effect of the catalogue."""
    lines = []
    for one in CATALOGUE.values():
        sizes = one.amplitudes(dict.fromkeys(one.shape_units, 1.0))
        lines += ["", f"## `{one.name}`: {one.title}", "", f"    {one.equation}", ""]
        lines.append(f"- acts on {WHERE[one.scope]}; {USES[one.uses]}")
        for label, units in (("amplitudes", sizes), ("shape", one.shape_units)):
            words = ", ".join(f"`{name}` [{unit or '1'}]" for name, unit in units.items())
            lines += [f"- {label}: {words}"] if units else []
        lines += [f"- seen as: {one.signature}", f"- to tell it from others: {one.separate}"]
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
