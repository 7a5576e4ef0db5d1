"""report.html: all sections in one file that needs no network, and the summary for a pull request.

Templates hold the words of a section and call the functions that draw its figures.
"""

from __future__ import annotations

import io
from base64 import b64encode
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from dynid.estimation.identified import USED
from dynid.estimation.residual_model import GROUP_NAMES
from dynid.model.effects.catalogue import CATALOGUE
from dynid.reports import figures, gap_figures, section_figures
from dynid.reports.gathered import Gathered
from dynid.robot import LINK_PARAMETERS
from dynid.table import ROUNDING, with_error
from dynid.text import markdown, printable, shell

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
    """Return a figure as a picture that fills the width it is given, as SVG inside the page.

    Args:
        label: what it shows, for those who cannot see it.
        draw: draws it.
        what: its arguments.
    """
    from markupsafe import Markup

    stream = io.BytesIO()
    figures.save(draw(*what), stream, "svg")
    content = b64encode(stream.getvalue()).decode()
    return Markup('<img src="data:image/svg+xml;base64,{}" alt="{}">').format(content, label)
