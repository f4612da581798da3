"""Writing of load data for the controllers of several vendors."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from armid.errors import Finding, OutputError, did_you_mean
from armid.export.load.catalogue import CONTROLLERS
from armid.export.load.flange_load import FlangeLoad
from armid.export.load.load_text import LoadNumber, LoadText
from armid.output.file_group import replace_files
from armid.study.storage.records import finding_record

OWN = ("armid payload", '"armid-load"')
"""Texts by which files of armid are recognised; each of its files contains one of them."""


@dataclass(frozen=True, eq=False, slots=True)
class WrittenLoad:
    """Load data written for one controller.

    Attributes:
        controller: Name of the controller, one of `armid.export.load.catalogue.CONTROLLERS`.
        files: Paths of the written files.
        flange: Text that names the frame of the load.
        numbers: Numbers of the files in the units of the controller, with 95 % intervals.
        findings: Findings about numbers that the controller does not accept, and about facts that are not confirmed.
    """

    controller: str
    files: tuple[Path, ...]
    flange: str
    numbers: tuple[LoadNumber, ...]
    findings: tuple[Finding, ...]


Further = Callable[["tuple[WrittenLoad, ...]"], Mapping[str, str]]
"""Function that makes further files, by name, about the files of controllers."""


def write_load(
    load: FlangeLoad, to: str | Sequence[str], out: Path | str, *, further: Further | None = None
) -> tuple[WrittenLoad, ...]:
    """Writes an identified payload in the form of controllers, all files or none.

    None of these forms was tried on a robot.

    Args:
        load: The load in the axes of the flange.
        to: Names of controllers of `armid.export.load.catalogue.CONTROLLERS`: one, several, or a list with commas.
        out: Folder for the files.
        further: Function that makes further files about those of the controllers.

    Raises:
        OutputError: A controller is unknown, a number is outside the bounds that a vendor documents, or a file exists
            that is not one of armid. Then nothing is written.
    """
    folder = Path(out)
    texts = {name: CONTROLLERS[name].write(load) for name in controller_names(to)}
    for text in texts.values():
        _refuse_others(folder, text)
    written = tuple(
        WrittenLoad(name, tuple(folder / file for file in text.files), load.flange, text.numbers, text.findings)
        for name, text in texts.items()
    )
    files = {file: content for text in texts.values() for file, content in text.files.items()}
    replace_files(folder, {**files, **({} if further is None else further(written))})
    return written


def controller_names(to: str | Sequence[str]) -> list[str]:
    """Names of controllers, each once, from names and lists with commas.

    Raises:
        OutputError: There is no such controller.
    """
    parts = [to] if isinstance(to, str) else to
    names = list(dict.fromkeys(name.strip() for part in parts for name in part.split(",") if name.strip()))
    for name in names:
        if name not in CONTROLLERS:
            raise OutputError(
                f"Unknown controller {name!r}.",
                possible=", ".join(CONTROLLERS),
                remedy=did_you_mean(name, CONTROLLERS),
            )
    if not names:
        raise OutputError("No controller is named.", possible=", ".join(CONTROLLERS), remedy="name a controller.")
    return names


def written_record(written: Sequence[WrittenLoad]) -> dict[str, Any]:
    """JSON object with the files, numbers, intervals and findings of each controller, by its name."""
    return {
        each.controller: {
            "files": [str(path) for path in each.files],
            "flange": each.flange,
            "numbers": [
                {
                    "name": number.name,
                    "value": number.value,
                    "unit": number.unit,
                    "interval95": number.interval,
                    "in_file": number.in_file,
                }
                for number in each.numbers
            ],
            "findings": [finding_record(finding) for finding in each.findings],
        }
        for each in written
    }


def _refuse_others(folder: Path, text: LoadText) -> None:
    """Refuses to overwrite files that armid has not written."""
    for name in text.files:
        path = folder / name
        if path.is_file() and not any(word in path.read_text(encoding="utf-8", errors="replace") for word in OWN):
            raise OutputError(
                f"{path} would be overwritten, but it is not a file of armid payload.",
                remedy="choose another folder with --out, or remove the file.",
            )
