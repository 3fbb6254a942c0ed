"""How large packages are imported. Needs nothing."""

from __future__ import annotations

import gc
import sys
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def large_imports() -> Iterator[None]:
    """No garbage is looked for meanwhile, nor later in what came.

    Torch brings half a million objects that stay for good. Looking through them while they come, again and again,
    takes a fifth of a command's start.
    """
    if "torch" in sys.modules or not gc.isenabled():
        yield
        return
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
