"""Cameras found in shaken photos, beside the true ones: `python -m benchmarks.shaken_cameras SET ... [--colmap]`.

SET holds `photos` (or `sharp`, with --photos), `transforms.json` and `manifest.json`, as `synthesize` and
`benchmarks.shaken_twin` write them. A line for each: photos that were placed, how far cameras' centres are off after
alignment (px at the scene's distance; median and worst), angles (degrees, median), the focal length's error, seconds,
and which recipe led there. --colmap: pycolmap's defaults, one lens for all photos, in the same line's form.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pycolmap
from dgs.core.camera import Camera
from dgs.core.errors import DgsError
from dgs.core.evaluation.poses import pose_errors
from dgs.core.formats.cameras import read_cameras
from dgs.core.photos.load import load_photos
from dgs.core.progress import Silent
from dgs.core.sfm.find import find_cameras
from dgs.core.sfm.settings import SfmSettings


def true_cameras(folder: Path) -> dict[str, Camera]:
    """By the photos' names."""
    return {Path(name).name: camera for name, camera in read_cameras(folder / "transforms.json").pinholes().items()}


def depths(folder: Path, cameras: Mapping[str, Camera]) -> dict[str, float]:
    """Of the scene before each camera: the manifest's, or else that of the point nearest to all cameras' axes."""
    through = json.loads((folder / "manifest.json").read_text(encoding="utf-8")).get("through", {})
    if all("depth" in through.get(name, {}) for name in cameras):
        return {name: through[name]["depth"] for name in cameras}
    axes = np.stack([camera.rotation[2] for camera in cameras.values()])
    centres = np.stack([camera.centre for camera in cameras.values()])
    across = np.eye(3) - axes[:, :, None] * axes[:, None, :]
    meeting = np.linalg.solve(across.sum(axis=0), (across @ centres[:, :, None]).sum(axis=0)[:, 0])
    return {name: float(np.linalg.norm(camera.centre - meeting)) for name, camera in cameras.items()}


def by_us(photos: Path, threads: int) -> tuple[dict[str, Camera], str]:
    """Cameras as `reconstruct` finds them, and by which recipe."""
    with tempfile.TemporaryDirectory() as work:
        found = find_cameras(
            load_photos(photos, None, Silent()), None, SfmSettings(threads=threads), Path(work), Silent()
        )
    tried = found.figures.attempts
    doubted = ", contradicted" if found.figures.doubted else ""
    best = max(tried, key=lambda each: (each.verdict == "trusted", each.registered * (1.0 - each.contradicted)))
    return dict(found.cameras()), f"{best.name}{doubted}, {len(tried)} tried"


def by_colmap(photos: Path, threads: int) -> tuple[dict[str, Camera], str]:
    """Cameras by pycolmap's defaults."""
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    lens, extraction, matching = (
        pycolmap.ImageReaderOptions(),
        pycolmap.FeatureExtractionOptions(),
        pycolmap.FeatureMatchingOptions(),
    )
    lens.camera_model, extraction.num_threads, matching.num_threads = "SIMPLE_RADIAL", threads, threads
    extraction.use_gpu = matching.use_gpu = False
    with tempfile.TemporaryDirectory() as work:
        database, mode = Path(work) / "database.db", pycolmap.CameraMode.SINGLE
        pycolmap.extract_features(
            database, photos, camera_mode=mode, reader_options=lens, extraction_options=extraction
        )
        pycolmap.match_exhaustive(database, matching)
        models = pycolmap.incremental_mapping(database, photos, Path(work))
        if not models:
            raise DgsError("no model")
        best = max(models.values(), key=lambda each: each.num_reg_images())
        (Path(work) / "model").mkdir()
        best.write_text(Path(work) / "model")
        return dict(read_cameras(Path(work) / "model").pinholes()), f"COLMAP, {len(models)} models"


def line(folder: Path, photos: str, threads: int, colmap: bool) -> str:
    """The table's line for one set."""
    true, started = true_cameras(folder), time.perf_counter()
    try:
        found, how = (by_colmap if colmap else by_us)(folder / photos, threads)
    except DgsError as error:
        return f"{folder.name:12s}  none in {time.perf_counter() - started:.0f} s: {error}"
    seconds = time.perf_counter() - started
    errors = pose_errors(found, true)
    depth = depths(folder, true)
    off = [e / depth[name] * true[name].fx for name, e in zip(errors.names, errors.centre, strict=True)]
    text = f"{folder.name:12s} {len(errors.names):3d} of {len(true):3d} {np.median(off):7.1f} {max(off):7.1f}"
    focal = 100 * float(np.median(errors.focal))
    return f"{text} {np.median(errors.angle):7.2f} {focal:+7.1f} % {seconds:7.0f}  {how}"


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("sets", type=Path, nargs="+", metavar="SET")
    parser.add_argument("--photos", default="photos", help="name of the folder of photos in each SET")
    parser.add_argument("--colmap", action="store_true")
    parser.add_argument("--threads", type=int, default=2)
    options = parser.parse_args()
    print(f"{'set':12s}  placed    px: median, worst  degrees   focal   seconds  recipe")
    for folder in options.sets:
        print(line(folder, options.photos, options.threads, options.colmap), flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
