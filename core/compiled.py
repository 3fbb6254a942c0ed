"""How numba kernels are compiled, cached and run on several threads.

Kernels are plain `nogil` functions over a range of items (`begin`, `end` first). They run on a
thread pool of our own rather than on numba's: it compiles faster, needs no OpenMP beside torch's,
and every item writes only its own slots, so the result does not depend on the number of threads.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import threading
from collections.abc import Callable
from concurrent.futures import Future, ThreadPoolExecutor
from pathlib import Path
from typing import Any


def cache_folder() -> Path:
    """Cache of compiled code, keyed by the kernels' sources.

    numba notices a change in a kernel's own file only; a changed constant or inlined helper in
    another file would go unnoticed.
    """
    core = Path(__file__).parent
    digest = hashlib.sha256()
    for source in [core / "constants.py", *sorted(core.glob("**/*kernels*.py"))]:
        digest.update(source.read_bytes())
    return cache_base() / "numba" / digest.hexdigest()[:16]


def cache_base() -> Path:
    """The user's cache folder for what can be computed again."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "dgs"


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


_lock = threading.Lock()
_pool: ThreadPoolExecutor | None = None
_pool_size = 0
_threads = max(1, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1)


def threads() -> int:
    """Number of threads that kernels use."""
    return _threads


def set_threads(count: int) -> None:
    """Sets the number of threads of all kernels (torch keeps its own setting)."""
    global _threads
    if count < 1:
        raise ValueError(f"threads must be at least 1, not {count}")
    _threads = count


def _workers(count: int) -> ThreadPoolExecutor:
    global _pool, _pool_size
    with _lock:
        if _pool is None or _pool_size < count:
            _pool = ThreadPoolExecutor(count, thread_name_prefix="dgs-kernel")
            _pool_size = count
        return _pool


def run(function: Callable[..., Any], items: int, *arguments: Any, grain: int = 1) -> None:
    """Calls `function(begin, end, *arguments)` over all of `range(items)`, on all threads.

    Args:
        function: a compiled kernel whose items write only to their own slots.
        items: number of items.
        grain: smallest number of items that is worth a call of its own (a call costs ~10 us).

    Chunks are handed out as threads become free, so that dense tiles do not hold up the rest.
    """
    count = min(_threads, max(1, items // max(1, grain)))
    if count == 1:
        function(0, items, *arguments)
        return
    chunk = max(grain, -(-items // (count * 4)))
    starts = iter(range(0, items, chunk))
    take = threading.Lock()

    def work() -> None:
        while True:
            with take:
                begin = next(starts, None)
            if begin is None:
                return
            function(begin, min(begin + chunk, items), *arguments)

    futures: list[Future[None]] = []
    with contextlib.suppress(RuntimeError):  # no thread can be had, as when the interpreter ends: fewer do the work
        futures.extend(_workers(count).submit(work) for _ in range(count - 1))
    work()  # the caller is one of the threads
    for future in futures:
        future.result()
