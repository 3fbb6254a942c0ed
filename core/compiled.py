"""How numba kernels are compiled, cached and run on several threads.

Kernels are plain `nogil` functions over a range of items (`begin`, `end` first). They run on a
thread pool of our own rather than on numba's: it compiles faster, needs no OpenMP beside torch's,
and every item writes only its own slots, so the result does not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import os
import threading
from collections.abc import Callable, Sequence
from pathlib import Path
from queue import SimpleQueue
from typing import Any

from .kernel_cache import cache_folder


def _takes_files(folder: Path) -> bool:
    """Whether files can be kept in a folder, which is made if missing: a home may be read-only, or not be there."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return False
    return os.access(folder, os.R_OK | os.W_OK | os.X_OK)


os.environ.setdefault("NUMBA_CACHE_DIR", str(cache_folder()))
#: numba refuses to keep compiled code where it cannot; each process then compiles for itself.
_KEPT = _takes_files(Path(os.environ["NUMBA_CACHE_DIR"]))

import numba  # noqa: E402  (reads NUMBA_CACHE_DIR when it is imported)

#: Sums may be reordered and contracted (that is what lets them run in vector registers), but NaN
#: and infinity keep their meaning: guards test for them.
FAST_MATH = {"reassoc", "contract", "nsz", "arcp"}


def kernel(function: Callable[..., Any]) -> Any:
    """Compiles `function` without the GIL, cached on disk where that takes files, with C's division."""
    return numba.njit(nogil=True, cache=_KEPT, error_model="numpy", fastmath=FAST_MATH)(function)


def inlined(function: Callable[..., Any]) -> Any:
    """A helper that kernels call; LLVM inlines it."""
    return numba.njit(nogil=True, error_model="numpy", fastmath=FAST_MATH, inline="never")(function)


def exact(function: Callable[..., Any]) -> Any:
    """A helper whose sums are rounded as they are written, in whichever kernel it is inlined: two kernels agree."""
    return numba.njit(nogil=True, error_model="numpy", inline="never")(function)


#: A compiled kernel, how many items it has, and its arguments.
Task = tuple[Callable[..., Any], int, tuple[Any, ...]]


class _Shared:
    """The items of a call in chunks, handed out to whoever has time: the caller and threads that help it."""

    def __init__(self, tasks: Sequence[Task], grain: int, threads: int) -> None:
        """`grain`: items of the smallest chunks; the first ones are the largest."""
        chunks = []
        left = sum(items for _, items, _ in tasks)
        for function, items, arguments in tasks:
            begin = 0
            while begin < items:
                end = min(items, begin + max(grain, -(-left // (_PARTS * threads))))
                chunks.append((function, begin, end, arguments))
                left -= end - begin
                begin = end
        self._chunks = iter(chunks)
        self._take = threading.Lock()
        self._helping, self._closed = 0, False
        self._ended: SimpleQueue[BaseException | None] = SimpleQueue()

    def work(self) -> None:
        """Works until nothing is left to begin."""
        while True:
            with self._take:
                chunk = next(self._chunks, None)
            if chunk is None:
                return
            function, begin, end, arguments = chunk
            function(begin, end, *arguments)

    def help(self) -> None:
        """`work` on another thread, unless the caller is done without it."""
        with self._take:
            if self._closed:
                return
            self._helping += 1
        error: BaseException | None = None
        try:
            self.work()
        except BaseException as raised:  # noqa: BLE001  the caller raises it
            error = raised
        self._ended.put(error)

    def close(self) -> None:
        """Waits for those who help, and raises what one of them did."""
        with self._take:
            self._closed = True
        errors = [self._ended.get() for _ in range(self._helping)]
        for error in errors:
            if error is not None:
                raise error


class _Helpers:
    """Threads that wait for work, made when first asked for.

    An executor's futures take longer to hand over than a small kernel to run.
    """

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._count = 0
        self._inbox: SimpleQueue[_Shared] = SimpleQueue()

    def ask(self, shared: _Shared, count: int) -> None:
        """Has `count` threads help, or as many as can be had."""
        if self._count < count:
            with self._lock, contextlib.suppress(RuntimeError):  # no thread can be had, as when the interpreter ends
                while self._count < count:
                    name = f"dgs-kernel-{self._count}"
                    threading.Thread(target=self._serve, name=name, daemon=True).start()
                    self._count += 1
        for _ in range(min(count, self._count)):
            self._inbox.put(shared)

    def _serve(self) -> None:
        while True:
            self._inbox.get().help()


_helpers = _Helpers()
_threads = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


#: A chunk is such a part of a thread's share of what is left: few calls, and yet nobody waits long for the last one.
_PARTS = 2
#: Px of whole photos that are worked on at once: two of 24 megapixels, as many as two threads take. Chosen, not
#: measured: the bounds of --memory were measured with small photos, which it leaves alone.
_PIXELS_AT_ONCE = 50_000_000


def threads() -> int:
    """Number of threads that kernels use."""
    return _threads


def photos_at_once(pixels: int) -> int:
    """How many photos of so many px may be worked on side by side, one to a thread: all together no more than
    `_PIXELS_AT_ONCE`, so that many threads do not take many times the memory."""
    return max(1, min(_threads, _PIXELS_AT_ONCE // max(1, pixels)))


def set_threads(count: int) -> None:
    """Sets the number of threads of all kernels (torch keeps its own setting)."""
    global _threads
    if count < 1:
        raise ValueError(f"threads must be at least 1, not {count}")
    _threads = count


def run(function: Callable[..., Any], items: int, *arguments: Any, grain: int = 1) -> None:
    """Calls `function(begin, end, *arguments)` over all of `range(items)`, on all threads.

    Args:
        function: a compiled kernel whose items write only to their own slots.
        items: number of items.
        grain: smallest number of items that is worth a call of its own (a call costs ~10 us).

    Chunks are handed out as threads become free, so that dense tiles do not hold up the rest.
    """
    run_all([(function, items, arguments)], grain)


def run_all(tasks: Sequence[Task], grain: int = 1) -> None:
    """`run` for several kernels that do not wait for each other: threads are called together once for all of them."""
    count = min(_threads, max(1, sum(items for _, items, _ in tasks) // max(1, grain)))
    if count == 1:
        for function, items, arguments in tasks:
            function(0, items, *arguments)
        return
    shared = _Shared(tasks, grain, count)
    _helpers.ask(shared, count - 1)
    try:
        shared.work()  # the caller is one of the threads
    finally:
        shared.close()
