"""Contents that must not be in the repository: leftovers, one machine's paths, hosts, recordings of others."""

from __future__ import annotations

import hashlib
import re
from fnmatch import fnmatch
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
DATA = ROOT.parent / "shared" / "data"

LARGEST = 1 << 20
"""Bytes of the largest file."""

# Written with gaps, so that this file does not find itself.
FORBIDDEN = {
    "leftover": r"\b(TO" r"DO|FIX" r"ME|XX" r"X|HA" r"CK)\b",
    "path of one machine": r"(?<![\w.])/(?:home|root|work|tmp|mnt|opt|Users|private|farm|usr/local)" r"/\w",
    "switched-off test": r"mark\." r"xfail|NotImplemented" r"Error",
    "index of packages": r"(?i)python" r"hosted|extra-index-" r"url|index-" r"url|arti" r"factory|find-" r"links",
    "address in a private network": r"\b(?:10|192\.168|172\.(?:1[6-9]|2\d|3[01]))(?:\.\d{1,3}){2,3}\b",
    "secret": r"(?i)(?:api[_-]?key|pass" r"word|secret[_-]?key)\s*[=:]\s*\S",
}

HOSTS = {
    "docs.astral.sh",
    "doi.org",
    "keepachangelog.com",
    "localhost",  # in a test of what must not be fetched
    "schemas.openxmlformats.org",  # the namespaces of workbooks
    "semver.org",
    "www.ros.org",  # the namespace of xacro
    "www.w3.org",  # the namespaces of HTML and SVG
}
"""Hosts that text may name."""


def ignored(path: Path) -> bool:
    """Tell whether .gitignore leaves a path out; its patterns are names, folders and endings."""
    parts = path.relative_to(ROOT).parts
    for line in (ROOT / ".gitignore").read_text().split():
        pattern = line.strip("/")
        if any(fnmatch(part, pattern) for part in (parts[:1] if line.startswith("/") else parts)):
            return True
    return parts[0] == ".git"


FILES = sorted(path for path in ROOT.rglob("*") if path.is_file() and not ignored(path))


def name(path: Path) -> str:
    return str(path.relative_to(ROOT))


def text_of(path: Path) -> str | None:
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None


TEXTS = {name(path): text for path in FILES if (text := text_of(path)) is not None}


def test_something_was_looked_at():
    assert {"pyproject.toml", "src/armid/errors.py", ".ci/run", "native/kernel.cpp"} <= set(TEXTS)


@pytest.mark.parametrize("what", FORBIDDEN)
def test_forbidden_words(what: str):
    pattern = re.compile(FORBIDDEN[what])
    found = {
        f"{file}:{number}": line.strip()
        for file, text in TEXTS.items()
        for number, line in enumerate(text.splitlines(), 1)
        if pattern.search(line)
    }
    assert found == {}


def test_hosts():
    found = {
        host: file for file, text in TEXTS.items() for host in re.findall(r"\bhttps?://([^/\s\"'<>)\]`:]+)", text)
    }
    assert {host: file for host, file in found.items() if host not in HOSTS} == {}


def test_no_large_files():
    assert {name(path): path.stat().st_size for path in FILES if path.stat().st_size > LARGEST} == {}


def test_no_recordings_of_others():
    if not DATA.is_dir():
        pytest.skip(f"the folder of real recordings, {DATA}, is missing")

    def digest(path: Path) -> str:
        return hashlib.sha256(path.read_bytes()).hexdigest()

    theirs = {digest(path): path.name for path in DATA.rglob("*") if path.is_file() and path.stat().st_size}
    assert {name(path): theirs[sha] for path in FILES if (sha := digest(path)) in theirs} == {}


def test_line_ends():
    """Text ends with a line end and has no carriage returns or trailing blanks; tables of numbers may."""
    fault = re.compile(r"[ \t\r]+$|[^\n]\Z", re.MULTILINE)
    bad = [file for file, text in TEXTS.items() if not file.endswith(".json") and fault.search(text)]
    assert bad == []
