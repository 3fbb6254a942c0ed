"""The folder through which parent and child hand over photos, settings and models."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from ..files import explaining
from ..photos.load import Photo
from .settings import SfmSettings
from .sharpen import luma

JOB_FILE = "job.json"
#: Of a job that only places new photos: names of the reference photos that they are matched with, as in KEPT, or those
#: of the job's own images.
REFERENCES = "references.json"
#: Features of the reference photos, where they were kept, by the names in the plan.
KEPT = "kept.npz"
#: Of a job whose cameras are known: their lenses and poses by image name, and the pairs that are matched.
KNOWN = "known.json"
#: What the child leaves of such a job: points and who sees them.
POINTS = "points.npz"
#: Of a job that only looks for features: a file that is there.
ONLY_FEATURES = "only-features"
#: What the parent writes last: the references' poses and depth.
PLAN = "place.json"


@dataclass(frozen=True)
class SfmJob:
    """What the parent hands over.

    Attributes:
        folder: the work folder; everything else lies in it.
        images: image name in the model ('0/0003.png', one folder per lens) -> luma file
            ([H, W] uint16, NPY).
        focals: focal length in px per lens folder, where EXIF holds one.
        masked: whether `folder`/masks holds masks.
        kernel: [k, k] point spread function, or None.
        settings: see `SfmSettings`.
    """

    folder: Path
    images: dict[str, Path]
    focals: dict[str, float]
    masked: bool
    kernel: NDArray[np.float64] | None
    settings: SfmSettings


def write_job(
    photos: list[Photo], kernel: NDArray[np.float64] | None, settings: SfmSettings, folder: Path
) -> dict[str, str]:
    """Fills the work folder. File names in it are numbers: the photos' own may hold anything.

    Returns:
        Photo name per image name.

    Raises:
        OutputError: there is no room for it.
    """
    with explaining(folder):
        return _written(photos, kernel, settings, folder)


def _written(
    photos: list[Photo], kernel: NDArray[np.float64] | None, settings: SfmSettings, folder: Path
) -> dict[str, str]:
    (folder / "luma").mkdir(parents=True, exist_ok=True)
    lenses: dict[tuple[int, int, int], str] = {}
    names: dict[str, str] = {}
    focals: dict[str, float] = {}
    files: dict[str, str] = {}
    masked = any(photo.mask is not None for photo in photos)
    for index, photo in enumerate(photos):
        key = (*photo.size, round(photo.focal_px or 0.0))
        lens = lenses.setdefault(key, str(len(lenses)))
        if photo.focal_px is not None:
            focals[lens] = photo.focal_px
        image = f"{lens}/{index:04d}.png"
        names[image] = photo.name
        files[image] = f"luma/{index:04d}.npy"
        np.save(folder / files[image], np.round(luma(photo.pixels) * 65535).astype(np.uint16), allow_pickle=False)
        if masked:  # all of them: COLMAP finds no feature in a photo whose mask is missing
            _write_mask(photo, folder / "masks" / (image + ".png"))  # COLMAP's naming
    if kernel is not None:
        np.save(folder / "kernel.npy", kernel.astype(np.float64), allow_pickle=False)
    content = {
        "images": files,
        "focals": focals,
        "masked": masked,
        "blurred": kernel is not None,
        "settings": settings.as_json(),
    }
    (folder / JOB_FILE).write_text(json.dumps(content), encoding="utf-8")
    return names


def _write_mask(photo: Photo, path: Path) -> None:
    mask = np.ones(photo.pixels.shape[:2], bool) if photo.mask is None else photo.mask
    path.parent.mkdir(parents=True, exist_ok=True)
    Image.fromarray(mask.astype(np.uint8) * np.uint8(255)).save(path, compress_level=1)


def read_job(folder: Path) -> SfmJob:
    """The inverse of `write_job`, in the child."""
    content = json.loads((folder / JOB_FILE).read_text(encoding="utf-8"))
    kernel = np.load(folder / "kernel.npy", allow_pickle=False) if content["blurred"] else None
    images = {name: folder / path for name, path in content["images"].items()}
    settings = SfmSettings.from_json(content["settings"])
    return SfmJob(folder, images, content["focals"], content["masked"], kernel, settings)
