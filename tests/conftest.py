"""Makes the project importable as `dgs` for every test, whatever the clone is called.

What tests share is imported the same way (`dgs.tests...`, `dgs.benchmarks...`); pyproject.toml shows pytest where
`run_dgs` is.
"""

import gc
import os
import tempfile
from collections.abc import Iterator
from pathlib import Path

import pytest

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import run_dgs

run_dgs.mount_package()
# Files of tests import torch: half a million objects, through which no garbage is looked for, neither now nor later.
gc.disable()


def pytest_collection_finish() -> None:
    """All is imported."""
    gc.freeze()
    gc.enable()


@pytest.fixture
def memory_path() -> Iterator[Path]:
    """As `tmp_path`, on a disk in memory where there is one: hundreds of syncs take no time there."""
    shared = "/dev/shm"
    with tempfile.TemporaryDirectory(dir=shared if os.access(shared, os.W_OK) else None) as folder:
        yield Path(folder)
