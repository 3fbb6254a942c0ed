"""How wrong cameras may be for the loss to mend them: `python benchmarks/pose_basin.py`.

The tests' bumpy plane, 12 photos of 112 x 96 px, every camera shaken by so many px (turned and shifted at random),
with the blur and without. Prints the median error of the cameras before and after, in px at the scene's distance.
"""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import replace
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / "tests/core/training")]
import run_dgs  # noqa: E402

run_dgs.mount_package()

import numpy as np  # noqa: E402
import torch  # noqa: E402
from dgs.core import compiled  # noqa: E402
from dgs.core.camera import Camera  # noqa: E402
from dgs.core.evaluation.poses import pose_errors  # noqa: E402
from dgs.core.progress import Silent  # noqa: E402
from dgs.core.training.settings import TrainingSettings  # noqa: E402
from dgs.core.twin import refine_cameras as module  # noqa: E402
from dgs.core.twin.pose_steps import twisted  # noqa: E402
from training_scenes import Scene, blurred_scene  # noqa: E402


def shaken(scene: Scene, px: float, seed: int) -> Scene:
    """Every camera turned and shifted by about `px` in all."""
    random = np.random.default_rng(seed)
    views = []
    for view in scene.views:
        size = px / view.camera.fx
        twist = random.normal(size=6) * size * np.array([3, 3, 3, 1, 1, 1]) / 2  # 3: the scene's distance
        views.append(replace(view, camera=twisted(view.camera, twist)))
    return replace(scene, views=views)


def seen(camera: Camera, points: np.ndarray) -> np.ndarray:
    """[M, 2] px of points, from the middle of the photo."""
    local = points @ camera.rotation.T + camera.translation
    return local[:, :2] / local[:, 2:] * camera.fx


def errors(scene: Scene, cameras: dict) -> float:
    """Median px at which the scene's points are off in the photos, after the best similarity."""
    truth = {v.name: v.camera for v in scene.views}
    found = pose_errors({n: cameras[n] for n in truth}, truth, scene.points.positions)
    points = scene.points.positions
    off = []
    for name, camera in truth.items():
        other = found.alignment.camera(cameras[name])
        off.append(np.median(np.linalg.norm(seen(other, points) - seen(camera, points), axis=1)))
    return float(np.median(off))


def main() -> None:
    """Prints a row per shake and blur."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--px", type=float, nargs="+", default=[0.0, 1.0, 3.0, 8.0])
    parser.add_argument("--sigma", type=float, nargs="+", default=[0.0, 2.0])
    parser.add_argument("--steps", type=int, default=240)
    parser.add_argument("--out", type=Path, default=ROOT / "benchmarks/runs/pose_basin.jsonl")
    options = parser.parse_args()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    module.STEPS = options.steps
    options.out.parent.mkdir(parents=True, exist_ok=True)
    for px in options.px:
        for sigma in options.sigma:
            scene = blurred_scene(12, sigma)
            wrong = shaken(scene, px, 1)
            judges = wrong.views[::4]
            fit = [v for v in wrong.views if v not in judges]
            settings = TrainingSettings(max_gaussians=1500, sh_degree=0, threads=1)
            found = module.refine_cameras(fit, judges, wrong.points, wrong.medium, settings, Silent(), focal=False)
            row = {
                "shaken px": px, "sigma": sigma, "before": errors(scene, {v.name: v.camera for v in wrong.views}),
                "after": errors(scene, found.cameras), "kept": found.kept,
                "loss": [found.loss_before, found.loss_after],
                "error": found.error,
            }  # fmt: skip
            with options.out.open("a") as file:
                file.write(json.dumps(row) + "\n")
            print(row, flush=True)


if __name__ == "__main__":
    main()
