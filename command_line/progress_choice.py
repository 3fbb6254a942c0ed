"""Picks how a command reports its progress."""

from __future__ import annotations

import sys
from types import TracebackType
from typing import Protocol, Self

from ..core.progress import Progress
from .interruption import Interruption


class Reporting(Progress, Protocol):
    """A `Progress` of the command line: it is entered and left, and hears how the command ended."""

    def __enter__(self) -> Self: ...

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None: ...

    def finished(self, result: dict[str, object]) -> None:
        """The command ended well; what it wrote, and key figures."""

    def failed(self, line: str, status: int) -> None:
        """The command ended with this one-line error and exit status."""


def choose_progress(kind: str, interruption: Interruption) -> Reporting:
    """'auto' (bars on a terminal, else a line per stage), 'json' (lines on stdout) or 'none'."""
    if kind == "json":
        from .progress_json import JsonLines  # late: only the kind that is asked for

        return JsonLines(sys.stdout, interruption)
    if kind == "auto" and sys.stderr.isatty():
        from .progress_bars import Bars  # late: only the kind that is asked for

        return Bars(interruption)
    from .progress_lines import Lines  # late: only the kind that is asked for

    return Lines(sys.stderr if kind == "auto" else None, sys.stdout, interruption)
