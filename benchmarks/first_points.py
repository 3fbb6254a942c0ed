"""What the first Gaussians are worth: `python -m benchmarks.first_points --data PHOTOS --cameras MODEL ...`.

The cameras' own points with photos lifted between them ('lifted', what a run does where it finds no surface), against
samples of the surfaces around those points ('seeded', what it does). Both are trained with the same preset and seeds,
and scored on the photos held out. A start's settings may be changed: 'seeded,planes=24,band=0.3'.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.photos.load import Photo, load_photos
from dgs.core.photos.undistort import undistorted_views
from dgs.core.photos.write import photo_stem, write_png
from dgs.core.pipeline.views import Viewer, to_pixels
from dgs.core.progress import Silent
from dgs.core.reconstruction import Reconstruction
from dgs.core.sfm.given import load_cameras
from dgs.core.surface.seeded import SETTINGS, seeded_surface
from dgs.core.training.job import TrainingJob
from dgs.core.training.run import Trained, train
from dgs.core.training.scale import scene_scale
from dgs.core.training.settings import TrainingSettings
from dgs.core.views import SparsePoints, heldout_names


@dataclass(frozen=True)
class LoadedSet:
    """Photos with cameras, what blurs them, the names of those held out, and sharp px by name without extension."""

    photos: list[Photo]
    cameras: Reconstruction
    medium: Medium
    held: list[str]
    truth: dict[str, np.ndarray]


def loaded(options: argparse.Namespace) -> LoadedSet:
    """Reads the set."""
    photos = load_photos(options.data, options.max_size, Silent())
    cameras = load_cameras(options.cameras, photos)
    photos = [photo for photo in photos if photo.name in cameras.poses]
    medium = Medium(parse_psf(options.psf)).at_scales({photo.name: photo.scale[0] for photo in photos})
    truth = photos if options.truth is None else load_photos(options.truth, options.max_size, Silent())
    held = heldout_names([photo.name for photo in photos], 8)
    return LoadedSet(photos, cameras, medium, held, {photo_stem(photo.name): photo.pixels for photo in truth})


def begun(start: str, data: LoadedSet) -> tuple[SparsePoints, str]:
    """The points of a start, and a word on what was found."""
    points = data.cameras.points
    name, *changes = start.split(",")
    if name == "lifted":
        return points, f"{len(points.positions)} points"
    pairs = dict(change.split("=") for change in changes)
    sides = {"longest_side": (int(pairs.pop("longest_side")),) * 2} if "longest_side" in pairs else {}
    plain = {key: type(getattr(SETTINGS, key))(value) for key, value in pairs.items()}
    settings = replace(SETTINGS, **plain, **sides)
    seen = [photo for photo in data.photos if photo.name not in data.held]
    found = seeded_surface(seen, data.cameras, data.medium, Silent(), settings)
    if found is None:
        return points, "no surface"
    words = f"{found.share:.0%} confirmed, {len(found.samples.positions)} samples"
    return replace(points, samples=found.samples), words


def trained_from(points: SparsePoints, data: LoadedSet, options: argparse.Namespace, seed: int) -> Trained:
    """The twin."""
    settings = replace(TrainingSettings.preset(options.preset), seed=seed, threads=options.threads)
    if options.steps:
        settings = replace(settings, steps=options.steps)
    views = undistorted_views(data.photos, data.cameras)
    fitted = [view for view in views if view.name not in data.held]
    return train(TrainingJob(fitted, [], points, data.medium, settings), Silent())


def scores(twin: Trained, data: LoadedSet, out: Path | None) -> list[float]:
    """PSNR (dB) of each view held out, sharp; its picture goes to `out`."""
    scale = scene_scale(list(data.cameras.cameras().values()), data.cameras.points)
    viewer = Viewer(twin.gaussians, scale, "cpu", twin.low_pass, twin.background)
    found = []
    for name in data.held:
        image = to_pixels(viewer.sharp(data.cameras.lenses[name], data.cameras.poses[name]))
        error = (image.astype(float) - data.truth[photo_stem(name)]) / 255.0
        found.append(float(-10 * np.log10((error**2).mean())))
        if out is not None:
            out.mkdir(parents=True, exist_ok=True)
            write_png(out / f"{photo_stem(name)}.png", image)
    return found


def main() -> int:
    """One line for each start: medians over seeds."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of photos")
    parser.add_argument("--cameras", type=Path, required=True, help="their cameras, with points")
    parser.add_argument("--truth", type=Path, help="sharp photos of the same names")
    parser.add_argument("--psf", default="none")
    parser.add_argument("--max-size", type=int)
    parser.add_argument("--preset", default="draft")
    parser.add_argument("--steps", type=int)
    parser.add_argument("--seeds", type=int, default=1)
    parser.add_argument("--threads", type=int, default=2)
    parser.add_argument("--starts", nargs="+", default=["lifted", "seeded"])
    parser.add_argument("--out", type=Path, help="folder for pictures of the views held out")
    options = parser.parse_args()
    data = loaded(options)
    print(f"{options.data}: {len(data.photos)} photos, {len(data.held)} held out, {data.photos[0].size} px", flush=True)
    for start in options.starts:
        began = time.process_time()
        points, words = begun(start, data)
        taken = time.process_time() - began
        rows = []
        for seed in range(options.seeds):
            began = time.process_time()
            twin = trained_from(points, data, options, seed)
            own = time.process_time() - began
            out = None if options.out is None else options.out / start / str(seed)
            psnr = scores(twin, data, out)
            rows.append((np.mean(psnr), min(psnr), own))
        mean, worst, own = np.median(np.array(rows), axis=0)
        each = ", ".join(f"{row[0]:.2f} ({row[1]:.2f})" for row in rows)
        seconds = f"processor seconds {taken:.1f} + {own:.1f}"
        print(f"{start}: {mean:.2f} dB, worst view {worst:.2f} [{each}]; {seconds}; {words}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
