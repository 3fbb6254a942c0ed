"""What runs inside a Dask worker, which may not have heard of this package: this file is sent to it.

So it uses the standard library and Dask only, until it has found this program where the client has it.
"""

from __future__ import annotations

import importlib
import importlib.util
import time
from collections.abc import Sequence
from typing import Any

from distributed import Event, get_client

#: How a command ended, in plain values: status, why, what it made.
Plain = tuple[int, str, dict[str, Any]]


def run_words(program: str, folder: str, words: Sequence[str], stop: str) -> Plain | None:
    """Runs one command to its end, and once more where a signal ended it.

    Args:
        program: path of `run_dgs.py`, the same on all machines.
        folder: that relative paths in the words start from.
        words: behind it.
        stop: name of the event by which the client asks to stop.

    Returns:
        How it ended; None where it was not begun, as the client had asked to stop.
    """
    event, heard = Event(stop, client=get_client()), {"stop": False, "at": 0.0}

    class Listening:
        def stage(self, name: str, total: int | None = None) -> None: ...

        def advance(self, done: int, **figures: float) -> None: ...

        def note(self, text: str) -> None: ...

        def cancelled(self) -> bool:
            if not heard["stop"] and time.monotonic() - heard["at"] >= 1.0:
                heard.update(stop=bool(event.is_set()), at=time.monotonic())
            return bool(heard["stop"])

    spec = importlib.util.spec_from_file_location("run_dgs", program)
    assert spec is not None and spec.loader is not None
    run_dgs = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(run_dgs)
    run_dgs.mount_package()
    run_child = importlib.import_module(f"{run_dgs.PACKAGE}.command_line.child_run").run_child
    progress = Listening()
    if progress.cancelled():
        return None
    ended = run_child(words, progress, folder)
    if ended.status < 0 and not progress.cancelled():
        ended = run_child(words, progress, folder)
    return ended.status, ended.line, ended.result
