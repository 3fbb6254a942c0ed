"""Where compiled kernels and what else can be computed again are kept. Needs nothing, so that Blender can ask, too."""

from __future__ import annotations

import hashlib
import os
from pathlib import Path


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


def is_compiled(module: str) -> bool:
    """Whether kernels of a module ('packing_kernels') lie in the cache, as they are in their sources now."""
    return any(cache_folder().glob(f"*/{module}.*.nbi"))
