"""When this process began, and how much of the machine others use."""

from __future__ import annotations

import os
import time
from pathlib import Path

from ..machine import cores

_imported = time.perf_counter()


def process_began() -> float:
    """On the clock of `time.perf_counter`: when this process was started; when this was imported, where none says."""
    try:
        fields = Path("/proc/self/stat").read_text("utf-8").rpartition(")")[2].split()
        up = float(Path("/proc/uptime").read_text("utf-8").split()[0])
        age = up - int(fields[19]) / os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, IndexError, AttributeError):
        return _imported
    return time.perf_counter() - max(0.0, age)


class OthersLoad:
    """Share of the cores that other processes have kept busy since this was made; None where none says."""

    def __init__(self) -> None:
        self._before = _busy()

    def share(self) -> float | None:
        """0: the machine is ours; 1: others use all cores."""
        before, after = self._before, _busy()
        if before is None or after is None or after[0] - before[0] < 0.05:
            return None
        wall, own, busy = (b - a for a, b in zip(before, after, strict=True))
        return min(1.0, max(0.0, (busy - own) / (wall * max(1, os.cpu_count() or cores()))))


def _busy() -> tuple[float, float, float] | None:
    """(wall, own processor, everybody's processor) in seconds; children count as ours once they have ended."""
    try:
        first = Path("/proc/stat").read_text("utf-8").split("\n", 1)[0].split()[1:]
        ticks = [int(value) for value in first]
        own = os.times()
        unit = os.sysconf("SC_CLK_TCK")
    except (OSError, ValueError, AttributeError):
        return None
    everybody = (sum(ticks[:3]) + sum(ticks[5:7])) / unit  # user, nice, system, interrupts; not idle, not stolen
    return time.perf_counter(), own.user + own.system + own.children_user + own.children_system, everybody
