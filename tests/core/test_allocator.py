"""What a step frees is there for the next one, without the system fetching it anew."""

from __future__ import annotations

import os
import subprocess
import sys

import dgs
import pytest

#: Five images are taken and freed, as a step does; pages that the system fetched afterwards.
STEPS = """
import resource, sys
import numpy as np
from core.allocator import keep_freed_memory

if sys.argv[1] == "kept":
    assert keep_freed_memory()
for step in range(12):
    if step == 4:
        before = resource.getrusage(resource.RUSAGE_SELF).ru_minflt
    images = [np.ones(700_000, np.float32) for _ in range(5)]
    while images:
        images.pop()
print(resource.getrusage(resource.RUSAGE_SELF).ru_minflt - before)
"""


def pages_fetched(how: str) -> int:
    """By eight steps, after four that fill the heap; `how`: "kept" or "as usual"."""
    small_pages = os.environ | {"NUMPY_MADVISE_HUGEPAGE": "0"}
    command = [sys.executable, "-c", STEPS, how]
    done = subprocess.run(command, cwd=dgs.__path__[0], env=small_pages, capture_output=True, text=True, check=True)
    return int(done.stdout)


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="glibc only")
def test_steps_fetch_no_memory() -> None:
    """Without it eight steps fetch thousands of pages, as glibc trims the end of its heap every time."""
    assert pages_fetched("kept") < 100 < 1000 < pages_fetched("as usual")
