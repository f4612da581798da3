"""Expressions of xacro: the arithmetic, text and table operations of the language, and nothing else of Python.

xacro evaluates `${…}` and `$(eval …)` with `eval`, so that a description could run any program. Here an expression is
parsed, every part of it is compared with a list of what the language needs, and sizes are limited. Attributes and
names that begin with an underscore, format strings, and functions that show the inside of objects are refused.
"""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Mapping
from typing import Any

from armid.errors import RobotError

LONGEST = 10_000
"""Largest number of characters of an expression, and of items of a text, list or range that an operation makes."""

LARGEST_BITS = 2000
"""Largest number of bits of an integer that a power or a shift makes; 1e308 has 1024."""

MOST_LOOPS = 2
"""Largest number of loops in an expression."""

MOST_REPLACED = 1000
"""Largest number of characters by which a part of a text may be replaced."""

NODES = (
    ast.Expression, ast.Constant, ast.Name, ast.Load, ast.Store, ast.UnaryOp, ast.UAdd, ast.USub, ast.Not, ast.Invert,
    ast.BinOp, ast.Add, ast.Sub, ast.Mult, ast.Div, ast.FloorDiv, ast.Mod, ast.Pow, ast.LShift, ast.RShift,
    ast.BitAnd, ast.BitOr, ast.BitXor, ast.BoolOp, ast.And, ast.Or, ast.Compare, ast.Eq, ast.NotEq, ast.Lt, ast.LtE,
    ast.Gt, ast.GtE, ast.In, ast.NotIn, ast.Is, ast.IsNot, ast.IfExp, ast.Call, ast.keyword, ast.Attribute,
    ast.Subscript, ast.Slice, ast.List, ast.Tuple, ast.Dict, ast.Set, ast.ListComp, ast.comprehension,
)  # fmt: skip
"""Parts of Python that an expression may have. Lambdas, generators, walrus and f-strings are not among them."""

FORBIDDEN = (vars, type, hash, repr, issubclass, getattr, setattr, eval, exec, compile, open, globals, locals)
"""Functions that show or change the inside of objects; xacro offers the first ones to expressions."""

MAKING_TEXT = frozenset(
    ("format", "format_map", "ljust", "rjust", "center", "zfill", "expandtabs", "translate", "replace", "join")
)
"""Methods of texts that reach the inside of objects or can make a text of any length; short texts may be replaced or
joined."""

CHANGING = frozenset(("update", "setdefault", "clear", "pop", "popitem", "append", "extend", "insert"))
"""Methods of tables and lists that change a value that other expressions use."""

GROWING = frozenset(("factorial", "comb", "perm"))
"""Functions of mathematics whose values have any number of digits."""

CONVERSION = re.compile(r"%(?:[-+ #0]*\d{0,3}(?:\.\d{1,3})?[sdfgeixX]|%)")
"""Pattern of the conversions of a formatted text that are allowed, as in `'%03d' % number`."""


def evaluate(text: str, names: dict[str, Any], local_names: Mapping[str, Any] | None = None) -> Any:
    """Value of an expression of xacro.

    Args:
        text: The expression.
        names: Values of properties and functions by name.
        local_names: Further values, which take precedence.

    Raises:
        RobotError: The expression has a part that is not allowed, or makes too large a value.
        SyntaxError: The text is not an expression.
    """
    text = text.strip()
    if len(text) > LONGEST:
        raise _refused(text, f"it has {len(text)} characters, more than {LONGEST}")
    tree = ast.parse(text, "<expression>", "eval")
    _check(tree, text)
    own = {f"__{name}": _guarded(each, text) for name, each in GUARDS.items()}
    own |= {"range": own["__range"], "__builtins__": {}}
    code = compile(ast.fix_missing_locations(_Guarding().visit(tree)), "<expression>", "eval")
    # Loops look names up among the globals, all else among the locals, where xacro evaluates properties on demand.
    plain = {key: value for key, value in dict.items(names) if not _is_forbidden(value)}
    return eval(code, {**plain, **own}, _Names(names, local_names or {}, own, text))


class _Names(dict[str, Any]):
    """Names of an expression: its own functions, then local names, then properties and functions of xacro."""

    def __init__(self, names: Mapping[str, Any], local_names: Mapping[str, Any], own: Mapping[str, Any], text: str):
        super().__init__()
        self.levels = (own, local_names, names)
        self.text = text

    def __getitem__(self, name: str) -> Any:
        """Value of a name; properties of xacro are evaluated on demand."""
        for level in self.levels:
            if name in level:
                value = level[name]
                if _is_forbidden(value):
                    raise _refused(self.text, f"the function {name} is not allowed")
                return value
        raise KeyError(name)


def _is_forbidden(value: Any) -> bool:
    return any(value is each for each in FORBIDDEN)


def _check(tree: ast.Expression, text: str) -> None:
    """Raises an error if an expression has a part that is not allowed."""
    loops = 0
    for node in ast.walk(tree):
        if not isinstance(node, NODES):
            raise _refused(text, f"{type(node).__name__} is no part of the language")
        loops += len(node.generators) if isinstance(node, ast.ListComp) else 0
        if loops > MOST_LOOPS:
            raise _refused(text, f"it has more than {MOST_LOOPS} loops")
        if isinstance(node, ast.Name) and node.id.startswith("__"):
            raise _refused(text, f"the name {node.id} is not allowed")
        if isinstance(node, ast.Attribute) and node.attr.startswith("_"):
            raise _refused(text, f"the attribute {node.attr} is not allowed")


class _Guarding(ast.NodeTransformer):
    """Replaces operators and attributes by functions that check operands and sizes."""

    def visit_BinOp(self, node: ast.BinOp) -> ast.AST:
        """Replaces one operation; the operands are visited first."""
        self.generic_visit(node)
        name = type(node.op).__name__
        if name not in GUARDS:
            return node
        return ast.copy_location(ast.Call(ast.Name(f"__{name}", ast.Load()), [node.left, node.right], []), node)

    def visit_Attribute(self, node: ast.Attribute) -> ast.AST:
        """Replaces the reading of one attribute."""
        self.generic_visit(node)
        function = ast.Name("__attribute", ast.Load())
        return ast.copy_location(ast.Call(function, [node.value, ast.Constant(node.attr)], []), node)


def _attribute(owner: Any, name: str) -> Any:
    """Attribute of a value, unless it reaches the inside of objects, makes large values or changes the owner."""
    value = getattr(owner, name)
    is_own = callable(value)
    if is_own and isinstance(owner, str) and name in MAKING_TEXT:
        return {"join": _join, "replace": _replace}[name](owner) if name in ("join", "replace") else _refuse(name)
    if is_own and (_is_forbidden(value) or name in GROWING or name in CHANGING or isinstance(owner, type)):
        return _refuse(name)
    return _range if value is range else value


def _refuse(name: str) -> Any:
    raise PermissionError(f"{name} is not allowed")


def _join(owner: str) -> Callable[[Any], str]:
    return lambda parts: _short(owner.join(list(parts)))


def _replace(owner: str) -> Callable[[str, str], str]:
    return lambda old, new: _short(owner.replace(old, new)) if len(new) < MOST_REPLACED else _refuse("replace")


def _short(value: Any) -> Any:
    if len(value) > 100 * LONGEST:
        raise OverflowError
    return value


def _power(x: Any, y: Any) -> Any:
    if isinstance(x, int) and isinstance(y, int) and abs(y) * max(abs(x).bit_length(), 1) > LARGEST_BITS:
        raise OverflowError
    return x**y


def _shift(x: Any, y: Any) -> Any:
    if isinstance(x, int) and isinstance(y, int) and x.bit_length() + y > LARGEST_BITS:
        raise OverflowError
    return x << y


def _product(x: Any, y: Any) -> Any:
    for items, count in ((x, y), (y, x)):
        if hasattr(items, "__len__") and isinstance(count, int) and len(items) * count > LONGEST:
            raise OverflowError
    product = x * y
    if isinstance(product, int) and product.bit_length() > 2 * LARGEST_BITS:
        raise OverflowError
    return product


def _sum(x: Any, y: Any) -> Any:
    total = x + y
    return _short(total) if hasattr(total, "__len__") else total


def _remainder(x: Any, y: Any) -> Any:
    if isinstance(x, str | bytes) and "%" in CONVERSION.sub("", str(x)):
        _refuse("this form of formatting")
    return x % y


def _range(*bounds: int) -> range:
    """Range as in Python, with a limited length."""
    found = range(*bounds)
    if len(found) > LONGEST:
        raise OverflowError
    return found


GUARDS: Mapping[str, Callable[..., Any]] = {
    "Pow": _power,
    "LShift": _shift,
    "Mult": _product,
    "Add": _sum,
    "Mod": _remainder,
    "attribute": _attribute,
    "range": _range,
}
"""Functions that replace operators, by the name of the operator's node, attributes and ranges."""


def _guarded(operation: Callable[..., Any], text: str) -> Callable[..., Any]:
    """Operation whose refusals become errors about the expression."""

    def guarded(*operands: Any) -> Any:
        try:
            return operation(*operands)
        except OverflowError:
            raise _refused(text, "it makes too large a value") from None
        except PermissionError as error:
            raise _refused(text, str(error)) from None

    return guarded


def _refused(text: str, why: str) -> RobotError:
    return RobotError(
        f"The expression of xacro {text[:80]!r} is not evaluated: {why}.",
        possible="arithmetic, comparisons, texts, lists, tables, and the functions of mathematics",
        remedy="write the value, or expand the file with xacro if you trust it, and give the URDF.",
    )
