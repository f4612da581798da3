"""Findings weigh the same wherever they are told: one severity a code, or a rule that docs/doctor.md states."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
SEVERITIES = {"error", "warning", "info"}
MAKERS = {"Finding": 1, "Explanation": 2}
"""Makers of findings, with the position of the severity among their arguments; the first is the code."""


@cache
def told() -> dict[str, set[str]]:
    """Severities of each code that the sources name."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for path in sorted((ROOT / "src").rglob("*.py")):
        tree = ast.parse(path.read_text())
        named = {
            target.id: node.value.value
            for node in tree.body
            if isinstance(node, ast.Assign) and isinstance(node.value, ast.Constant)
            for target in node.targets
            if isinstance(target, ast.Name)
        }
        functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            if node.func.id == "recording_error" and isinstance(node.args[0], ast.Constant):
                found[str(node.args[0].value)].add("error")  # what stops a reading is an error of the doctor's
            if node.func.id not in MAKERS or len(node.args) <= MAKERS[node.func.id]:
                continue
            code = node.args[0]
            name = named.get(code.id) if isinstance(code, ast.Name) else getattr(code, "value", None)
            if isinstance(name, str):
                found[name] |= _severities(node.args[MAKERS[node.func.id]], functions)
    return dict(found)


def _severities(node: ast.expr, functions: dict[str, ast.FunctionDef]) -> set[str]:
    if isinstance(node, ast.Call) and isinstance(node.func, ast.Name):
        if node.func.id not in functions:  # made elsewhere, by the rule that is stated there
            return set()
        return {c for each in ast.walk(functions[node.func.id]) for c in _constants(each)}
    return {c for each in ast.walk(node) for c in _constants(each)}


def _constants(node: ast.AST) -> set[str]:
    return {node.value} & SEVERITIES if isinstance(node, ast.Constant) and isinstance(node.value, str) else set()


@cache
def stated() -> dict[str, set[str]]:
    """Severities of each code that the table of the documentation names, with a rule behind them."""
    text = (
        (ROOT / "docs" / "doctor.md").read_text().split("<!-- severities -->")[1].split("<!-- end of severities")[0]
    )
    rows = [
        [cell.strip() for cell in line.strip("|").split("|")] for line in text.splitlines() if line.startswith("| `")
    ]
    assert all(len(row) == 3 and row[2] for row in rows)
    return {row[0].strip("`"): set(row[1].split(", ")) for row in rows}


def test_one_severity_a_code_or_a_stated_rule():
    several = {code: severities for code, severities in told().items() if len(severities) > 1}
    assert several == stated()


def test_something_was_looked_at():
    assert len(told()) > 60 and told()["rows-repeated"] == {"warning"} and told()["degrees"] == {"error"}
