"""How wrong cameras may be for the loss to mend them: `python -m benchmarks.pose_basin`.

The tests' bumpy plane, 12 photos of 112 x 96 px, every camera shaken by so many px (turned and shifted at random),
with the blur and without; or, with --photos FOLDER --cameras MODEL --sigma 5, photos of your own, whose cameras are
shaken. Prints by how many px the cameras lay the scene's points wrong (median over photos) before and after, after the
best similarity and in the world as it was given, whether the refined cameras were kept, and how far photos lay off
their twin's views.
"""

from __future__ import annotations

import argparse
import itertools
import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import torch
from dgs.core import compiled
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import pose_errors
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.photos.load import load_photos
from dgs.core.photos.undistort import undistorted_views
from dgs.core.progress import Silent
from dgs.core.sfm.given import load_cameras
from dgs.core.training.cameras.pose_steps import twisted
from dgs.core.training.settings import TrainingSettings
from dgs.core.twin.refine_cameras import refine_cameras
from dgs.tests.core.training.training_scenes import Scene, blurred_scene

ROOT = Path(__file__).resolve().parents[1]


def shaken(scene: Scene, px: float, seed: int) -> Scene:
    """Every camera turned and shifted by about `px` in all."""
    random = np.random.default_rng(seed)
    views = []
    for view in scene.views:
        depth = (scene.points.positions @ view.camera.rotation.T + view.camera.translation)[:, 2]
        distance = float(np.median(depth[depth > 0]))
        twist = random.normal(size=6) * px / view.camera.fx * np.array([distance] * 3 + [1, 1, 1]) / 2
        views.append(replace(view, camera=twisted(view.camera, twist)))
    return replace(scene, views=views)


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """[M, 2] px of points, from the middle of the photo; NaN where they are not in it."""
    local = points @ camera.rotation.T + camera.translation
    px = local[:, :2] / local[:, 2:] * camera.fx
    inside = (local[:, 2] > 0) & (np.abs(px) < [camera.width / 2, camera.height / 2]).all(axis=1)
    return np.where(inside[:, None], px, np.nan)


def errors(scene: Scene, cameras: dict) -> tuple[float, float]:
    """Median px at which the scene's points are off in the photos: after the best similarity, and without one."""
    truth = {v.name: v.camera for v in scene.views}
    alignment = pose_errors({n: cameras[n] for n in truth}, truth, scene.points.positions).alignment
    points = scene.points.positions
    off = []
    for name, camera in truth.items():
        both = [seen(other, points) for other in (alignment.camera(cameras[name]), cameras[name])]
        off.append([np.nanmedian(np.linalg.norm(px - seen(camera, points), axis=1)) for px in both])
    aligned, in_place = np.median(off, axis=0)
    return float(aligned), float(in_place)


def set_of(photos: Path, cameras: Path, sigma: float, every: int) -> Scene:
    """Photos with cameras that count as true; no sharp truth is needed."""
    loaded = load_photos(photos, None, Silent())[::every]
    known = load_cameras(cameras, loaded)
    views = undistorted_views([photo for photo in loaded if photo.name in known.poses], known)
    return Scene(None, views, {}, known.points, Medium(PointSpread("gaussian", sigma, sigma) if sigma else None))


def main() -> None:
    """Prints a row per shake and blur."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--px", type=float, nargs="+", default=[0.0, 1.0, 3.0, 8.0])
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 2.0])
    parser.add_argument("--photos", type=Path, help="photos of your own, blurred by the first --sigma")
    parser.add_argument("--cameras", type=Path, help="their cameras: a COLMAP model or transforms.json")
    parser.add_argument("--every", type=int, default=1, help="only every so many of these photos")
    parser.add_argument("--seeds", type=int, default=1, help="shakes of each size")
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/runs/pose_basin.jsonl")
    options = parser.parse_args()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for px, seed in itertools.product(options.px, range(1, 1 + options.seeds)):
        for sigma in options.sigma[:1] if options.photos else options.sigma:
            settings = TrainingSettings(max_gaussians=1500, sh_degree=0, threads=1)
            if options.photos:
                scene = set_of(options.photos, options.cameras, sigma, options.every)
                settings = replace(TrainingSettings.preset("draft"), threads=1, device="cpu")
            else:
                scene = blurred_scene(12, sigma)
            wrong = shaken(scene, px, seed)
            judges = wrong.views[::4] if len(wrong.views) < 16 else wrong.views[::8]
            fit = [v for v in wrong.views if v not in judges]
            found = refine_cameras(fit, judges, wrong.points, wrong.medium, settings, Silent(), focal=False)
            row = {
                "photos": str(options.photos or "plane"),
                "shaken px": px,
                "sigma": sigma,
                "seed": seed,
                "before": errors(scene, {v.name: v.camera for v in wrong.views}),
                "after": errors(scene, found.cameras),
                "kept": found.kept,
                "moved": found.moved_px,
                "loss": [found.loss_before, found.loss_after],
                "error": found.error,
                "shifts": [found.shift_before, found.shift_after, found.shift_change],
            }
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(row, flush=True)


if __name__ == "__main__":
    main()
