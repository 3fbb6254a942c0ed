"""Sentences that errors hold, read from the source: constants and f-strings, with `{}` for what is filled in."""

from __future__ import annotations

import ast
import re
from collections.abc import Callable, Container, Iterable, Iterator
from dataclasses import dataclass, field
from functools import cache
from itertools import product
from pathlib import Path

from dgs.core import errors

#: Names of all classes of errors that are explained to the user.
ERRORS = frozenset(name for name, kind in vars(errors).items() if isinstance(kind, type))
#: Where else an error's sentences come from: functions that show what they are given, what such is kept in, and
#: functions that answer with them.
SHOWING, SHOWN = frozenset(("_failed", "_end", "_Died")), frozenset(("error", "_failure"))
ANSWERING = frozenset(("_unsaid", "_line", "_last_words", "_why_it_died"))
#: What is filled in.
PLACE = "{}"
#: A place that holds words of the source's own is one sentence for each of them; one that holds '5 px' is a place.
_WORD = re.compile("[A-Za-z]{3}")
#: Calls and names are followed so far.
_DEPTH = 6
#: Possibilities of one sentence at most; beyond, a part with several is a place.
_MOST = 12


@dataclass(frozen=True)
class Source:
    """A file, its tree, and what stands at its top.

    Attributes:
        path: of the file.
        tree: its syntax.
        functions: the functions in it by name, methods too.
        values: what its constants are, by name.
        imported: by name, (file, name there) of what comes from another file of the package.
    """

    path: Path
    tree: ast.Module
    functions: dict[str, ast.FunctionDef] = field(default_factory=dict)
    values: dict[str, ast.expr] = field(default_factory=dict)
    imported: dict[str, tuple[Path, str]] = field(default_factory=dict)


@cache
def source(path: Path) -> Source:
    """A file, read once."""
    read = Source(path, ast.parse(path.read_text("utf-8")))
    for node in ast.walk(read.tree):
        if isinstance(node, ast.FunctionDef):
            read.functions[node.name] = node
        elif isinstance(node, ast.ImportFrom) and node.level:
            read.imported.update(_imported(path, node))
    for statement in read.tree.body:
        if isinstance(statement, ast.Assign) and isinstance(statement.targets[0], ast.Name):
            read.values[statement.targets[0].id] = statement.value
    return read


def _imported(path: Path, node: ast.ImportFrom) -> Iterator[tuple[str, tuple[Path, str]]]:
    place = path.parents[node.level - 1].joinpath(*(node.module or "").split("."))
    for file in (place.with_suffix(".py"), place / "__init__.py"):
        if file.is_file():
            yield from ((alias.asname or alias.name, (file, alias.name)) for alias in node.names)


def raised_in(files: Iterable[Path]) -> dict[str, str]:
    """Every sentence that errors of these files may say, with where it stands: what happened, and the way out."""
    return _sentences_of(files, lambda read: (argument for call in _calls(read, ERRORS) for argument in call.args[:2]))


def shown_in(files: Iterable[Path]) -> dict[str, str]:
    """Every sentence that these files show in an error's place: what goes by the names below."""
    return _sentences_of(files, _shown)


def _sentences_of(files: Iterable[Path], said: Callable[[Source], Iterable[ast.expr]]) -> dict[str, str]:
    found: dict[str, str] = {}
    for read in map(source, files):
        within = _functions_around(read)
        for node in said(read):
            for text in Scope(read, within.get(node)).texts(node):
                for sentence in re.split(r"[.!] ", text):
                    if _WORD.search(sentence) and "()" not in sentence:  # (nothing is said in brackets)
                        found.setdefault(sentence.rstrip(". "), f"{read.path.name}:{node.lineno}")
    return found


def _functions_around(read: Source) -> dict[ast.AST, ast.FunctionDef]:
    """The innermost function around each part of a file."""
    within: dict[ast.AST, ast.FunctionDef] = {}
    for node in ast.walk(read.tree):  # (outer ones come first)
        if isinstance(node, ast.FunctionDef):
            within.update(dict.fromkeys(ast.walk(node), node))
    return within


def _calls(read: Source, names: Container[str]) -> Iterator[ast.Call]:
    return (node for node in ast.walk(read.tree) if isinstance(node, ast.Call) and _name(node.func) in names)


def _shown(read: Source) -> Iterator[ast.expr]:
    for call in _calls(read, SHOWING):
        yield from call.args
    yield from (value for target, value in _assigned(read.tree) if _name(target) in SHOWN)
    for node in ast.walk(read.tree):
        if isinstance(node, ast.Dict):
            held = zip(node.keys, node.values, strict=True)
            yield from (value for key, value in held if getattr(key, "value", "") == "text")
        elif isinstance(node, ast.FunctionDef) and node.name in ANSWERING:
            yield from (part.value for part in ast.walk(node) if isinstance(part, ast.Return) and part.value)


def _assigned(within: ast.AST) -> Iterator[tuple[ast.expr, ast.expr]]:
    """Variables, or attributes, and what they become."""
    for node in ast.walk(within):
        if isinstance(node, ast.Assign):
            target, value = node.targets[0], node.value
            several = isinstance(target, ast.Tuple) and isinstance(value, ast.Tuple)
            yield from zip(target.elts, value.elts, strict=True) if several else [(target, value)]
        elif isinstance(node, ast.NamedExpr):
            yield node.target, node.value


def _name(node: ast.expr) -> str:
    return str(getattr(node, "attr", getattr(node, "id", "")))


@dataclass(frozen=True)
class Scope:
    """Where an expression stands: what its names mean."""

    read: Source
    function: ast.FunctionDef | None
    depth: int = 0
    followed: frozenset[str] = frozenset()

    def texts(self, node: ast.expr) -> set[str]:
        """All that an expression may say; {PLACE} where the source does not tell."""
        found = {PLACE}
        if isinstance(node, ast.Constant):
            found = {node.value} if isinstance(node.value, str) else {PLACE}
        elif isinstance(node, ast.JoinedStr):
            found = self._joined([self._part(part) for part in node.values])
        elif isinstance(node, ast.BinOp) and isinstance(node.op, ast.Add):
            found = self._joined([self.texts(node.left), self.texts(node.right)])
        elif isinstance(node, ast.IfExp):
            found = self.any_of([node.body, node.orelse])
        elif isinstance(node, ast.BoolOp):
            found = self.any_of(node.values)
        elif isinstance(node, (ast.Name, ast.Call)) and self.depth < _DEPTH:
            found = self._named(node) if isinstance(node, ast.Name) else self._called(node)
        return found or {PLACE}

    def _joined(self, parts: list[set[str]]) -> set[str]:
        count = 1
        for part in parts:
            count *= len(part)
        if count > _MOST:
            parts = [part if len(part) == 1 else {PLACE} for part in parts]
        return {re.sub(r"({})+", PLACE, "".join(words)) for words in product(*parts)}

    def _part(self, node: ast.expr) -> set[str]:
        """A part of an f-string: a place, unless the source says in words what stands there."""
        if isinstance(node, ast.Constant):
            return {str(node.value)}
        assert isinstance(node, ast.FormattedValue)
        held = node.value
        found = {PLACE} if node.format_spec is not None else self.texts(held)
        if isinstance(held, ast.Name) and held.id.isupper():  # (a name or a number, unless it is a sentence)
            return found if all(" " in text for text in found) else {PLACE}
        return found if isinstance(held, ast.IfExp) or any(map(_WORD.search, found)) else {PLACE}

    def _named(self, node: ast.Name) -> set[str]:
        if node.id in self.followed:
            return {PLACE}
        inner = Scope(self.read, self.function, self.depth + 1, self.followed | {node.id})
        if self.function is not None:
            given = [*self.function.args.args, *self.function.args.kwonlyargs]
            assigned = [value for target, value in _assigned(self.function) if getattr(target, "id", "") == node.id]
            if assigned or any(argument.arg == node.id for argument in given):
                return inner.any_of(assigned)
        if node.id in self.read.values:
            return Scope(self.read, None, self.depth + 1).texts(self.read.values[node.id])
        if node.id in self.read.imported:
            path, name = self.read.imported[node.id]
            return Scope(source(path), None, self.depth + 1).texts(ast.Name(name))
        return {PLACE}

    def _called(self, node: ast.Call) -> set[str]:
        """What a function of the package may return; a dictionary's values where `get` asks one of constants."""
        if isinstance(node.func, ast.Attribute) and node.func.attr == "get" and isinstance(node.func.value, ast.Name):
            held = self.read.values.get(node.func.value.id)
            if isinstance(held, ast.Dict):
                return self.any_of([*held.values, *node.args[1:]])
        read, name = self.read, _name(node.func) if isinstance(node.func, ast.Name) else ""
        if name in read.imported:
            path, name = read.imported[name]
            read = source(path)
        function = read.functions.get(name)
        if function is None:
            return {PLACE}
        returned = [part.value for part in ast.walk(function) if isinstance(part, ast.Return) and part.value]
        return Scope(read, function, self.depth + 1).any_of(returned)

    def any_of(self, nodes: Iterable[ast.expr]) -> set[str]:
        """All that one of several expressions may say; None says nothing."""
        said = [self.texts(node) for node in nodes if getattr(node, "value", "") is not None]
        return set().union(*said) or {PLACE}


def strings_in(files: Iterable[Path]) -> set[str]:
    """All texts of these files, sentences or not."""
    found: set[str] = set()
    for read in map(source, files):
        for node in ast.walk(read.tree):
            if isinstance(node, (ast.JoinedStr, ast.Constant)):
                found |= Scope(read, None).texts(node)
    return found
