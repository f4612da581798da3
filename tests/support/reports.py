"""A run of the small arm with its recordings beside it, and what a page's HTML holds, for the tests of reports."""

from __future__ import annotations

import json
from dataclasses import dataclass, field, replace
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from armid.runs.run import Run, load_run, save_run
from armid.study.config import load_study
from armid.study.identify import identify
from labs import write_recordings, write_study

VOID = {"meta", "wbr", "link", "br", "img", "input", "path", "line", "circle", "rect"}


def make_run(folder: Path, method: str = "wls") -> Run:
    """A run in `folder / "run"`, its study and recordings in `folder`."""
    write_recordings(folder)
    study = load_study(write_study(folder))
    result = identify(replace(study, estimation=replace(study.estimation, method=method)))
    return load_run(save_run(result, folder / "run"))


@dataclass
class Page(HTMLParser):
    """Content of a page. Parsing fails where elements are not closed in order."""

    text: str
    words: list[str] = field(default_factory=list)
    headings: list[int] = field(default_factory=list)
    identities: list[str] = field(default_factory=list)
    fetched: list[str] = field(default_factory=list)
    elements: list[tuple[str, dict[str, str | None]]] = field(default_factory=list)
    open: list[str] = field(default_factory=list)
    scripts: dict[str, str] = field(default_factory=dict)

    def __post_init__(self) -> None:
        super().__init__(convert_charrefs=True)
        self.feed(self.text)
        self.close()
        assert self.open == []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        found = dict(attrs)
        self.elements.append((tag, found))
        self.identities += [str(found["id"])] if "id" in found else []
        self.fetched += [str(found[name]) for name in ("src", "href", "data", "poster", "action") if name in found]
        if tag in ("h1", "h2", "h3"):
            self.headings.append(int(tag[1]))
        if tag not in VOID:
            self.open.append(tag + (f"#{found['id']}" if tag == "script" and "id" in found else ""))

    def handle_endtag(self, tag: str) -> None:
        if tag not in VOID:
            last = self.open.pop()
            assert last.split("#")[0] == tag, f"</{tag}> closes <{last}>"

    def handle_data(self, data: str) -> None:
        inside = self.open[-1] if self.open else ""
        if inside.startswith("script#"):
            self.scripts[inside.partition("#")[2]] = data
        elif inside not in ("script", "style"):
            self.words.append(data)

    @property
    def prose(self) -> str:
        """All that is shown, blanks made one."""
        return " ".join(" ".join(self.words).split())

    @property
    def data(self) -> dict[str, Any]:
        """Plots and tables for the page's script."""
        return json.loads(self.scripts["page-data"])
