"""Completion in a shell: names from catalogues, and joints and links of the arm on the command line.

The user waits for the completion, so no heavy module is imported. Names of criteria and limits are copied here, and a
contract test compares the copies with the catalogues. Names of joints and links are extracted from the text of a
description, without building a robot.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import tomllib
import zipfile
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path

import armid
from armid.cli.folder_overview import DESCRIPTIONS
from armid.model.catalogue import TERMS

CRITERIA = ("d-optimal", "condition", "scaled-condition", "a-optimal", "e-optimal", "prediction", "worst")
"""Criteria for the design of a motion."""

KINDS = ("position", "velocity", "acceleration", "jerk", "effort")
"""Kinds of limits of a joint."""

ARMS = Path(armid.__file__).parent / "robot" / "arms"

MAX_CHARACTERS = 20_000_000
"""Largest number of characters searched in a description; descriptions without meshes are shorter."""

COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
JOINT = re.compile(r"<joint\b([^>]*)>")
LINK = re.compile(r"<(?:link|body|site)\b([^>]*)>")
NAME = re.compile(r"""\bname\s*=\s*["']([^"'$]+)["']""")
NOT_MOVING = re.compile(r"""\btype\s*=\s*["'](?:fixed|free)["']""")


def known_arms(incomplete: str) -> list[str]:
    """Built-in arms and descriptions in this folder that begin with a text; if none do, the shell completes files."""
    files = (path.name for path in Path().iterdir() if path.suffix in DESCRIPTIONS)
    return sorted(
        name for name in chain((path.stem for path in ARMS.glob("*.toml")), files) if name.startswith(incomplete)
    )


def among(names: Iterable[str]) -> Callable[[str], list[str]]:
    """Makes a completion function that returns those of `names` that begin with the typed text."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def terms(incomplete: str) -> list[str]:
    """Completions of a comma-separated list of torque terms; `auto` is offered only as the first entry."""
    prefix, comma, start = incomplete.rpartition(",")
    used = set(prefix.split(","))
    names = ("default", *TERMS) if comma else ("auto", "default", *TERMS)
    return [prefix + comma + name for name in names if name.startswith(start) and name not in used]


def joints(incomplete: str) -> list[str]:
    """Completions of a comma-separated list of moving joints of the arm that the command line names."""
    prefix, comma, start = incomplete.rpartition(",")
    used = set(prefix.split(","))
    return [prefix + comma + name for name in _names(_joints) if name.startswith(start) and name not in used]


def limits(incomplete: str) -> list[str]:
    """Texts `JOINT.KIND=` that begin with `incomplete`, for the joints of the arm that the command line names."""
    every = (f"{name}.{kind}=" for name in _names(_joints) for kind in KINDS)
    return [each for each in every if each.startswith(incomplete)]


def links(incomplete: str) -> list[str]:
    """Links, bodies and sites that begin with `incomplete`, of the arm that the command line names."""
    return [name for name in _names(_links) if name.startswith(incomplete)]


def moving_links(incomplete: str) -> list[str]:
    """Moving links that begin with `incomplete`, of the arm of the run that the command line names."""
    for word in _words():
        path = Path(word).expanduser() / "robot.npz"
        try:
            text = zipfile.ZipFile(path).read("value.json.npy")
            names = [str(link["name"]) for link in json.loads(text[text.index(b'{"type"') :])["value"]["links"]]
        except (OSError, ValueError, KeyError, TypeError, zipfile.BadZipFile):  # a shell shows nothing
            continue
        return [name for name in names if name.startswith(incomplete)]
    return []


def _names(find: Callable[[Path, str], list[str]]) -> list[str]:
    """Names that `find` returns for the description of the arm on the command line; empty without a description."""
    for path in _descriptions(_words()):
        try:
            with path.open(encoding="utf-8") as stream:
                names = find(path, stream.read(MAX_CHARACTERS))
        except (OSError, ValueError):  # a shell shows nothing rather than an error
            continue
        if names:
            return list(dict.fromkeys(names))
    return []


def _words() -> list[str]:
    """Words of the command line so far, from the variables that the shell sets.

    These variables are used because the parser drops the arguments while the value of an option is missing.
    """
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    try:
        return shlex.split(line)
    except ValueError:  # a quote that is still open
        return line.split()


def _descriptions(words: Iterable[str]) -> Iterable[Path]:
    """Files of the descriptions that the words name: a built-in arm, a description, or a study with a description."""
    for word in words:
        if (ARMS / f"{word}.toml").is_file():
            yield ARMS / f"{word}.toml"
        elif (path := Path(word).expanduser()).suffix in (*DESCRIPTIONS, ".toml") and path.is_file():
            yield from _of_study(path)


def _of_study(path: Path) -> Iterable[Path]:
    """The given path, or, if it is the path of a study, the path of the description that the study names."""
    if path.suffix == ".toml":
        try:
            description = tomllib.loads(path.read_text(encoding="utf-8")).get("robot", {}).get("description")
        except (OSError, ValueError, AttributeError):
            description = None
        if isinstance(description, str):
            built_in = ARMS / f"{description}.toml"
            yield built_in if built_in.is_file() else path.parent / description
            return
    yield path


def _joints(path: Path, text: str) -> list[str]:
    """Names of the moving joints in the text of a description."""
    if path.suffix == ".toml":
        rows = tomllib.loads(text).get("joint", [])
        return [str(row.get("name", f"joint_{k}")) for k, row in enumerate(rows, 1)]
    joints = JOINT.findall(COMMENT.sub("", text))
    return [
        name[1] for attributes in joints if not NOT_MOVING.search(attributes) and (name := NAME.search(attributes))
    ]


def _links(path: Path, text: str) -> list[str]:
    """Names of URDF links or MJCF bodies and sites; empty for a DH table, whose links have no names."""
    if path.suffix == ".toml":
        return []
    return [name[1] for attributes in LINK.findall(COMMENT.sub("", text)) if (name := NAME.search(attributes))]
