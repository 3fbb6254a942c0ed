"""Measurements that the docs quote; each runs from the repository's root: `python -m benchmarks.NAME`."""

import os

# Spinning threads slow a shared machine tenfold, and the small fits are a thousand 2 x 2 systems.
os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import run_dgs

run_dgs.mount_package()
