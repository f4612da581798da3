"""Names with markup in descriptions and files appear on pages as text, and run nothing."""

from __future__ import annotations

import json
import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path
from xml.sax.saxutils import quoteattr

import pytest

from armid.cli.main import main
from browser import browser, needs_chromium
from labs import URDF, small_recording, write_recording

MARKUP = "</script><img src=x onerror=alert(1)><!--'\"&amp;{{7*7}}"
"""Text that leaves a script, makes an element that runs a program, and opens a comment."""

FILE = "a<img src=x onerror=alert(2)>'\"&amp;.csv"


class Elements(HTMLParser):
    """Elements of a page, handlers of events in their attributes, and texts of JSON islands."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.tags: list[str] = []
        self.handlers: list[str] = []
        self.islands: list[str] = []
        self.inside = False
        self.feed(page)
        self.close()

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        self.handlers += [name for name, _ in attrs if name.startswith("on")]
        self.inside = tag == "script" and ("type", "application/json") in attrs
        if self.inside:
            self.islands.append("")

    def handle_data(self, data: str) -> None:
        if self.inside:
            self.islands[-1] += data

    def handle_endtag(self, tag: str) -> None:
        self.inside = False


POLICY = re.compile(r'<meta http-equiv="Content-Security-Policy" content="([^"]*)">')


def assert_harmless(path: Path) -> None:
    page = path.read_text(encoding="utf-8")
    assert page.index("Content-Security-Policy") < page.index("<title>")
    policy = unescape(*POLICY.findall(page))
    assert "default-src 'none'" in policy and "unsafe-eval" not in policy and "http" not in policy
    scripts = policy.partition("script-src ")[2].partition(";")[0]
    assert "unsafe-inline" not in scripts and "sha256-" in scripts
    found = Elements(page)
    assert "img" not in found.tags and not found.handlers
    for island in found.islands:
        json.loads(island)
    assert found.islands and "{{7*7}}" in page


@pytest.fixture(scope="module")
def arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with an arm whose names are markup, and a recording of it whose file name is markup."""
    folder = tmp_path_factory.mktemp("markup")
    text = URDF.replace('"small"', quoteattr(MARKUP))
    for name in ("joint_1", "joint_2", "link_1", "link_3"):
        text = text.replace(f'"{name}"', quoteattr(MARKUP + name))
    (folder / "arm.urdf").write_text(text)
    write_recording(small_recording(1), folder / FILE)
    return folder


def run(folder: Path, monkeypatch: pytest.MonkeyPatch, *arguments: str) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit) as ended:
        main(list(arguments))
    assert ended.value.code in (0, 1, None)


def test_pages_show_names_as_text(arm: Path, monkeypatch: pytest.MonkeyPatch):
    run(arm, monkeypatch, "preview", "arm.urdf", FILE, "--out", "preview.html")
    assert_harmless(arm / "preview.html")
    run(arm, monkeypatch, "identify", "arm.urdf", FILE, "--out", "run")
    run(arm, monkeypatch, "report", "run")
    assert_harmless(arm / "run" / "report.html")
    run(arm, monkeypatch, "preview", "run", "--out", "run.html")
    assert_harmless(arm / "run.html")


def test_plots_keep_markup_as_text():
    from armid.report.plots.encoding import embedded

    text = embedded({"name": MARKUP})
    assert "</" not in text and "<!--" not in text and json.loads(text)["name"] == MARKUP


@needs_chromium
def test_a_browser_runs_the_scripts_of_the_page_and_no_other(arm: Path, monkeypatch: pytest.MonkeyPatch):
    run(arm, monkeypatch, "preview", "arm.urdf", FILE, "--out", "preview.html")
    run(arm, monkeypatch, "identify", "arm.urdf", FILE, "--out", "looked")
    run(arm, monkeypatch, "report", "looked")
    added = (
        "<script>window.ran = 'script'</script><img src='x' onerror='window.ran = 1'>"
        "<svg onload='window.ran = 2'></svg><iframe srcdoc='<script>parent.ran = 3</script>'></iframe>"
        "<a id='link' href='javascript:window.ran = 4'>x</a>"
        "<img src='http://localhost:9/beacon'><base href='http://localhost:9/'>"
    )
    with browser() as chromium:
        for name in ("preview.html", "looked/report.html"):
            page = (arm / name).read_text(encoding="utf-8")
            tab = chromium.open(arm / name, mark="still")
            tab.wait("document.documentElement.dataset.drawn")
            assert [words for words in tab.said if "GL Driver Message" not in words] == []
            attacked = arm / f"{Path(name).stem}-attacked.html"
            attacked.write_text(page.replace("</main>", f"</main>{added}"), encoding="utf-8")
            tab = chromium.open(attacked, mark="still")
            tab.wait("document.documentElement.dataset.drawn")  # its own scripts ran
            tab.run("document.getElementById('link').click()")
            tab.run("new Promise((done) => setTimeout(done, 300))")
            assert tab.run("window.ran === undefined")
            refused = [words for words in tab.said if "Content Security Policy" in words]
            assert any("/beacon" in words for words in refused) and any("inline script" in words for words in refused)
