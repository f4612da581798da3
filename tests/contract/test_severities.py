"""Findings weigh the same wherever they are told: one severity a code, or a rule that docs/doctor.md states."""

from __future__ import annotations

import ast
from collections import defaultdict
from functools import cache
from pathlib import Path

ROOT = Path(__file__).parents[2]
SEVERITIES = {"error", "warning", "info"}
MAKERS = {"Finding": 1, "Explanation": 2, "ResidualCause": 1, "CommonCause": 1}
"""Makers of findings, and of causes that become findings, with the position of the severity among their arguments;
the first is the code."""


@cache
def told() -> dict[str, set[str]]:
    """Severities of each code that the sources name."""
    found: defaultdict[str, set[str]] = defaultdict(set)
    for path in sorted((ROOT / "src").rglob("*.py")):
        tree = ast.parse(path.read_text())
        named = _texts(tree)
        made: set[str] = set()
        functions = {node.name: node for node in ast.walk(tree) if isinstance(node, ast.FunctionDef)}
        for node in ast.walk(tree):
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Name)):
                continue
            if node.func.id == "recording_error" and isinstance(node.args[0], ast.Constant):
                found[str(node.args[0].value)].add("error")  # what stops a reading is an error of the doctor's
            if node.func.id not in MAKERS or len(node.args) <= MAKERS[node.func.id]:
                continue
            for name in _codes(node.args[0], named):
                made.add(name)
                found[name] |= _severities(node.args[MAKERS[node.func.id]], functions)
        for name in made:
            found[name] |= _replaced(tree)
    return dict(found)


def _codes(node: ast.expr, named: dict[str, str]) -> set[str]:
    """Codes that an argument may be: a text, its name, or one of two."""
    if isinstance(node, ast.IfExp):
        return _codes(node.body, named) | _codes(node.orelse, named)
    name = named.get(node.id) if isinstance(node, ast.Name) else getattr(node, "value", None)
    return {name} if isinstance(name, str) else set()


def _texts(tree: ast.Module) -> dict[str, str]:
    """Names of a module that stand for texts."""
    found: dict[str, str] = {}
    for node in tree.body:
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            pairs = zip(target.elts, value.elts, strict=True) if _are_tuples(target, value) else [(target, value)]
            for each, text in pairs:
                if isinstance(each, ast.Name) and isinstance(text, ast.Constant) and isinstance(text.value, str):
                    found[each.id] = text.value
    return found


def _are_tuples(*nodes: ast.expr) -> bool:
    return all(isinstance(node, ast.Tuple) for node in nodes)


def _replaced(tree: ast.Module) -> set[str]:
    """Severities that a module gives to findings that it has made: `replace(finding, severity=…)`."""
    found: set[str] = set()
    for call in ast.walk(tree):
        if isinstance(call, ast.Call) and isinstance(call.func, ast.Name) and call.func.id == "replace":
            given = [word.value for word in call.keywords if word.arg == "severity"]
            found |= {c for value in given for each in ast.walk(value) for c in _constants(each)}
    return found


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
