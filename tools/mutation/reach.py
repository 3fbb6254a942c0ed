"""Which tests run which lines: a plugin of pytest that traces the files under test, one test after the other.

What a fixture of a module or a session runs counts for every test of the file that asked for it first. Lines of
compiled kernels and of child processes are not seen.
"""

from __future__ import annotations

import sys
import threading
from collections import defaultdict
from collections.abc import Callable, Iterator
from types import FrameType
from typing import Any

import pytest

Lines = dict[str, set[int]]


class Reach:
    """Collects lines by test, and each test's seconds and outcome.

    Args:
        root: absolute path of the tree, with a slash at its end.
        watched: files, relative to the tree.
    """

    def __init__(self, root: str, watched: set[str]) -> None:
        self._watched = {root + name: name for name in watched}
        self._now: Lines = defaultdict(set)
        self.lines: dict[str, Lines] = {}
        self.shared: dict[str, Lines] = {}
        self.seconds: dict[str, float] = defaultdict(float)
        self.failed: set[str] = set()

    def _trace(self, frame: FrameType, event: str, argument: Any) -> Callable[..., Any] | None:
        del event, argument
        name = self._watched.get(frame.f_code.co_filename)
        if name is None:
            return None
        now = self._now[name]

        def each(inner: FrameType, kind: str, value: Any) -> Callable[..., Any]:
            del value
            if kind == "line":
                now.add(inner.f_lineno)
            return each

        if frame.f_code.co_name != "<module>":
            return each
        return None

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self._now = self.lines[item.nodeid] = defaultdict(set)
        threading.settrace(self._trace)
        sys.settrace(self._trace)
        try:
            return (yield)
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any, request: pytest.FixtureRequest) -> Iterator[Any]:
        if fixturedef.scope == "function":
            return (yield)
        before, self._now = self._now, self.shared.setdefault(request.node.nodeid, defaultdict(set))
        try:
            return (yield)
        finally:
            self._now = before

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.seconds[report.nodeid] += report.duration
        if report.failed:
            self.failed.add(report.nodeid)

    def table(self) -> dict[str, Any]:
        """All of it, for JSON; a test that did not pass is left out."""

        def listed(lines: Lines) -> dict[str, list[int]]:
            return {name: sorted(found) for name, found in lines.items() if found}

        return {
            "tests": {
                test: {"seconds": self.seconds[test], "lines": listed(lines)}
                for test, lines in self.lines.items()
                if test not in self.failed
            },
            "shared": {node: listed(lines) for node, lines in self.shared.items()},
            "failed": sorted(self.failed),
        }
