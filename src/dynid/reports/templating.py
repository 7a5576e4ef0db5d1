"""Templates of pages and other texts: every text is escaped, drawings are dynid's own, the style sheet is at hand."""

from __future__ import annotations

from typing import Any

from dynid.text import markdown, printable, shell


def rendered(name: str, **known: Any) -> str:  # noqa: ANN401
    """Return the text of a template, which knows some things by name in all its parts."""
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
    environment.globals |= {"zip": zip, "shell": shell, **known}
    environment.globals["style"] = Markup(environment.get_template("style.css").render())
    return environment.get_template(name).render()


def _shown(value: Any) -> Any:  # noqa: ANN401
    """Return what a template shows of a value: text without control characters, markup of our own as it is."""
    return printable(value) if isinstance(value, str) and not hasattr(value, "__html__") else value
