"""The order of a view's splats: sorted at once where that is quick, else by a thread. Knows no Blender."""

from __future__ import annotations

import threading
from collections.abc import Callable

from .splats import Order

#: Splats that are sorted while the view waits: up to so many that takes no longer than the window's own drawing (40,000
#: some milliseconds). More are sorted by a thread, and drawn in their last order until then.
AT_ONCE = 300_000


class Sorter:
    """One view's order."""

    def __init__(self) -> None:
        self._order: Order | None = None
        self._wanted: tuple[tuple[object, object], Callable[[], Order]] | None = None
        self._lock = threading.Lock()
        self._thread: threading.Thread | None = None

    def order(self, key: tuple[object, object], count: int, sort: Callable[[], Order]) -> Order:
        """The order that is wanted, or the last one of the same splats while a thread sorts.

        Args:
            key: the splats, and how they stand.
            count: splats; sort: makes the order, which has that key.
        """
        with self._lock:
            last = self._order
        if last is not None and last.key == key:
            return last
        if count <= AT_ONCE or last is None or last.key[0] != key[0]:
            order = sort()
            with self._lock:
                self._order, self._wanted = order, None
            return order
        with self._lock:
            self._wanted = key, sort
            if self._thread is None:
                self._thread = threading.Thread(target=self._run, name="descatter-order", daemon=True)
                self._thread.start()
        return last

    @property
    def busy(self) -> bool:
        """Whether a thread sorts."""
        with self._lock:
            return self._thread is not None

    def _run(self) -> None:
        while True:
            with self._lock:
                wanted = self._wanted
                if wanted is None:
                    self._thread = None
                    return
            order = wanted[1]()
            with self._lock:
                if self._wanted is wanted:
                    self._order, self._wanted = order, None
                elif self._wanted is not None:  # (the view has turned on; still better than the last one)
                    self._order = order
