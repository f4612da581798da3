"""Completion in a shell: names from catalogues, and joints and links of the arm on the line.

A shell waits for each key, so nothing heavy is loaded: names of catalogues stand here, which a contract test compares
with them, and names of an arm are picked from the text of its description without reading it as a robot.
"""

from __future__ import annotations

import os
import re
import shlex
import tomllib
from collections.abc import Callable, Iterable
from itertools import chain
from pathlib import Path

import armid
from armid.cli.next_step import DESCRIPTIONS

__all__ = [
    "CRITERIA",
    "EXPORTS",
    "METHODS",
    "TERMS",
    "among",
    "joints",
    "known_arms",
    "limits",
    "links",
    "terms",
]

METHODS = ("wls", "physical", "ridge", "robust", "ols", "essential", "log-cholesky", "thesis-nlp")
"""Methods of estimation, the most used first."""

TERMS = (
    "rigid-body",
    "viscous",
    "coulomb",
    "offset",
    "rotor-inertia",
    "coupling",
    "asymmetric-coulomb",
    "asymmetric-viscous",
    "stribeck",
    "power-viscous",
    "sigmoid",
    "piecewise-viscous",
    "hysteresis",
    "ripple",
    "load-coulomb",
    "load-viscous",
)
"""Torque terms."""

CRITERIA = ("d-optimal", "condition", "scaled-condition", "a-optimal", "e-optimal", "prediction", "worst")
"""Criteria of a designed motion."""

EXPORTS = ("urdf", "mjcf", "sdf", "c", "cpp", "matlab", "python", "julia")
"""Formats of robot descriptions and languages of code."""

KINDS = ("position", "velocity", "acceleration", "jerk", "effort")
"""Kinds of limits of a joint."""

ARMS = Path(armid.__file__).parent / "robot" / "arms"

LARGEST = 20_000_000
"""Characters of a description that are looked through: more than any arm has without its meshes."""

COMMENT = re.compile(r"<!--.*?-->", re.DOTALL)
JOINT = re.compile(r"<joint\b([^>]*)>")
LINK = re.compile(r"<(?:link|body|site)\b([^>]*)>")
NAME = re.compile(r"""\bname\s*=\s*["']([^"'$]+)["']""")
STILL = re.compile(r"""\btype\s*=\s*["'](?:fixed|free)["']""")


def known_arms(incomplete: str) -> list[str]:
    """Built-in arms and descriptions in this folder that begin so; where none does, shells go on with files."""
    files = (path.name for path in Path().iterdir() if path.suffix in DESCRIPTIONS)
    return sorted(
        name for name in chain((path.stem for path in ARMS.glob("*.toml")), files) if name.startswith(incomplete)
    )


def among(names: Iterable[str]) -> Callable[[str], list[str]]:
    """A completion with one of these names."""

    def complete(incomplete: str) -> list[str]:
        return [name for name in names if name.startswith(incomplete)]

    return complete


def terms(incomplete: str) -> list[str]:
    """Torque terms behind those that are there already, with commas between; first of all `auto`."""
    done, comma, begun = incomplete.rpartition(",")
    used = set(done.split(","))
    names = TERMS if comma else ("auto", *TERMS)
    return [done + comma + name for name in names if name.startswith(begun) and name not in used]


def joints(incomplete: str) -> list[str]:
    """Moving joints of the arm that the command line names, behind commas too."""
    done, comma, begun = incomplete.rpartition(",")
    used = set(done.split(","))
    return [done + comma + name for name in _names(_joints) if name.startswith(begun) and name not in used]


def limits(incomplete: str) -> list[str]:
    """`JOINT.KIND=` for the arm's joints."""
    every = (f"{name}.{kind}=" for name in _names(_joints) for kind in KINDS)
    return [each for each in every if each.startswith(incomplete)]


def links(incomplete: str) -> list[str]:
    """Links, bodies and sites of the arm."""
    return [name for name in _names(_links) if name.startswith(incomplete)]


def _names(find: Callable[[Path, str], list[str]]) -> list[str]:
    """Names in the description of the arm on the command line; none where there is none that can be read."""
    for path in _descriptions(_words()):
        try:
            with path.open(encoding="utf-8") as stream:
                found = find(path, stream.read(LARGEST))
        except (OSError, ValueError):  # a shell shows nothing rather than an error
            continue
        if found:
            return list(dict.fromkeys(found))
    return []


def _words() -> list[str]:
    """The command line so far, as the shell hands it over.

    A parser that meets an option without its value, which is what is being completed, forgets the arguments.
    """
    line = os.environ.get("COMP_WORDS") or os.environ.get("_TYPER_COMPLETE_ARGS") or ""
    try:
        return shlex.split(line)
    except ValueError:  # a quote that is still open
        return line.split()


def _descriptions(words: Iterable[str]) -> Iterable[Path]:
    """Files that words name: a built-in arm, a description, or the one of a study."""
    for word in words:
        if (ARMS / f"{word}.toml").is_file():
            yield ARMS / f"{word}.toml"
        elif (path := Path(word).expanduser()).suffix in (*DESCRIPTIONS, ".toml") and path.is_file():
            yield from _of_study(path)


def _of_study(path: Path) -> Iterable[Path]:
    """The file, or where it is a study the description that it names."""
    if path.suffix == ".toml":
        try:
            said = tomllib.loads(path.read_text(encoding="utf-8")).get("robot", {}).get("description")
        except (OSError, ValueError, AttributeError):
            said = None
        if isinstance(said, str):
            built_in = ARMS / f"{said}.toml"
            yield built_in if built_in.is_file() else path.parent / said
            return
    yield path


def _joints(path: Path, text: str) -> list[str]:
    """Joints that move."""
    if path.suffix == ".toml":
        rows = tomllib.loads(text).get("joint", [])
        return [str(row.get("name", f"joint_{k}")) for k, row in enumerate(rows, 1)]
    written = JOINT.findall(COMMENT.sub("", text))
    return [name[1] for attributes in written if not STILL.search(attributes) and (name := NAME.search(attributes))]


def _links(path: Path, text: str) -> list[str]:
    """Links of URDF, bodies and sites of MJCF; a DH table has none with a name."""
    if path.suffix == ".toml":
        return []
    return [name[1] for attributes in LINK.findall(COMMENT.sub("", text)) if (name := NAME.search(attributes))]
