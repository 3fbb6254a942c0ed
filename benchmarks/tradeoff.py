"""`make tradeoff`: what every knob costs in time and brings, on one or more sets; hours, resumable.

python -m benchmarks.tradeoff --data FOLDER [--data FOLDER ...] [--out FOLDER] [--quick] [--seeds N]
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent


def main() -> int:
    """One run of the command per set; the first failure ends it."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", help="set with blurred and sharp photos")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks" / "runs" / "tradeoff")
    options, rest = parser.parse_known_args()
    for data in options.data or [ROOT / "benchmarks" / "data" / "ball_small"]:
        own = ["--psf", "gaussian:5"] if not (data / "psf.json").is_file() and "--psf" not in rest else []
        command = [
            sys.executable,
            str(ROOT / "run_dgs.py"),
            "tradeoff",
            str(data),
            "--out",
            str(options.out / data.name),
            "--resume",
            *own,
            *rest,
        ]
        print(" ".join(command), flush=True)
        status = subprocess.run(command, check=False).returncode
        if status:
            return status
    return 0


if __name__ == "__main__":
    sys.exit(main())
