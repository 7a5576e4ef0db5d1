"""The catalogue as a page: ``docs/reference/effects.md`` is made from the effect classes and never written by hand."""

from __future__ import annotations

from dynid.model.effects.catalogue import CATALOGUE
from dynid.model.effects.interface import Effect

HEAD = """# Torque effects

Made from the effect classes by `python -m dynid.model.effects.page`; a test says when it is out of date.

`tau_rb` is the rigid-body torque of the current model, `sign` the Coulomb sign of the robot file, `j` the joint.
Amplitudes enter linearly and are identified again whenever the robot file is; shape parameters stay as they were found.
"""

WHERE = {"joint": "a joint", "pair": "a joint, and another one it depends on", "arm": "the whole arm"}
USES = {
    ("refit", "frozen"): "found by refit and by frozen search",
    ("frozen",): "found by frozen search: identifying again absorbs it",
}


def page() -> str:
    """Return the page as Markdown."""
    return "\n".join([HEAD, *(_section(effect) for effect in CATALOGUE.values())])


def _section(effect: Effect) -> str:
    shape = dict.fromkeys(effect.shape_units, 1.0)
    amplitudes = ", ".join(f"`{name}` [{unit or '1'}]" for name, unit in effect.amplitudes(shape).items())
    lines = [
        f"## `{effect.name}`: {effect.title}",
        "",
        f"    {effect.equation}",
        "",
        f"- acts on {WHERE[effect.scope]}; {USES[effect.uses]}",
        f"- amplitudes: {amplitudes}",
    ]
    if effect.shape_units:
        lines.append("- shape: " + ", ".join(f"`{name}` [{unit or '1'}]" for name, unit in effect.shape_units.items()))
    lines += [f"- seen as: {effect.signature}", f"- to tell it from others: {effect.separate}", ""]
    return "\n".join(lines)


if __name__ == "__main__":
    import sys

    sys.stdout.write(page())
