"""What refined cameras bring to the twin: `python -m benchmarks.refined_gain --data FOLDER [--px 1 3 6] [--seeds 3]`.

FOLDER holds `photos/`, `sharp/` and true `cameras/` (as `synthesize` writes them). Every camera is shaken by about so
many px; a twin is made with the shaken cameras as they are, one with `--refine-cameras`, and one with the true cameras.
Held-out views are compared with the sharp truth from three places: from their TRUE ones, as whoever has another camera
of the given world sees the twin; from there, moved by the similarity that lays the trained photos' true cameras over
those that the twin has; and from where the twin, seen through the blur, lies best on the blurred held-out photo (a
world that is bent a little is no blurred one).
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from dgs.core.camera import Camera
from dgs.core.evaluation.metrics import psnr
from dgs.core.evaluation.poses import align_similarity, scene_depth
from dgs.core.formats.colmap import write_lenses
from dgs.core.photos.load import load_photos
from dgs.core.photos.truth import TruthFolder
from dgs.core.pipeline.views import Viewer, to_pixels
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Reconstruction
from dgs.core.sfm.given import load_cameras
from dgs.core.training.cameras.pose_steps import twisted
from dgs.core.training.settings import TrainingSettings
from dgs.core.training.trainer import Trainer
from dgs.core.twin.consensus import align_view
from dgs.core.twin.opened import open_twin
from dgs.core.twin.refine_cameras import ViewAligner

ROOT = Path(__file__).resolve().parents[1]

HOLDOUT = 8


def shaken(truth: Reconstruction, px: float, seed: int) -> dict[str, Camera]:
    """Every camera turned and shifted by about `px` in all."""
    random = np.random.default_rng(seed)
    out = {}
    for name, camera in sorted(truth.cameras().items()):
        distance = scene_depth(camera, truth.points.positions)
        twist = random.normal(size=6) * px / camera.fx * np.array([distance] * 3 + [1, 1, 1]) / 2
        out[name] = twisted(camera, twist)
    return out


def score(folder: Path, truth: Reconstruction, sharp: TruthFolder) -> np.ndarray:
    """Mean PSNR (dB) of the held-out views at their true places, there by the similarity, and where the twin, through
    the blur, lies on them."""
    twin = open_twin(folder, Silent())
    behind = [float(c) for c in twin.background]
    viewer = Viewer(twin.gaussians, twin.scale, "cpu", background=(behind[0], behind[1], behind[2]))
    right = truth.cameras()
    mine = {n: c for n, c in twin.reconstruction.cameras().items() if n not in twin.held}
    into = align_similarity({n: right[n] for n in mine}, mine)
    held = [
        replace(v, camera=v.camera.moved(c.rotation, c.translation))
        for v, c in ((v, into.camera(right[v.name])) for v in twin.views if v.name in twin.held)
    ]
    settings = TrainingSettings(sh_degree=twin.gaussians.sh_degree, coarse_share=0.0)
    trainer = Trainer(held, [], twin.reconstruction.points, twin.medium, settings, start=twin.gaussians)
    found = []
    for view, on_grid in zip(held, trainer.levels[-1].views, strict=True):
        align_view(trainer, trainer.levels[-1], on_grid)
        laid = ViewAligner(trainer).world(view.camera, on_grid.camera, trainer.levels[-1].step)
        wanted = sharp.pixels(view.name)
        each = []
        for camera in (right[view.name], view.camera, laid):
            lens = twin.reconstruction.lenses[view.name]
            seen = to_pixels(viewer.sharp(lens, Pose(camera.rotation, camera.translation)))
            each.append(psnr(seen / 255.0, wanted / float(np.iinfo(wanted.dtype).max)))
        found.append(each)
    return np.mean(found, axis=0)


def made(photos: Path, cameras: Path, out: Path, psf: str, *more: str) -> Path:
    """A twin."""
    words = [str(photos), "--out", str(out), "--psf", psf, "--cameras", str(cameras), "--holdout-every", str(HOLDOUT)]
    command = [sys.executable, str(ROOT / "run_dgs.py"), "reconstruct", *words, "--progress", "none", *more]
    subprocess.run(command, check=True)
    return out


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--psf", default="gaussian:5")
    parser.add_argument("--px", type=float, nargs="+", default=[1.0, 3.0, 6.0])
    parser.add_argument("--seeds", type=int, default=3)
    parser.add_argument("--every", type=int, default=1, help="only every so many photos")
    options = parser.parse_args()
    sharp = TruthFolder(options.data / "sharp")
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        (work / "photos").mkdir()
        for photo in sorted((options.data / "photos").iterdir())[:: options.every]:
            (work / "photos" / photo.name).symlink_to(photo.resolve())
        truth = load_cameras(options.data / "cameras", load_photos(work / "photos", None, Silent()))
        best = score(made(work / "photos", options.data / "cameras", work / "true", options.psf), truth, sharp)
        print(f"true cameras {best.round(2)} dB (true places, by the similarity, laid)", flush=True)
        for px in options.px:
            rows = []
            for seed in range(options.seeds):
                moved = shaken(truth, px, seed)
                poses = {n: Pose(c.rotation, c.translation) for n, c in moved.items()}
                model = work / f"model_{px:g}_{seed}"
                write_lenses(model, {n: truth.lenses[n] for n in poses}, poses, truth.points)
                pair = [
                    score(
                        made(work / "photos", model, work / f"out_{px:g}_{seed}_{len(more)}", options.psf, *more),
                        truth,
                        sharp,
                    )
                    for more in ((), ("--refine-cameras",))
                ]
                rows.append(pair)
                print(f"shaken by {px:g} px, seed {seed}: {pair[0].round(2)} -> {pair[1].round(2)} dB", flush=True)
            before, after = np.median(rows, axis=0)
            print(f"shaken by {px:g} px, median of {len(rows)}: {before.round(2)} -> {after.round(2)} dB", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
