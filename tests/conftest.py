"""Makes the project importable as `dgs` for every test, whatever the clone is called.

What tests share is imported the same way (`dgs.tests...`, `dgs.benchmarks...`); pyproject.toml shows pytest where
`run_dgs` is.
"""

import os

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import run_dgs

run_dgs.mount_package()
