"""How well cameras are found: a line per data set.

    python -m benchmarks.sfm --data FOLDER [--data FOLDER ...] [--sigma 5] [--threads 2]

FOLDER holds `blur5/` (photos) and, to compare with, `reference_cameras/` (a COLMAP model or a
transforms.json); folders that are not there are skipped. px-eq: the error of a camera's centre over
the depth of its scene times the focal length, after alignment (see core/evaluation/poses.py). cpu: seconds
of processor time in all threads, which other programs disturb less than the seconds on the clock.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from dgs.core.errors import DgsError
from dgs.core.evaluation.poses import pose_errors
from dgs.core.photos.load import load_photos
from dgs.core.progress import Silent
from dgs.core.sfm.find import find_cameras
from dgs.core.sfm.given import load_cameras
from dgs.core.sfm.settings import SfmSettings


def gaussian(sigma: float) -> np.ndarray | None:
    """[k, k] kernel, None for 0."""
    if sigma == 0.0:
        return None
    x = np.arange(-int(np.ceil(4 * sigma)), int(np.ceil(4 * sigma)) + 1)
    line = np.exp(-(x**2) / (2 * sigma**2))
    return np.asarray(np.outer(line, line) / line.sum() ** 2)


def _processor_time() -> float:
    """Of this process and of its children that ended, in s."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def line(folder: Path, photos_name: str, sigma: float, threads: int) -> str:
    """The table's line for one data set."""
    photos = load_photos(folder / photos_name, None, Silent())
    started, spent = time.perf_counter(), _processor_time()
    with tempfile.TemporaryDirectory() as work:
        try:
            found = find_cameras(photos, gaussian(sigma), SfmSettings(threads=threads), Path(work), Silent())
        except DgsError as error:
            return f"{folder.name:12s}  {type(error).__name__}: {error}"
    seconds, spent = time.perf_counter() - started, _processor_time() - spent
    figures = found.figures
    text = f"{folder.name:12s} {len(found.names):4d} of {len(photos):3d}"
    reference = folder / "reference_cameras"
    if reference.exists():
        truth = load_cameras(reference, photos)
        errors = pose_errors(found.cameras(), truth.cameras(), truth.points.positions)
        text += f"  {100 * np.median(errors.focal):+6.2f} %  {np.nanmedian(errors.centre_px):6.2f}"
        text += f"  {np.median(errors.angle):6.3f}"
    else:
        text += f"  {figures.focal_px:6.0f} px       -       -"
    return text + f"  {figures.reprojection_px:6.2f}  {seconds:7.1f}  {spent:5.1f}  {figures.attempts[-1].name}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, action="append", default=[], metavar="FOLDER")
    parser.add_argument("--photos", default="blur5", help="name of the folder of photos inside FOLDER")
    parser.add_argument("--sigma", type=float, default=5.0, help="of the Gaussian blur in px; 0: none")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    print(f"{'set':12s}  registered   focal    centre px-eq  angle deg  reproj px  seconds    cpu  recipe")
    for folder in options.data:
        if not (folder / options.photos).is_dir():
            print(f"{folder.name:12s}  skipped: there is no '{options.photos}' in it")
            continue
        print(line(folder, options.photos, options.sigma, options.threads), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
