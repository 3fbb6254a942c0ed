"""`python -m studies.benchmark`: from the repository's root; it mounts the package and hands it the commands."""

import os
import sys

os.environ.setdefault("OMP_WAIT_POLICY", "passive")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import run_dgs

run_dgs.mount_package()
from dgs.command_line import run  # noqa: E402
from dgs.studies.benchmark.run import main  # noqa: E402

if __name__ == "__main__":
    sys.exit(main(run))
