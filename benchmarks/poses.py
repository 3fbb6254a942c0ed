"""How right cameras are that are found from blurred photos, in three ways, against rendered truth.

    python -m benchmarks.poses FOLDER                 # what is missing is rendered and measured; an hour and more
    python -m benchmarks.poses FOLDER --only shelf    # one scene
    python -m benchmarks.poses FOLDER --table         # what is there already
    python -m benchmarks.poses FOLDER --picture FILE  # the same as a picture

FOLDER/SCENE holds sharp photos of one of the laboratory's scenes, 664 x 464 px. They are blurred by a known Gaussian
(of sRGB, 8 bits) and cut to 600 x 400 px, so that no blur sees a border. Cameras are found by this project (which is
given the blur), by COLMAP with its defaults (pycolmap), and by the same from photos after Wiener's inverse of the blur
(scikit-image, its `balance` the best of three by photos registered). Compared with the true cameras after a similarity:
centres in px at the scene's distance. Each row is kept in benchmarks/poses.json as soon as it is there.
"""

from __future__ import annotations

import argparse
import json
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

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
from PIL import Image
from scipy.ndimage import gaussian_filter
from skimage.restoration import wiener

from .measured import ROOT, run_dgs
from .sfm import gaussian

ROWS = ROOT / "benchmarks" / "poses.json"
#: How each scene is rendered: path of the cameras, views, samples, and what else.
SCENES = {
    "rugby-ball": ("patch", 40, 16, []),
    "shelf": ("front", 32, 8, []),
    "orrery": ("dome", 48, 16, ["--background", "transparent"]),
    "village": ("drone", 48, 8, []),
    "room": ("inside", 48, 16, []),
}
SIGMAS = (0, 2, 4, 6, 8)
#: px cut off on each side after blurring: four times the widest blur.
MARGIN = 32
#: Of scikit-image's `wiener`: how smooth its result is.
BALANCES = (0.01, 0.1, 1.0)

Found = dict[str, Camera]


def rendered(folder: Path, scene: str) -> Path:
    """The sharp photos' folder, made if it is not there."""
    path, views, samples, more = SCENES[scene]
    out = folder / scene
    if not (out / "transforms.json").is_file():
        words = ["--scene", scene, "--path", path, "--views", views, "--samples", samples, "--size", "664x464", *more]
        run_dgs("synthesize", "--out", out, *words, "--psf", "none")
    return out


def blurred(photos: Path, sigma: float, out: Path) -> list[Path]:
    """Writes the photos blurred and cut; on white where they are transparent."""
    out.mkdir()
    for path in sorted(photos.glob("*.png")):
        picture = Image.open(path).convert("RGBA")
        solid = Image.alpha_composite(Image.new("RGBA", picture.size, (255, 255, 255, 255)), picture)
        pixels = np.asarray(solid.convert("RGB"), np.float64)
        soft = gaussian_filter(pixels, (sigma, sigma, 0)) if sigma else pixels
        cut = soft[MARGIN:-MARGIN, MARGIN:-MARGIN]
        Image.fromarray(np.clip(np.round(cut), 0, 255).astype(np.uint8)).save(out / path.name)
    return sorted(out.glob("*.png"))


def ours(photos: Path, sigma: float, work: Path) -> Found:
    """What this project finds."""
    loaded = load_photos(photos, None, Silent())
    return dict(find_cameras(loaded, gaussian(sigma), SfmSettings(threads=2), work, Silent()).cameras())


def colmap(photos: Path, sigma: float, work: Path) -> Found:
    """COLMAP with its defaults: features, each photo with each, the model with most photos."""
    database, models = work / "colmap.db", work / "models"
    models.mkdir()
    pycolmap.extract_features(database, photos, camera_mode=pycolmap.CameraMode.SINGLE)
    pycolmap.match_exhaustive(database)
    found = pycolmap.incremental_mapping(database, photos, models)
    if not found:
        return {}
    best = max(found.values(), key=lambda model: model.num_reg_images())
    return {image.name: _plain(best, image) for image in best.images.values() if image.has_pose}


def _plain(model: Any, image: Any) -> Camera:
    """A camera of COLMAP's as ours, without its lens's distortion."""
    camera, pose = model.cameras[image.camera_id], image.cam_from_world()
    lens = camera.calibration_matrix()
    rotation, translation = np.asarray(pose.rotation.matrix()), np.asarray(pose.translation)
    focal, middle = (lens[0, 0], lens[1, 1]), (lens[0, 2], lens[1, 2])
    return Camera(image.name, camera.width, camera.height, *focal, *middle, rotation, translation)


def inverted(photos: Path, sigma: float, work: Path) -> Found:
    """The same from photos after Wiener's inverse."""
    best: Found = {}
    for balance in BALANCES if sigma else ():
        sharpened = work / f"wiener-{balance}"
        sharpened.mkdir()
        kernel = gaussian(sigma)
        for path in sorted(photos.glob("*.png")):
            planes = np.asarray(Image.open(path), np.float64) / 255
            sharp = np.stack([wiener(planes[..., k], kernel, balance) for k in range(3)], axis=-1)
            Image.fromarray(np.clip(np.round(255 * sharp), 0, 255).astype(np.uint8)).save(sharpened / path.name)
        own = work / f"work-{balance}"
        own.mkdir()
        best = max(best, colmap(sharpened, sigma, own), key=len)
    return best


WAYS: dict[str, Callable[[Path, float, Path], Found]] = {"ours": ours, "colmap": colmap, "wiener": inverted}


def row(folder: Path, scene: str, sigma: float, way: str) -> dict[str, Any]:
    """Share registered, and errors of what is."""
    sharp = rendered(folder, scene)
    truth = dict(read_cameras(sharp / "transforms.json").pinholes())
    with tempfile.TemporaryDirectory() as name:
        work = Path(name)
        names = blurred(sharp / "photos", sigma, work / "photos")
        started = time.perf_counter()
        (work / "way").mkdir()
        try:
            found = WAYS[way](work / "photos", sigma, work / "way")
        except DgsError as error:
            found = {}
            print(f"{scene} {sigma} {way}: {error}", flush=True)
        seconds = time.perf_counter() - started
    out = {"photos": len(names), "registered": len(found), "seconds": round(seconds, 1)}
    if len(found) < 3:
        return out
    errors = pose_errors(found, truth)
    distance = distances(truth)
    focal = float(np.median([camera.fx for camera in truth.values()]))
    px = errors.centre / distance * focal
    return out | {
        "centre px": round(float(np.median(px)), 3),
        "worst px": round(float(px.max()), 2),
        "angle": round(float(np.median(errors.angle)), 4),
        "focal": round(float(np.median(errors.focal)), 5),
    }


def distances(cameras: Found) -> float:
    """How far the cameras stand from the point that they look at together, in the middle; from inside: their spread."""
    centres = np.array([camera.centre for camera in cameras.values()])
    ways = np.array([camera.rotation[2] for camera in cameras.values()])
    beside = np.eye(3) - ways[:, :, None] * ways[:, None, :]
    meeting = np.linalg.lstsq(beside.sum(axis=0), (beside @ centres[:, :, None]).sum(axis=0)[:, 0], rcond=None)[0]
    return float(np.median(np.linalg.norm(centres - meeting, axis=1)))


def table(rows: dict[str, dict[str, Any]]) -> str:
    """Markdown: a row for each scene and blur, registered share and error of each way."""
    out = ["| scene | sigma | " + " | ".join(WAYS) + " |", "|---|---|" + "---|" * len(WAYS)]
    for scene in SCENES:
        for sigma in SIGMAS:
            cells = [_cell(rows.get(f"{scene} {sigma} {way}")) for way in WAYS]
            if any(cells):
                out.append(f"| {scene} | {sigma} px | " + " | ".join(cells) + " |")
    return "\n".join(out)


def _cell(found: dict[str, Any] | None) -> str:
    if found is None:
        return ""
    share = f"{found['registered']} of {found['photos']}"
    return share if "centre px" not in found else f"{share}, {found['centre px']:.2f} px ({found['worst px']:.1f})"


def picture(rows: dict[str, dict[str, Any]], out: Path) -> None:
    """Registered share and error against the blur, a panel for each scene."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(2, len(SCENES), figsize=(15, 5.4), sharex=True, squeeze=False)
    for column, scene in enumerate(SCENES):
        for way, colour in zip(WAYS, ("tab:blue", "tab:orange", "tab:green"), strict=True):
            some = [(sigma, rows[key]) for sigma in SIGMAS if (key := f"{scene} {sigma} {way}") in rows]
            share = [100 * found["registered"] / found["photos"] for _, found in some]
            axes[0, column].plot([sigma for sigma, _ in some], share, "o-", color=colour, label=_LABELS[way])
            right = [(sigma, found["centre px"]) for sigma, found in some if "centre px" in found]
            axes[1, column].plot(*zip(*right, strict=True), "o-", color=colour) if right else None
        axes[0, column].set_title(scene)
        axes[0, column].set_ylim(-4, 104)
        axes[1, column].set_yscale("log")
        axes[1, column].set_xlabel("sigma, px")
    axes[0, 0].set_ylabel("photos registered, %")
    axes[1, 0].set_ylabel("camera centres off by, px")
    axes[0, 0].legend(loc="lower left", fontsize=8)
    figure.tight_layout()
    figure.savefig(out, dpi=110)


_LABELS = {"ours": "DGS, given the blur", "colmap": "COLMAP", "wiener": "Wiener, then COLMAP"}


def main(arguments: Sequence[str] | None = None) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--only", action="append", metavar="SCENE", choices=SCENES)
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--picture", type=Path)
    options = parser.parse_args(arguments)
    rows = json.loads(ROWS.read_text("utf-8")) if ROWS.is_file() else {}
    missing = [
        (scene, sigma, way)
        for scene in options.only or SCENES
        for sigma in SIGMAS
        for way in WAYS
        if f"{scene} {sigma} {way}" not in rows and (sigma or way != "wiener")
    ]
    for scene, sigma, way in () if options.table or options.picture else missing:
        key = f"{scene} {sigma} {way}"
        rows[key] = row(options.folder, scene, sigma, way)
        ROWS.write_text(json.dumps(rows, indent=1, sort_keys=True) + "\n", "utf-8")
        print(key, rows[key], flush=True)
    if options.picture:
        picture(rows, options.picture)
    print(table(rows))


if __name__ == "__main__":
    main()
