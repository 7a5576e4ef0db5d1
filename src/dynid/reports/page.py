"""report.html: all sections in one file that needs no network, and the summary for a pull request.

Templates hold the words of a section and call the functions that draw its figures, which take the page's text colour
and font, in the light and in the dark.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dynid.estimation.identified import USED
from dynid.estimation.residual_model import GROUP_NAMES
from dynid.model.effects.catalogue import CATALOGUE
from dynid.reports import figures, gap_figures, section_figures
from dynid.reports.gathered import Gathered
from dynid.robot import LINK_PARAMETERS
from dynid.table import ROUNDING, with_error
from dynid.text import html, markdown, printable, shell

if TYPE_CHECKING:
    from jinja2 import Environment
    from markupsafe import Markup
    from matplotlib.figure import Figure

#: Headings in the order of the page, by name in links, which is that of the template too.
SECTIONS = {
    "verdict": "Verdict",
    "next": "What to do next",
    "run": "What was run",
    "quality": "Data quality",
    "excitation": "Excitation",
    "parameters": "Parameters",
    "torque": "Measured and predicted torque",
    "validation": "Validation",
    "residual": "Where the residual is",
    "gap": "Missing effects",
    "physics": "Physically consistent links",
    "limits": "Limits of this result",
}
#: Stands for the page's text colour until the figure is written.
INK = "#010203"
#: What the page shows for the colours of figures; the style sheet has lighter ones for the dark.
_SHOWN = {
    INK: "currentColor",
    figures.GRID: "var(--faint)",
    figures.MEASURED: "var(--measured)",
    figures.ESTIMATED: "var(--estimated)",
    figures.RESIDUAL: "var(--residual)",
}
_OF_TEXT = ("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color")
_OF_PAPER = ("figure.facecolor", "axes.facecolor", "savefig.facecolor", "legend.facecolor")


def page(gathered: Gathered) -> str:
    """Return the page of what was gathered."""
    return _rendered("page.html", gathered)


def summary(gathered: Gathered) -> str:
    """Return a compact Markdown summary for a pull request."""
    return _rendered("summary.md", gathered)


def _rendered(name: str, gathered: Gathered) -> str:
    facts = {"found": gathered.result, "robot": gathered.robot, "sections": SECTIONS}
    return templates().get_template(name).render(facts, gathered=gathered)


def templates() -> Environment:
    """Return the templates of pages: every text is escaped, drawings are dynid's own, the style sheet is at hand."""
    from jinja2 import Environment, PackageLoader, StrictUndefined
    from markupsafe import Markup

    environment = Environment(
        loader=PackageLoader("dynid.reports"),
        autoescape=True,
        undefined=StrictUndefined,
        finalize=_shown,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {"markdown": markdown, "short": "{:.3g}".format}
    environment.globals |= {
        "zip": zip,
        "shell": shell,
        "drawn": drawn,
        "figures": figures,
        "section_figures": section_figures,
        "gap_figures": gap_figures,
        "with_error": with_error,
        "rounding": ROUNDING,
        "catalogue": CATALOGUE,
        "groups": GROUP_NAMES,
        "kinds": LINK_PARAMETERS,
        "used": USED,
        "style": Markup(environment.get_template("style.css").render()),
    }
    return environment


def _shown(value: Any) -> Any:  # noqa: ANN401
    """Return what a template shows of a value: text without control characters, markup of our own as it is."""
    return printable(value) if isinstance(value, str) and not hasattr(value, "__html__") else value


def drawn(label: str, draw: Callable[..., Figure], *what: Any) -> Markup:  # noqa: ANN401
    """Return a figure as an SVG element that fills the width it is given.

    Args:
        label: what it shows, for those who cannot see it; no other figure of the page has the same.
        draw: draws it.
        what: its arguments.
    """
    from markupsafe import Markup
    from matplotlib import rc_context

    stream = io.StringIO()
    style = dict.fromkeys(_OF_TEXT, INK) | dict.fromkeys(_OF_PAPER, "none")
    with rc_context(style):  # type: ignore[arg-type]
        figures.save(draw(*what), stream, "svg", salt=label)
    text = stream.getvalue()
    head, rest = text[text.index("<svg") :].split(">", 1)
    box = re.search(r'viewBox="[^"]*"', head)
    assert box is not None
    used = set(re.findall(r'(?:url\(|href=")#([^)"]+)', rest))
    # Why: names of groups are the same in every figure, and ids must be unique on a page.
    rest = re.sub(r' id="([^"]+)"', lambda match: match[0] if match[1] in used else "", rest)
    for color, shown in _SHOWN.items():
        rest = rest.replace(color, shown)
    # A hundredth of a point is finer than a screen.
    rest = re.sub(r"(\.\d\d)\d{3,}", r"\1", rest)
    rest = re.sub(r"font: ([0-9.]+)px [^;\"]*", r"font-size: \1px; font-family: inherit", rest)
    return Markup(
        f'<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" '
        f'{box[0]} role="img" aria-label="{html(label)}">{rest}'
    )
