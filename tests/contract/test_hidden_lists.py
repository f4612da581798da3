"""A kind of thing has one list of its members: no other place in the sources lists them by name.

A list of names in another place goes stale in silence: a new member is missing there. What looks like one, a literal
with several names of a kind, is a choice of members with a reason, which stands in `CHOICES`.
"""

from __future__ import annotations

import ast
from collections.abc import Iterator
from pathlib import Path

import pytest

from armid.codegen.catalogue import LANGUAGES
from armid.doctor import effects
from armid.doctor.catalogue import CHECKS
from armid.estimation.catalogue import ESTIMATORS
from armid.export.catalogue import EXPORTERS
from armid.measurement.catalogue import READERS, recording_suffixes
from armid.model.catalogue import TERMS

SOURCE = Path(__file__).parents[2] / "src" / "armid"

NAMES = {
    "terms": set(TERMS),
    "estimators": set(ESTIMATORS),
    "readers": {*READERS, *recording_suffixes()},
    "exporters": set(EXPORTERS),
    "checks": {*CHECKS, *effects()},
    "languages": set(LANGUAGES),
}

HOMES = {
    "terms": ("model/catalogue.py", "model/terms/"),
    "estimators": ("estimation/catalogue.py", "estimation/estimators/"),
    "readers": ("measurement/catalogue.py", "measurement/readers/"),
    "exporters": ("export/catalogue.py", "export/formats/"),
    "checks": ("doctor/catalogue.py", "doctor/checks/"),
    "languages": ("codegen/catalogue.py", "codegen/languages/"),
}
"""Table and folder of each kind: there members may name each other."""

SEVERAL = 2
"""Names of one kind in one literal from which it is a list of them."""

CHOICES = {
    "terms cli/options.py": "the default model of commands that select nothing",
    "terms export/formats/mjcf.py": "what the format can store",
    "terms export/formats/sdf.py": "what the format can store",
    "terms export/formats/urdf.py": "what the format can store",
    "terms export/other_programs.py": "what MuJoCo and Pinocchio read",
    "terms lab/known_arms.py": "friction of the lab, a simulation of its own with names of its own",
    "terms thesis/experiments/residual_causes.py": "effects of the lab, whose names are like those of terms",
    "terms robot/mjcf/plain_document.py": "attributes of the format",
    "terms robot/readers/urdf.py": "attributes of the format",
    "terms model/described_torque.py": "what descriptions contain",
    "terms runs/consistency_check.py": "terms without shapes, which a list of parameters names by symbols",
    "terms study/demo.py": "the model of the demonstration",
    "checks study/diagnosis.py": "findings of the processing, which are no check's",
    "readers excitation/formats/__init__.py": "formats of controllers, another kind",
    "readers measurement/writing.py": "formats that the lab writes, another kind",
    "exporters robot/missing_inertia.py": "suffixes of descriptions in XML",
    "exporters robot/readers/__init__.py": "readers of descriptions, another kind",
}
"""Places that name several members for a reason of their own, with the reason."""


CLASSES = {kind.__name__: name for table in (TERMS, ESTIMATORS) for name, kind in table.items()}
"""Names of members by their classes, by which a list may name them, too."""


def names_in(node: ast.AST) -> Iterator[str]:
    """Texts and classes that are elements of a literal, or compared in one condition."""
    elements: list[ast.expr | None] = []
    if isinstance(node, ast.Tuple | ast.List | ast.Set):
        elements = [*node.elts]
    if isinstance(node, ast.Dict):
        elements = [*node.keys, *node.values]
    if isinstance(node, ast.BinOp) and isinstance(node.op, ast.BitOr):
        elements = [each for each in ast.walk(node) if isinstance(each, ast.Name)]
    if isinstance(node, ast.BoolOp):
        elements = [each for value in node.values if isinstance(value, ast.Compare) for each in value.comparators]
    if isinstance(node, ast.Match):
        elements = [case.pattern.value for case in node.cases if isinstance(case.pattern, ast.MatchValue)]
    for each in elements:
        if isinstance(each, ast.Constant) and isinstance(each.value, str):
            yield each.value
        if isinstance(each, ast.Name) and each.id in CLASSES:
            yield CLASSES[each.id]


def lists_of(kind: str, text: str) -> list[tuple[int, list[str]]]:
    """Lines of a module with literals that list members of a kind, and the members."""
    found = [(node, sorted(NAMES[kind] & set(names_in(node)))) for node in ast.walk(ast.parse(text))]
    return [(getattr(node, "lineno", 0), names) for node, names in found if len(names) >= SEVERAL]


@pytest.mark.parametrize("kind", NAMES)
def test_no_other_place_lists_members(kind: str):
    hidden: list[str] = []
    for path in sorted(SOURCE.rglob("*.py")):
        place = path.relative_to(SOURCE).as_posix()
        if not place.startswith(HOMES[kind]) and f"{kind} {place}" not in CHOICES:
            found = lists_of(kind, path.read_text(encoding="utf-8"))
            hidden += [f"{place}:{line} {', '.join(names)}" for line, names in found]
    assert hidden == [], "read the catalogue, or a field of its members"


def test_every_choice_is_still_one():
    for choice, reason in CHOICES.items():
        kind, place = choice.split(" ")
        assert reason and lists_of(kind, (SOURCE / place).read_text(encoding="utf-8")), choice


@pytest.mark.parametrize(
    "text",
    [
        'SIGNED = ("coulomb", "stribeck")',
        'WORDS = {"stribeck": 1, "ripple": 2}',
        'if name == "coulomb" or name == "ripple":\n    pass',
        "if isinstance(term, Coulomb | Stribeck):\n    pass",
        'match name:\n    case "coulomb":\n        pass\n    case "ripple":\n        pass',
    ],
)
def test_a_list_is_found(text: str):
    assert lists_of("terms", text)
    assert not lists_of("estimators", text)
