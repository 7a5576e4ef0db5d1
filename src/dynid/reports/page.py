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
from dynid.reports.templating import rendered
from dynid.robot import LINK_PARAMETERS
from dynid.table import ROUNDING, with_error

if TYPE_CHECKING:
    from markupsafe import Markup
    from matplotlib.figure import Figure


def page(gathered: Gathered) -> str:
    """Return the page of what was gathered."""
    return _told("page.html", gathered)


def summary(gathered: Gathered) -> str:
    """Return a compact Markdown summary for a pull request."""
    return _told("summary.md", gathered)


def _told(name: str, gathered: Gathered) -> str:
    return rendered(
        name,
        found=gathered.result,
        robot=gathered.robot,
        gathered=gathered,
        drawn=drawn,
        figures=figures,
        section_figures=section_figures,
        gap_figures=gap_figures,
        with_error=with_error,
        rounding=ROUNDING,
        catalogue=CATALOGUE,
        groups=GROUP_NAMES,
        kinds=LINK_PARAMETERS,
        used=USED,
    )


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
