"""A card is made ready on a thread of its own, while a run still reads photos.

Drivers, shaders and what torch loads for a card take seconds at first use. What goes wrong in the meantime is not said:
whoever uses the card then meets it again, and says it.
"""

from __future__ import annotations

import threading

from .devices import REGISTRY, BackendName, backend_named, quick_devices

#: The thread that makes devices ready; None where none does any more.
_under_way: threading.Thread | None = None


def begin_warming(device: BackendName, free: bool) -> None:
    """Begins to make ready what a training may go to; nothing where that is the processor alone.

    Args:
        device: that a run computes on; free: whether its training may go to another one.
    """
    global _under_way
    if _under_way is None and (free or not REGISTRY[device].unasked):
        _under_way = threading.Thread(target=_warm, args=(None if free else device,), name="dgs-warming")
        _under_way.start()


def finish_warming() -> None:
    """Waits until nothing is made ready any more; the thread that does it waits for nothing."""
    global _under_way
    thread = _under_way
    if thread is not None and thread is not threading.current_thread():
        thread.join()
        _under_way = None


def _warm(device: BackendName | None) -> None:
    """The device, or all that a training may be tried on unasked."""
    try:
        for name in quick_devices() if device is None else (device,):
            backend_named(name).warm()
    except Exception:  # noqa: BLE001  its first use meets it again, where somebody hears of it
        pass
