"""Rendering of pages: templates, styles and scripts of this package, and the packages that it takes."""

from __future__ import annotations

import re
from importlib.resources import files
from importlib.util import find_spec
from typing import TYPE_CHECKING

from armid.errors import MissingExtraError

if TYPE_CHECKING:
    from jinja2 import Environment

__all__ = ["environment", "require_extra", "text_of"]

PACKAGES = ("jinja2", "plotly")
"""What a page with plots needs."""


def require_extra(*names: str) -> None:
    """Refuse to go on without the packages that a page needs, by default those of a page with plots.

    Raises:
        MissingExtraError: One is not installed.
    """
    for name in names or PACKAGES:
        if find_spec(name) is None:
            raise MissingExtraError(name, "A report page", "report")


def environment() -> Environment:
    """Templates, which escape what is put into them and refuse what is not there."""
    from jinja2 import Environment, PackageLoader, StrictUndefined

    made = Environment(
        loader=PackageLoader("armid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    made.filters["coded"] = _coded
    return made


def _coded(text: str) -> str:
    """Text as HTML, what stands in backticks as code."""
    from markupsafe import Markup, escape

    parts = re.split("`([^`]+)`", text)
    return Markup("").join(Markup("<code>{}</code>").format(p) if k % 2 else escape(p) for k, p in enumerate(parts))


def text_of(name: str) -> str:
    """A style or script of the templates."""
    return (files("armid.report") / "templates" / name).read_text(encoding="utf-8")
