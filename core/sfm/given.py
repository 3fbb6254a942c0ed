"""Cameras that the user already has: COLMAP models and transforms.json."""

from __future__ import annotations

import time
import unicodedata
from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from ..errors import CameraError, DegenerateMotion, FormatError
from ..formats.cameras import CameraModel, read_cameras
from ..lens import Lens
from ..numbers import BY_DEFINITION, number
from ..photos.load import Photo
from ..reconstruction import Figures, Reconstruction
from .scatter import scattered_points


@dataclass(frozen=True)
class GivenCameraSettings:
    """When a given camera fits a photo."""

    aspect_tolerance: float = number(
        0.01, "share", "by which width / height may differ before a lens no longer fits a photo"
    )
    same_place: float = number(
        1e-12, "share", "of the largest coordinate: cameras no farther apart stand at one place", BY_DEFINITION
    )
    from_features: float = number(
        0.1,
        "px",
        "mean reprojection error of points with tracks that come with cameras, from which these were found in photos:"
        " exact cameras come with exact points, or none. COLMAP's defaults leave 0.53 and 0.64 px of the rendered ball"
        " and shelf, shaken, 0.36 and 0.49 of sharp ones; models of real photos here have 0.12 to 1.3",
        BY_DEFINITION,
    )


SETTINGS = GivenCameraSettings()


def load_cameras(path: Path, photos: list[Photo]) -> Reconstruction:
    """Reads cameras from a file and gives them to the photos of the same name.

    Names match without regard to case, folder and extension ('images/A 1.JPG' is 'a 1.png').
    Cameras are scaled to the photos' size (`--max-size`, or photos exported smaller).

    Args:
        path: a file of cameras, or a folder that holds one; every format of `core.formats.cameras`.
        photos: the photos in memory.

    Returns:
        Cameras of the photos that have one; points as the file holds them; where it holds none, random
        ones in what the cameras look at together (`scattered_points`).

    Raises:
        FormatError: unreadable, or not a camera file.
        CameraError: no camera belongs to a photo, or a camera's frame has another shape.
    """
    started = time.perf_counter()
    if not path.exists():
        raise FormatError(f"There is no camera file '{path}'", "Check the path given with --cameras")
    sizes = {_key(p.name): (round(p.size[0] / p.scale[0]), round(p.size[1] / p.scale[1])) for p in photos}
    model = read_cameras(path, sizes)
    return _given(photos, model, path, started)


def _given(photos: list[Photo], model: CameraModel, path: Path, started: float) -> Reconstruction:
    points, table = model.points(), _table(model.poses)
    chosen = {p.name: table[_key(p.name)] for p in photos if _key(p.name) in table}
    if not chosen:
        raise CameraError(
            f"'{path}' has no camera for any of the {len(photos)} photos (but for {sorted(model.poses)[0]!r}, ...)",
            "Give the cameras of these photos; names must match but for folder, case and extension",
        )
    centres = np.array([model.poses[camera].centre for camera in chosen.values()])
    if len(centres) > 1 and np.ptp(centres, axis=0).max() <= SETTINGS.same_place * max(1.0, np.abs(centres).max()):
        raise DegenerateMotion(
            f"'{path}' has all {len(centres)} cameras of the photos at one place, from where no depth is seen",
            "Give cameras at different places",
        )
    fitted = {p.name: _fitted(model.lenses[chosen[p.name]], p) for p in photos if p.name in chosen}
    focal = float(np.mean([(lens.fx + lens.fy) / 2 for lens in fitted.values()]))
    error = points.error_px * float(np.mean([fitted[n].width / model.lenses[c].width for n, c in chosen.items()]))
    figures = Figures(
        model.spec.name,
        len(photos),
        len(chosen),
        focal,
        error,
        angle_deg=float("nan"),
        seconds=time.perf_counter() - started,
        from_photos=model.spec.from_photos or error >= SETTINGS.from_features,
    )
    points = replace(points, error_px=error)
    found = Reconstruction({n: model.poses[c] for n, c in chosen.items()}, fitted, points, figures)
    if len(points.positions):
        return found
    return replace(found, points=scattered_points(found, photos), figures=replace(figures, scattered=True))


def _key(name: str) -> str:
    """Name without folder, extension and case."""
    bare = unicodedata.normalize("NFC", name).replace("\\", "/").rsplit("/", 1)[-1]
    stem, dot, _ = bare.rpartition(".")
    return (stem if dot and stem else bare).casefold()


def _table(names: Iterable[str]) -> dict[str, str]:
    table: dict[str, str] = {}
    for name in sorted(names):
        key = _key(name)
        if key in table:
            raise CameraError(
                f"Two cameras could belong to the same photo: '{table[key]}' and '{name}'",
                "Give every photo a name of its own",
            )
        table[key] = name
    return table


def _fitted(lens: Lens, photo: Photo) -> Lens:
    width, height = photo.size
    sx, sy = width / lens.width, height / lens.height
    # Rounding to whole pixels changes the shape of a small photo by up to a pixel.
    if abs(sx / sy - 1.0) > SETTINGS.aspect_tolerance + 1.0 / min(width, height):
        raise CameraError(
            f"The camera of '{photo.name}' is {lens.width} x {lens.height} px, the photo {width} x {height}",
            "Give photos and cameras of the same shape (EXIF rotation is applied to photos)",
        )
    return lens if (lens.width, lens.height) == (width, height) else lens.resized(width, height)
