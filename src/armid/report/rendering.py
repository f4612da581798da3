"""Rendering of pages: templates, styles and scripts of this package, and the optional packages needed."""

from __future__ import annotations

import base64
import hashlib
import re
from functools import cache
from importlib.resources import files
from importlib.util import find_spec
from typing import TYPE_CHECKING

from armid.errors import MissingExtraError

if TYPE_CHECKING:
    from jinja2 import Environment

PACKAGES = ("jinja2", "plotly")
"""Packages that a page with plots needs."""

INLINE = 40
"""Largest number of characters of code in a sentence; longer code is shown as a block."""


def require_extra(*names: str) -> None:
    """Checks that the packages that a page needs are installed; by default those of a page with plots.

    Raises:
        MissingExtraError: A package is not installed.
    """
    for name in names or PACKAGES:
        if find_spec(name) is None:
            raise MissingExtraError(name, "A report page", "report")


def security_policy(*scripts: str) -> str:
    """Content security policy of a page: no other script than these runs, and nothing is fetched or sent.

    Args:
        scripts: Text of each script element, and of each script that a script of the page adds.
    """
    digests = (hashlib.sha256(script.encode()).digest() for script in scripts)
    hashes = " ".join(f"'sha256-{base64.b64encode(digest).decode()}'" for digest in digests)
    return (
        f"default-src 'none'; script-src {hashes}; style-src 'unsafe-inline'; img-src data: blob:; "
        "base-uri 'none'; form-action 'none'"
    )


@cache
def environment() -> Environment:
    """Jinja environment that escapes inserted text and raises an error for undefined names.

    All pages of a process share it, because it keeps compiled templates, and compiling takes longer than rendering.
    """
    from jinja2 import Environment, PackageLoader, StrictUndefined

    jinja = Environment(
        loader=PackageLoader("armid.report"),
        autoescape=True,
        undefined=StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    jinja.filters["coded"] = _coded
    jinja.filters["breakable"] = _breakable
    return jinja


def _breakable(name: str) -> str:
    """Name as HTML in which a line break is possible after a separator, but not inside a word."""
    from markupsafe import Markup, escape

    return Markup(re.sub(r"(?<=[_.])(?=[^_.])", "<wbr>", str(escape(name))))


def _coded(text: str) -> str:
    """Text as HTML, in which text in backticks is code; long code or code with several lines is a scrolling block."""
    from markupsafe import Markup, escape

    inline, block = Markup("<code>{}</code>"), Markup('<pre tabindex="0"><code>{}</code></pre>')
    parts = re.split("`([^`]+)`", text)
    return Markup("").join(
        (block if "\n" in part or len(part) > INLINE else inline).format(part) if k % 2 else escape(part)
        for k, part in enumerate(parts)
    )


def text_of(name: str) -> str:
    """Text of a style sheet or script in the templates folder."""
    return (files("armid.report") / "templates" / name).read_text(encoding="utf-8")
