"""Each package of things that come in kinds lists all of its modules: a file that nobody lists would never run."""

from __future__ import annotations

import importlib
import pkgutil
from types import ModuleType
from typing import Any

import pytest

import armid
from armid.codegen import languages
from armid.codegen.catalogue import LANGUAGES
from armid.doctor import checks
from armid.doctor.catalogue import CHECKS
from armid.doctor.check_definition import LogCheck
from armid.estimation import estimators
from armid.estimation.catalogue import ESTIMATORS
from armid.excitation import formats
from armid.export import formats as descriptions
from armid.export.catalogue import EXPORTERS
from armid.export.load import controllers
from armid.export.load.catalogue import CONTROLLERS
from armid.export.ros import files as ros_files
from armid.export.ros.catalogue import ROS_FILES
from armid.lazy_catalogue import Catalogue
from armid.measurement import readers as recording_readers
from armid.measurement.catalogue import READERS, RecordingFormat
from armid.model import terms
from armid.model.catalogue import TERMS
from armid.report import sections
from armid.robot import readers as robot_readers

CATALOGUES = {
    "terms": (
        terms,
        TERMS,
        {"term", "checks", "equal_columns", "filtered_steps", "law_programs", "selection_candidates"},
    ),
    "estimators": (estimators, ESTIMATORS, set()),
    "robot readers": (robot_readers, robot_readers.READERS, set()),
    "report sections": (sections, sections.SECTIONS, set()),
    "formats of controllers": (formats, formats.FORMATS, {"sampled_motion"}),
    "exporters": (descriptions, EXPORTERS, set()),
    "files for ROS": (ros_files, ROS_FILES, set()),
    "controllers": (controllers, CONTROLLERS, set()),
    "languages": (languages, LANGUAGES, set()),
    "doctor's checks": (
        checks,
        CHECKS,
        set(),
    ),
    "recording readers": (recording_readers, READERS, set()),
}
"""Package, catalogue, and the modules that hold what the kind is rather than one of the kind."""


def entries(catalogue: Any) -> list[Any]:
    return list(catalogue.values() if hasattr(catalogue, "values") else catalogue)


def module_of(entry: Any) -> str:
    if isinstance(entry, RecordingFormat | robot_readers.DescriptionFormat):
        return entry.module
    if isinstance(entry, LogCheck):
        return entry.look.__module__
    return entry.__name__ if isinstance(entry, ModuleType) else entry.__module__


@pytest.mark.parametrize("kind", CATALOGUES)
def test_every_module_is_listed(kind: str):
    package, catalogue, shared = CATALOGUES[kind]
    inside = pkgutil.walk_packages(package.__path__, f"{package.__name__}.")
    modules = {info.name for info in inside if not info.ispkg and info.name.rsplit(".", 1)[1] not in shared}
    listed = [module_of(entry) for entry in entries(catalogue)]
    assert modules == set(listed)
    assert len(listed) == len(set(listed))


@pytest.mark.parametrize("kind", CATALOGUES)
def test_names_are_those_of_the_files(kind: str):
    """A study's name for a thing is the name of its file."""
    _, catalogue, _ = CATALOGUES[kind]
    if hasattr(catalogue, "items"):
        assert {name: name.replace("-", "_") for name in catalogue} == {
            name: module_of(entry).rsplit(".", 1)[1] for name, entry in catalogue.items()
        }


def test_every_catalogue_of_armid_is_looked_at():
    """Tables stand in modules named `catalogue`; kinds without one have their table in the package itself."""
    tables = [
        table
        for info in pkgutil.walk_packages(armid.__path__, "armid.")
        if info.name.endswith(".catalogue") and info.name != "armid.lazy_catalogue"
        for table in vars(importlib.import_module(info.name)).values()
        if isinstance(table, Catalogue)
    ]
    assert len(tables) >= 6
    assert all(any(table is known for _, known, _ in CATALOGUES.values()) for table in tables)
