"""The import graph of the whole tree, read from the source: imports inside functions and for types only included."""

from __future__ import annotations

import ast
import io
import tokenize
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

#: The packages by floor, lowest first. A package imports from lower floors only, and nothing from its own floor but
#: itself. 'core' are the files right in core/. A new package is written down here before anything imports it.
FLOORS = (
    ("core",),
    ("core.rasterizer", "core.imaging", "core.formats", "core.photos", "core.evaluation"),
    ("core.forward",),
    ("core.calibration", "core.sfm", "core.training"),
    ("core.inspection", "core.backends", "core.surface", "core.serving"),
    ("core.effects",),
    ("core.report",),
    ("core.twin", "core.effort"),
    ("core.uncertainty", "core.mesh"),
    ("core.pipeline", "core.measure"),
    ("core.change",),
    ("studies.comparison", "studies.stability", "dgs_addon"),
    ("studies.tradeoff", "studies.paper", "studies.benchmark", "dgs_addon.engine", "dgs_addon.laboratory"),
    ("dgs_addon.scene",),
    ("dgs_addon.drawing",),
    ("dgs_addon.job",),
    ("dgs_addon.questions",),
    ("operators",),
    ("panels",),
    ("command_line", "api"),
)
#: What a reason in a comment is not.
_NO_REASON = ("noqa", "type:", "fmt:", "isort:", "pragma")


@dataclass(frozen=True)
class ImportInside:
    """An import inside a function."""

    module: str
    line: int
    has_reason: bool


def package_of(module: str) -> str:
    """The package of a module as `FLOORS` names it: 'core.files' -> 'core', 'core.sfm.find' -> 'core.sfm'."""
    names = {package for floor in FLOORS for package in floor}
    parts = module.split(".")
    return next((name for n in (2, 1) if (name := ".".join(parts[:n])) in names), ".".join(parts[:2]))


class ImportGraph:
    """All modules below some top-level packages.

    Attributes:
        edges: module -> the modules that it imports, wherever in its file.
        inside: the imports inside functions, absolute ones included.
    """

    def __init__(self, root: Path, packages: tuple[str, ...]) -> None:
        self.files: dict[str, Path] = {}
        for package in packages:
            for file in (root / package).rglob("*.py"):
                parts = file.relative_to(root).with_suffix("").parts
                self.files[".".join(parts[:-1] if parts[-1] == "__init__" else parts)] = file
        self.edges: dict[str, set[str]] = {}
        self.inside: list[ImportInside] = []
        for module, file in sorted(self.files.items()):
            self._read(module, file)

    def _read(self, module: str, file: Path) -> None:
        source = file.read_text("utf-8")
        tree = ast.parse(source)
        package = module.split(".") if file.name == "__init__.py" else module.split(".")[:-1]
        self.edges[module] = {
            target
            for node in ast.walk(tree)
            if isinstance(node, ast.ImportFrom) and node.level
            for target in self._targets(package, node)
            if target != module
        }
        reasons = commented_lines(source)
        for function in ast.walk(tree):
            if isinstance(function, (ast.FunctionDef, ast.AsyncFunctionDef)):
                for row in _rows_of_imports(function):
                    self.inside += [
                        ImportInside(module, node.lineno, _has(node, reasons) or _has(row[0], reasons)) for node in row
                    ]

    def _targets(self, package: list[str], node: ast.ImportFrom) -> Iterator[str]:
        base = package[: len(package) - node.level + 1] + (node.module.split(".") if node.module else [])
        for alias in node.names:
            name = ".".join([*base, alias.name])
            target = name if name in self.files else ".".join(base)
            if target in self.files:
                yield target

    def circles(self) -> list[list[str]]:
        """Groups of modules that import each other in a circle (Tarjan's strongly connected components)."""
        number: dict[str, int] = {}
        lowest: dict[str, int] = {}
        stack: list[str] = []
        found = []

        def visit(module: str) -> None:
            number[module] = lowest[module] = len(number)
            stack.append(module)
            for other in sorted(self.edges[module]):
                if other not in number:
                    visit(other)
                    lowest[module] = min(lowest[module], lowest[other])
                elif other in stack:
                    lowest[module] = min(lowest[module], number[other])
            if lowest[module] == number[module]:
                circle = stack[stack.index(module) :]
                del stack[stack.index(module) :]
                if len(circle) > 1:
                    found.append(sorted(circle))

        for module in sorted(self.files):
            if module not in number:
                visit(module)
        return sorted(found)

    def upward(self) -> list[str]:
        """Imports from a package of the same or a higher floor, as 'module -> module'."""
        floor = {package: index for index, packages in enumerate(FLOORS) for package in packages}
        return [
            f"{module} -> {other}"
            for module, others in sorted(self.edges.items())
            for other in sorted(others)
            if (package := package_of(module)) != (target := package_of(other))
            and floor.get(package, -1) <= floor.get(target, len(FLOORS))
        ]

    def without_floor(self) -> set[str]:
        """Packages with code of their own that `FLOORS` does not name."""
        named = {package for floor in FLOORS for package in floor}
        return {
            package_of(module)
            for module, file in self.files.items()
            if package_of(module) not in named and (file.name != "__init__.py" or self.edges[module])
        }


def commented_lines(source: str) -> set[int]:
    """The lines that a comment gives a reason for: its own, and the next one where it stands alone on its line."""
    found = set()
    for word in tokenize.generate_tokens(io.StringIO(source).readline):
        if word.type == tokenize.COMMENT and not word.string.lstrip("#: ").startswith(_NO_REASON):
            alone = not word.line[: word.start[1]].strip()
            found.add(word.start[0] + alone)
    return found


def _rows_of_imports(function: ast.AST) -> Iterator[list[ast.Import | ast.ImportFrom]]:
    """Unbroken rows of imports among a function's statements; a nested function's are its own."""
    for node in _inside(function):
        for name in ("body", "orelse", "finalbody"):
            row: list[ast.Import | ast.ImportFrom] = []
            block = getattr(node, name, [])
            for statement in block if isinstance(block, list) else []:
                if isinstance(statement, (ast.Import, ast.ImportFrom)):
                    row.append(statement)
                elif row:
                    yield row
                    row = []
            if row:
                yield row


def _inside(function: ast.AST) -> Iterator[ast.AST]:
    """The function and its blocks, without the functions inside it."""
    yield function
    for child in ast.iter_child_nodes(function):
        if not isinstance(child, (ast.FunctionDef, ast.AsyncFunctionDef, ast.Lambda)):
            yield from _inside(child)


def _has(node: ast.stmt, reasons: set[int]) -> bool:
    return not reasons.isdisjoint(range(node.lineno, (node.end_lineno or node.lineno) + 1))
