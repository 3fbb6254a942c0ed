"""Draws mutants of the engine's files: cosmic-ray's operators, and one that drops a statement.

    PYTHON_WITH_COSMIC_RAY tools/mutation/draw.py < REQUEST > MUTANTS        (both JSON)

Runs in an environment of its own (`tools/mutation/requirements.txt`), so it imports nothing of the project. A site is
a place in a file and a kind of change; sites are drawn without replacement, then one of a site's replacements. So an
operator with many replacements weighs no more than a number with two.
"""

from __future__ import annotations

import ast
import json
import random
import sys
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

from cosmic_ray.ast import ast_nodes, get_ast
from cosmic_ray.mutating import mutate_code
from cosmic_ray.plugins import get_operator, operator_names

Position = tuple[int, int]
#: Replacements within a group are tried; one from another group fails with a TypeError on the first call.
_GROUPS = (
    ("Add", "Sub", "Mul", "Div", "FloorDiv", "Mod", "Pow"),
    ("BitOr", "BitAnd", "BitXor", "RShift", "LShift"),
    ("Eq", "NotEq", "Lt", "LtE", "Gt", "GtE"),
    ("Is", "IsNot"),
    ("UAdd", "USub", "Invert", "Delete_Not"),
)
#: They need arguments, which nothing in the code suggests.
_LEFT_OUT = ("VariableReplacer", "VariableInserter")
DROPPED = "DropStatement"


def family(name: str) -> str:
    """An operator's name without what it replaces and by what."""
    return name.split("/")[-1].split("_")[0]


def fits(name: str) -> bool:
    """Whether a replacement stays in its group of operators."""
    kind, _, pair = name.split("/")[-1].partition("_")
    if kind in _LEFT_OUT:
        return False
    if kind not in ("ReplaceBinaryOperator", "ReplaceComparisonOperator"):
        return True
    old, new = pair.split("_")
    return any(old in group and new in group for group in _GROUPS)


def excluded(tree: ast.Module) -> list[tuple[Position, Position]]:
    """Spans that are no code under test: annotations, settings made by `number(...)`, the wording of errors."""
    spans: list[ast.AST] = []
    for node in ast.walk(tree):
        if isinstance(node, ast.FunctionDef):
            arguments = node.args
            every = (*arguments.posonlyargs, *arguments.args, *arguments.kwonlyargs, arguments.vararg, arguments.kwarg)
            spans += [a.annotation for a in every if a is not None and a.annotation is not None]
            spans += [node.returns] if node.returns is not None else []
        elif isinstance(node, ast.AnnAssign):
            spans.append(node.annotation)
        elif isinstance(node, ast.Call) and isinstance(node.func, ast.Name) and node.func.id == "number":
            spans.append(node)
        elif isinstance(node, ast.Raise):
            spans += [inner for inner in ast.walk(node) if isinstance(inner, ast.JoinedStr)]
    return [((s.lineno, s.col_offset), (s.end_lineno, s.end_col_offset)) for s in spans]  # type: ignore[attr-defined]


def droppable(tree: ast.Module) -> list[ast.stmt]:
    """Calls whose value nobody takes, and changes in place."""
    found = []
    for node in ast.walk(tree):
        call = isinstance(node, ast.Expr) and isinstance(node.value, ast.Call)
        if call or isinstance(node, ast.AugAssign):
            found.append(node)
    return sorted(found, key=lambda node: node.lineno)


def without(source: str, statement: ast.stmt) -> str:
    """The source with `pass` in place of a statement."""
    lines = source.encode().split(b"\n")
    first, last = statement.lineno - 1, (statement.end_lineno or statement.lineno) - 1
    tail = lines[last][statement.end_col_offset :]
    lines[first : last + 1] = [lines[first][: statement.col_offset] + b"pass" + tail, *([b""] * (last - first))]
    return b"\n".join(lines).decode()


def sites_of(source: str) -> dict[tuple[str, Position, Position], list[tuple[str, int]]]:
    """Each site's (operator, occurrence) pairs."""
    tree, nodes = ast.parse(source), list(ast_nodes(get_ast(source)))
    out = excluded(tree)
    sites: dict[tuple[str, Position, Position], list[tuple[str, int]]] = defaultdict(list)
    for name in sorted(filter(fits, operator_names())):
        operator, occurrence = get_operator(name)(), 0
        for node in nodes:
            for start, end in operator.mutation_positions(node):
                if not any(a <= tuple(start) and tuple(end) <= b for a, b in out):
                    sites[family(name), tuple(start), tuple(end)].append((name, occurrence))
                occurrence += 1
    for occurrence, statement in enumerate(droppable(tree)):
        span = (statement.lineno, statement.col_offset), (statement.end_lineno or 0, statement.end_col_offset or 0)
        sites[DROPPED, *span].append((DROPPED, occurrence))
    return sites


def mutated(source: str, name: str, occurrence: int) -> str | None:
    """The source with one mutation; None if it changes nothing or is no Python."""
    if name == DROPPED:
        text: str | None = without(source, droppable(ast.parse(source))[occurrence])
    else:
        text = mutate_code(source, get_operator(name)(), occurrence)
    try:
        same = text is None or ast.dump(ast.parse(text)) == ast.dump(ast.parse(source))
    except SyntaxError:
        return None
    return None if same else text


def statement_at(tree: ast.Module, line: int) -> tuple[int, int, str]:
    """First and last line of the innermost statement at a line (of a compound one: its head), and its function."""
    spans: list[tuple[int, int]] = []
    function = ""
    for node in ast.walk(tree):
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or node.lineno):
            body = getattr(node, "body", None)
            if isinstance(node, ast.FunctionDef) and line >= node.body[0].lineno:
                function = node.name
            spans.append((node.lineno, max(node.lineno, body[0].lineno - 1 if body else node.end_lineno or 0)))
    first, last = max((span for span in spans if span[0] <= line <= span[1]), default=(line, line))  # (a decorator)
    return first, last, function


def drawn(tree: Path, files: list[str], count: int, rng: random.Random) -> Iterator[dict[str, object]]:
    """`count` mutants of some files."""
    sources = {name: (tree / name).read_text("utf-8") for name in files}
    sites = [(name, site, ways) for name in files for site, ways in sorted(sites_of(sources[name]).items())]
    rng.shuffle(sites)
    made = 0
    for name, (kind, start, _), ways in sites:
        operator, occurrence = rng.choice(ways)
        text = mutated(sources[name], operator, occurrence)
        if text is None:
            continue
        first, last, function = statement_at(ast.parse(sources[name]), start[0])
        yield {
            "file": name,
            "operator": operator.split("/")[-1],
            "occurrence": occurrence,
            "kind": kind,
            "line": start[0],
            "first": first,
            "last": last,
            "function": function,
            "old": sources[name].splitlines()[start[0] - 1].strip(),
            "new": text.splitlines()[start[0] - 1].strip(),
            "text": text,
            "sites": len(sites),
        }
        made += 1
        if made == count:
            return


def main() -> None:
    """Reads the request (JSON on standard input), writes the mutants (JSON)."""
    request = json.load(sys.stdin)
    result = []
    for group in request["groups"]:
        rng = random.Random(f"{request['seed']} {group['name']}")
        for one in drawn(Path(request["tree"]), group["files"], group["count"], rng):
            result.append({"group": group["name"], "package": group["package"], **one})
    json.dump(result, sys.stdout)


if __name__ == "__main__":
    main()
