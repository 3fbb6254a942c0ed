"""Which evaluation measured fastest on this machine, kept from run to run.

Evaluations differ in the last bits, and measured times differ from run to run: were the choice made
anew each time, the same job could end in other bits. So it is measured once per machine, shape,
kernel and number of threads, and read from a small JSON file afterwards.
"""

from __future__ import annotations

import hashlib
import json
import logging
import os
import platform
import tempfile
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

from ..files import read_json
from ..kernel_cache import cache_base
from ..version import VERSION

_chosen: dict[str, str] = {}
#: Views are scored side by side: were each measured, all would take as many times longer, and measure one another.
_measuring = threading.RLock()


def choice(kernel: bytes, *circumstances: Any, names: list[str], measure: Callable[[], str]) -> str:
    """The remembered choice out of `names`; `measure` is asked the first time only."""
    parts = [VERSION, _processor(), hashlib.sha256(kernel).hexdigest()[:16], *circumstances, *sorted(names)]
    key = " | ".join(str(part) for part in parts)
    with _measuring:
        if key not in _chosen:
            path = cache_base() / "evaluations.json"
            known = read_choices(path)
            if known.get(key) not in names:
                known[key] = measure()
                _write(path, known)
            _chosen[key] = known[key]
        return _chosen[key]


def _processor() -> str:
    try:
        for line in Path("/proc/cpuinfo").read_text("utf-8").splitlines():
            if line.startswith("model name"):
                return line.split(":", 1)[1].strip()
    except OSError:  # other systems than Linux have no such file
        pass
    return platform.processor() or platform.machine()


def read_choices(path: Path) -> dict[str, str]:
    """The choices kept in a file; none where it is missing or damaged."""
    try:
        known = read_json(path)
    except (OSError, ValueError):  # none yet, or cut off: measured again
        return {}
    return known if isinstance(known, dict) else {}


def _write(path: Path, known: dict[str, str]) -> None:
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        handle, name = tempfile.mkstemp(dir=path.parent, suffix=".json")
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(known, file, indent=1, sort_keys=True)
        os.replace(name, path)
    except OSError as error:
        logging.getLogger(__name__).warning("The choice of blur cannot be kept in %s: %s", path, error)
