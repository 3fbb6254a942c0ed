"""Numbers at the top of a module that do not say what they are."""

from __future__ import annotations

import ast
from collections.abc import Iterator

from .import_graph import commented_lines


def bare_numbers(source: str) -> list[tuple[str, int]]:
    """Name and line of each number (or tuple of numbers) in capitals with no comment beside it or right above it."""
    lines = commented_lines(source)
    return [
        (name, node.lineno)
        for node in ast.parse(source).body
        for name in _numbers(node)
        if lines.isdisjoint(range(node.lineno, (node.end_lineno or node.lineno) + 1))
    ]


def _numbers(node: ast.stmt) -> Iterator[str]:
    if isinstance(node, ast.AnnAssign):
        targets: list[ast.expr] = [node.target]
    else:
        targets = node.targets if isinstance(node, ast.Assign) else []
    if targets and node.value is not None and _is_number(node.value):  # type: ignore[attr-defined]
        for target in targets:
            for name in target.elts if isinstance(target, ast.Tuple) else [target]:
                if isinstance(name, ast.Name) and name.id.isupper():
                    yield name.id


def _is_number(value: ast.expr) -> bool:
    """A number, or what is made of nothing else: -1, 2 * 3, (1, 2), {"a": 1}."""
    if isinstance(value, ast.Constant):
        return isinstance(value.value, (int, float)) and not isinstance(value.value, bool)
    if isinstance(value, ast.UnaryOp):
        return _is_number(value.operand)
    if isinstance(value, ast.BinOp):
        return _is_number(value.left) and _is_number(value.right)
    if isinstance(value, (ast.Tuple, ast.List)):
        return bool(value.elts) and all(_is_number(one) for one in value.elts)
    if isinstance(value, ast.Dict):
        return bool(value.values) and all(_is_number(one) for one in value.values)
    return False
