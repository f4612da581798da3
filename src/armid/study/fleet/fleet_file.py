"""Fleet file: the units of one type of arm and their recordings, as a file `FLEET.toml` contains them.

The tables `[robot]`, `[model]` and `[processing]` are those of a `study.toml` and hold for all units, as do the keys
of a recording in `[reading]`. Each `[[unit]]` has a name and recordings. Paths are relative to the folder of the
file.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armid.errors import StudyError, did_you_mean
from armid.input_boundary import boundary, naming, read_toml
from armid.study.config import Study, parse_study

KEYS = ("robot", "model", "processing", "reading", "unit")
"""Tables of a fleet file."""

UNIT_KEYS = ("name", "recordings", "validate", "recording")
"""Keys of a table `[[unit]]`."""

NAME = re.compile(r"\w([\w.-]*[\w-])?")
"""Form of the name of a unit, which is also the name of a folder."""


@dataclass(frozen=True, eq=False, slots=True)
class UnitChoice:
    """Unit of a fleet.

    Attributes:
        name: Name of the unit.
        study: Study of this unit alone.
    """

    name: str
    study: Study


@dataclass(frozen=True, eq=False, slots=True)
class FleetChoice:
    """Fleet of units of one type of arm.

    Attributes:
        units: The units, at least two.
        folder: Folder to which paths are relative.
    """

    units: tuple[UnitChoice, ...]
    folder: str = "."

    def __post_init__(self) -> None:
        object.__setattr__(self, "units", tuple(self.units))
        names = [unit.name for unit in self.units]
        if len(names) < 2:
            raise StudyError(
                f"A fleet needs at least two units; found {len(names)}.",
                remedy="add a [[unit]], or use armid identify for a single arm.",
            )
        twice = [name for k, name in enumerate(names) if name.lower() in {each.lower() for each in names[:k]}]
        if twice:
            raise StudyError(
                f"Two units have the name {twice[0]!r} (capital letters make no difference).",
                remedy="give each [[unit]] its own name.",
            )


def load_fleet_file(path: Path | str) -> FleetChoice:
    """Reads a `FLEET.toml`.

    Raises:
        StudyError: The file is missing, is not valid TOML, has an unknown key or contradicts itself.
    """
    path = Path(path)
    table = read_toml(path, "a fleet", StudyError, remedy="give the path of a FLEET.toml.")
    with naming(path), boundary("a fleet", path, StudyError, remedy="correct the keys that docs/fleet.md explains."):
        return parse_fleet(table, str(path.parent))


def parse_fleet(table: Mapping[str, Any], folder: str = ".") -> FleetChoice:
    """Makes a fleet from the tables of a `FLEET.toml`.

    Raises:
        StudyError: A key is unknown or missing, or keys contradict each other.
    """
    _known(table, KEYS, "The fleet")
    units = table.get("unit", [])
    if not isinstance(units, list) or not all(isinstance(each, Mapping) for each in units):
        raise StudyError(
            f"The key `unit` of the fleet must be a list of tables; found {units!r:.80}.",
            remedy="write [[unit]], with double brackets, above the keys of each unit.",
        )
    reading = table.get("reading", {})
    if not isinstance(reading, Mapping):
        raise StudyError(f"[reading] must be a table; found {reading!r:.80}.", remedy="write [reading] and its keys.")
    if own := [key for key in ("path", "role", "part") if key in reading]:
        raise StudyError(
            f"[reading] has the key {own[0]!r}, which belongs to one recording.",
            remedy="write it in a [[unit.recording]].",
        )
    if isinstance(table.get("model"), Mapping) and table["model"].get("terms") == "auto":
        raise StudyError(
            'A fleet cannot select its terms (terms = "auto"), because all units need the same terms.',
            remedy='identify one unit with terms = "auto", and copy the terms of its study.toml.',
        )
    common = {key: table[key] for key in ("robot", "model", "processing") if key in table}
    return FleetChoice(tuple(_unit(each, common, reading, folder) for each in units), folder)


def _unit(table: Mapping[str, Any], common: Mapping[str, Any], reading: Mapping[str, Any], folder: str) -> UnitChoice:
    """Unit of a table `[[unit]]`, with the tables that are common to all units."""
    name = table.get("name")
    if not isinstance(name, str) or not NAME.fullmatch(name):
        raise StudyError(
            f"Each [[unit]] needs a `name` of letters, digits, dots, hyphens and underscores; found {name!r:.80}.",
            remedy='write for instance name = "cell-3".',
        )
    _known(table, UNIT_KEYS, f"[[unit]] {name}")
    recordings: list[Any] = []
    for key, role in (("recordings", "train"), ("validate", "validate")):
        paths = table.get(key, [])
        if not isinstance(paths, list) or not all(isinstance(path, str) for path in paths):
            raise StudyError(
                f"[[unit]] {name}: `{key}` must be a list of paths; found {paths!r:.80}.",
                remedy=f'write for instance {key} = ["{name}.csv"].',
            )
        recordings += [{**reading, "path": path, "role": role} for path in paths]
    more = table.get("recording", [])
    if not isinstance(more, list) or not all(isinstance(each, Mapping) for each in more):
        raise StudyError(
            f"[[unit]] {name}: `recording` must be a list of tables; found {more!r:.80}.",
            remedy="write [[unit.recording]], with double brackets.",
        )
    recordings += [{**reading, **each} for each in more]
    try:
        return UnitChoice(name, parse_study({**common, "recording": recordings}, folder))
    except StudyError as error:
        raise StudyError(f"[[unit]] {name}: {error.problem}", possible=error.possible, remedy=error.remedy) from error


def _known(table: Mapping[str, Any], known: tuple[str, ...], where: str) -> None:
    """Raises an error if a table has a key that is not in `known`."""
    for key in table:
        if key not in known:
            raise StudyError(
                f"{where} has no key {key!r}.", possible=", ".join(known), remedy=did_you_mean(key, known)
            )
