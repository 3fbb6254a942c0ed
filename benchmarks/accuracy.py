"""How sharp the twin becomes, against what else could be done with the same blurred photos.

    python -m benchmarks.accuracy --data FOLDER [--data FOLDER ...] [--seeds 3] [--steps 1000]

The same as `run_dgs.py compare FOLDER` for several sets (see `studies/comparison/methods.py` for the
methods); rows that are there already are not run again. Rows and pictures go to benchmarks/runs/,
tables to benchmarks/accuracy_<set>.json and .md.
"""

from __future__ import annotations

import argparse
import shutil
import sys
from pathlib import Path

HERE = Path(__file__).resolve().parent


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", default=[], metavar="FOLDER")
    parser.add_argument("--photos", help="name of the folder of blurred photos inside FOLDER")
    parser.add_argument("--psf", default="gaussian:5")
    parser.add_argument("--cameras", default="found", help="'found', 'known', or a camera model")
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--steps", type=int, help="instead of the product's own number")
    parser.add_argument("--gaussians", type=int, help="budget instead of the product's own")
    parser.add_argument("--only", action="append", default=[], metavar="METHOD", help="as named in the table")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    from dgs.command_line import run

    chosen = {"--photos": options.photos, "--steps": options.steps, "--max-gaussians": options.gaussians}
    shared = [word for name, value in chosen.items() if value for word in (name, str(value))]
    shared += [word for method in options.only for word in ("--only", method)]
    for folder in options.data:
        label = f"{folder.resolve().name}_{options.steps}" if options.steps else folder.resolve().name
        out = HERE / "runs" / label
        given = ["--psf", options.psf, "--cameras", options.cameras, "--seeds", str(options.seeds)]
        machine = ["--threads", str(options.threads), "--resume"]
        status = run(["compare", str(folder), "--out", str(out), *given, *machine, *shared])
        if status:
            return status
        for suffix in (".json", ".md"):
            shutil.copyfile(out / f"compare{suffix}", HERE / f"accuracy_{label}{suffix}")
        print((out / "compare.md").read_text("utf-8"))
    return 0


if __name__ == "__main__":
    sys.exit(main())
