"""How a twin is seen from cameras that took no part in it, where another program found all cameras in the same photos.

    python -m benchmarks.given_cameras SET FOLDER [--effects auto none] [--more WORDS]

SET holds `photos/` (shaken, say) and `sharp/`, as `synthesize` writes them. Each eighth view, whose photo is sharp
there, is held out; COLMAP finds cameras in all of them together, as data sets are made; a twin is made of the others
with these cameras, for each choice of effects, and one of the sharp photos. Held-out views are compared with their
sharp photos from their cameras as COLMAP found them, and from where the finished twin lies best on them. What lies
between the two is either an error of that camera, which the sharp photos' twin shares, or the twin has left the
cameras' world.
"""

from __future__ import annotations

import argparse
import shutil
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pycolmap
import torch
from dgs.core.evaluation.metrics import psnr, ssim
from dgs.core.forward import sharp_view
from dgs.core.photos.load import load_photos
from dgs.core.photos.undistort import undistorted_views
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings
from dgs.core.rendering import Rendered
from dgs.core.sfm.given import load_cameras
from dgs.core.training.cameras.adjusting import SETTINGS as ADJUSTING
from dgs.core.training.cameras.adjusting import placed_camera
from dgs.core.training.cameras.twin_tracks import LaidBeside, sighted
from dgs.core.twin.opened import OpenedTwin, open_twin
from dgs.core.views import View

ROOT = Path(__file__).resolve().parents[1]
#: One view of so many is held out: those that `synthesize` leaves sharp.
EVERY = 8
#: Times that a held-out view is placed before the finished twin, and px of its border that do not count.
ROUNDS, BORDER = 5, 8


def write_set(source: Path, folder: Path) -> None:
    """`fit` and `fit_sharp` (photos to fit), `held` (sharp ones), and `model`: COLMAP's cameras of `fit` and `held`."""
    for name in ("fit", "fit_sharp", "held", "all"):
        (folder / name).mkdir(parents=True)
    for index, photo in enumerate(sorted((source / "photos").iterdir())):
        held, sharp = index % EVERY == 0, source / "sharp" / photo.name
        for name in ("held", "all") if held else ("fit", "all"):
            shutil.copy(sharp if held else photo, folder / name / photo.name)
        if not held:
            shutil.copy(sharp, folder / "fit_sharp" / photo.name)
    pycolmap.logging.minloglevel = pycolmap.logging.ERROR.value
    lens = pycolmap.ImageReaderOptions()
    lens.camera_model = "SIMPLE_RADIAL"
    database = folder / "database.db"
    mode = pycolmap.CameraMode.SINGLE
    pycolmap.extract_features(database, folder / "all", camera_mode=mode, reader_options=lens)
    pycolmap.match_exhaustive(database)
    (folder / "maps").mkdir()
    maps = pycolmap.incremental_mapping(database, folder / "all", folder / "maps")
    best = max(maps.values(), key=lambda each: each.num_reg_images())
    print(f"COLMAP: {best.num_reg_images()} of {len(list((folder / 'all').iterdir()))} photos", flush=True)
    (folder / "model").mkdir()
    best.write_text(folder / "model")


def made(folder: Path, photos: str, out: Path, words: Sequence[str]) -> Path:
    """A twin of photos with COLMAP's cameras; one that is there is kept."""
    if not (out / "report.json").is_file():
        given = [str(folder / photos), "--cameras", str(folder / "model"), "--out", str(out), *words]
        command = [sys.executable, str(ROOT / "run_dgs.py"), "reconstruct", *given, "--progress", "none"]
        subprocess.run(command, check=True)
    return out


def drawn(twin: OpenedTwin, view: View) -> Rendered:
    """What the twin shows from a view's camera, which stands in the twin's own units."""
    with torch.no_grad():
        unit = twin.scale.to_unit(twin.gaussians)
        return sharp_view(unit, view.camera, RasterSettings(depth=True), twin.background)


def laid(twin: OpenedTwin, view: View) -> View:
    """The view from where the twin lies best on its photo."""
    for _ in range(ROUNDS):
        seen = drawn(twin, view)
        assert seen.mean_depth is not None
        depth = torch.where(seen.alpha > ADJUSTING.opaque, seen.mean_depth, 0.0).numpy()
        beside = LaidBeside(view.camera, seen.image.numpy(), view.planes(), depth, view.mask)
        view = replace(view, camera=placed_camera(sighted(beside)))
    return view


def scores(twin: OpenedTwin, views: Sequence[View]) -> np.ndarray:
    """PSNR (dB) and SSIM of views: the means."""
    found = []
    for view in views:
        shown = drawn(twin, view).image.clamp(0, 1).permute(1, 2, 0).numpy()
        truth = view.planes().transpose(1, 2, 0)
        found.append([psnr(shown, truth, view.mask, BORDER), ssim(shown, truth, view.mask, BORDER)])
    return np.mean(found, axis=0)


def main() -> int:
    """A line for each twin."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("set", type=Path)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--effects", nargs="*", default=["none", "auto"])
    parser.add_argument("--more", default="", help="further words of 'reconstruct', in one")
    asked = parser.parse_args()
    if not (asked.folder / "model").is_dir():
        write_set(asked.set, asked.folder)
    photos = load_photos(asked.folder / "held", None, Silent())
    views = undistorted_views(photos, load_cameras(asked.folder / "model", photos))
    rows = [("fit", effects, effects) for effects in asked.effects] + [("fit_sharp", "none", "sharp")]
    print(f"{asked.set.name}: {len(views)} held-out views; dB, SSIM from their cameras as given; placed anew")
    for name, effects, label in rows:
        words = ["--effects", effects, *asked.more.split()]
        out = asked.folder / "-".join([label, *asked.more.split()])
        twin = open_twin(made(asked.folder, name, out, words), Silent())
        own = [replace(view, camera=twin.scale.camera_to_unit(view.camera)) for view in views]
        given, placed = scores(twin, own), scores(twin, [laid(twin, view) for view in own])
        print(f"{label:>6} {given[0]:6.2f} {given[1]:.3f}; {placed[0]:6.2f} {placed[1]:.3f}", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main())
