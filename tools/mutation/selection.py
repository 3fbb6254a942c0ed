"""Which tests a mutant is run against, in which order, and with which compiled kernels."""

from __future__ import annotations

import ast
import os
import shutil
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from .groups import GROUPS

Pick = tuple[int, list[str], float]


class Selection:
    """Knows from a trace which tests reach which statement.

    Args:
        tree: the copy.
    """

    def __init__(self, tree: Path) -> None:
        self._tree = tree
        self._files = sorted(p.relative_to(tree).as_posix() for p in (tree / "core").rglob("*.py"))
        self._imports = {name: _imports(tree, name) for name in self._files}
        self._at: dict[str, dict[int, set[str]]] = defaultdict(lambda: defaultdict(set))
        self._seconds: dict[str, float] = {}

    def watched(self) -> set[str]:
        """Files whose lines a trace has to note: those that are mutated, and those that call their kernels."""
        kernels = {f for f in self._files if f.endswith("kernels.py")}
        callers = {f for f, names in self._imports.items() if set(names) & kernels}
        return {f for group in GROUPS for f in group.files(self._tree)} | callers

    def elsewhere(self) -> list[str]:
        """Folders of tests without Blender that stand beside none of the groups."""
        beside = {test for group in GROUPS for test in group.tests}
        core = sorted(p.relative_to(self._tree).as_posix() for p in (self._tree / "tests/core").iterdir() if p.is_dir())
        found = [t for t in core if t not in beside and "__pycache__" not in t]
        return [*found, "tests/hard_cases", "tests/command_line"]

    def learn(self, reach: dict[str, Any]) -> None:
        """Takes a trace in."""
        for test, facts in reach["tests"].items():
            self._seconds[test] = facts["seconds"]
            sources = [facts["lines"]]
            sources += [lines for node, lines in reach["shared"].items() if test.startswith(node)]
            for lines in sources:
                for name, numbers in lines.items():
                    for number in numbers:
                        self._at[name][number].add(test)

    def lines(self, mutant: dict[str, Any], first: float, second: float) -> Iterator[Pick]:
        """The tests of the first and of the second line, the quick ones first, with their seconds."""
        reaching = self._reaching(mutant)
        beside = next(group.tests for group in GROUPS if group.name == mutant["group"])
        near = {test for test in reaching if test.startswith(beside)}
        if not near and not reaching:  # only children run it, or nothing does
            near = {test for test in self._seconds if test.startswith(beside)}
        yield (1, *self._within(near, first))
        if second:
            yield (2, *self._within(reaching - near, second))

    def _within(self, tests: set[str], budget: float) -> tuple[list[str], float]:
        by_file: dict[str, list[str]] = defaultdict(list)
        for test in sorted(tests, key=lambda test: (self._seconds[test], test)):
            by_file[test.split("::")[0]].append(test)
        chosen, total = [], 0.0
        for file in sorted(by_file, key=lambda file: min(self._seconds[test] for test in by_file[file])):
            for test in by_file[file]:
                if not chosen or total + self._seconds[test] <= budget:
                    chosen.append(test)
                    total += self._seconds[test]
        return chosen, total

    def _reaching(self, mutant: dict[str, Any]) -> set[str]:
        name = mutant["file"]
        if name.endswith("kernels.py"):
            return self._calling(name)
        at = self._at[name]
        found: set[str] = set()
        if mutant["function"]:
            for number in range(mutant["first"], mutant["last"] + 1):
                found |= at.get(number, set())
            return found
        for tests in at.values():  # runs when the module is imported
            found |= tests
        return found | self._importing(name)

    def _importing(self, name: str) -> set[str]:
        """Tests that run anything of a file that imports names of this one (its constants)."""
        found: set[str] = set()
        for file, imports in self._imports.items():
            if name in imports:
                found |= self._using(file, imports[name])
        return found

    def _calling(self, name: str) -> set[str]:
        found: set[str] = set()
        closure = self._closure(name)
        for file, imports in self._imports.items():
            if file.endswith("kernels.py"):
                continue
            used = {one for kernel in closure for one in imports.get(kernel, ())}
            found |= self._using(file, used) if used else set()
        return found

    def _using(self, file: str, names: set[str]) -> set[str]:
        """Tests that run a statement of a file in which one of the names occurs."""
        found: set[str] = set()
        for node in ast.walk(ast.parse((self._tree / file).read_text("utf-8"))):
            if isinstance(node, ast.Name) and node.id in names:
                found |= self._at[file].get(node.lineno, set())
        return found

    def _closure(self, name: str) -> set[str]:
        """A kernel's file and the files of kernels that import from it."""
        closure = {name}
        while True:
            more = {f for f in self._files if f.endswith("kernels.py") and set(self._imports[f]) & closure} - closure
            if not more:
                return closure
            closure |= more

    def cache_for(self, mutant: dict[str, Any], base: Path) -> Path:
        """Compiled kernels; for a mutant of one, a copy without what it changes."""
        shared = base / "numba"
        if not mutant["file"].endswith("kernels.py"):
            return shared
        own = base / "numba-mutant"
        shutil.rmtree(own, ignore_errors=True)
        shutil.copytree(shared, own, copy_function=os.link)
        stems = tuple(f"{Path(one).stem}." for one in self._closure(mutant["file"]))
        for path in own.rglob("*"):
            if path.name.startswith(stems):
                path.unlink()
        return own

    def forget(self, cache: Path, base: Path) -> None:
        """Removes a mutant's kernels."""
        if cache != base / "numba":
            shutil.rmtree(cache, ignore_errors=True)


def _imports(tree: Path, name: str) -> dict[str, set[str]]:
    """Files of core/ that a file imports from, with the names."""
    found: dict[str, set[str]] = defaultdict(set)
    for node in ast.walk(ast.parse((tree / name).read_text("utf-8"))):
        if not isinstance(node, ast.ImportFrom) or not node.level:
            continue
        base = Path(name).parents[node.level - 1]
        base = base.joinpath(*node.module.split(".")) if node.module else base
        if (tree / base).with_suffix(".py").is_file():
            found[base.with_suffix(".py").as_posix()] |= {alias.asname or alias.name for alias in node.names}
        else:
            for alias in node.names:
                if (tree / base / f"{alias.name}.py").is_file():
                    found[(base / f"{alias.name}.py").as_posix()].add(alias.asname or alias.name)
    return found
