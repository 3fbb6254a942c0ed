"""Motion: a blur along one direction that differs from photo to photo."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ..evidence import Evidence, judged, unknown
from ..paths import FEWEST, Path, PathFinder, find_paths
from ..photo_set import PhotoSet

#: Length of the camera's path on the photo while the shutter is open, px.
SMALLEST = 3.0
#: What the lengths of a whole set leave uncertain, px: paths of one or two px are neither seen nor excluded.
UNSEEN = 0.3


@dataclass(frozen=True)
class Motion:
    """The photos' own paths.

    Attributes:
        length, error: rms over the photos, px, with its standard deviation.
        photos: length by photo, 0 where it is within its noise; paths: the same with directions and errors.
    """

    length: float
    error: float
    photos: dict[str, float]
    paths: dict[str, Path]

    @property
    def significant(self) -> bool:
        """Whether it is larger than the smallest visible."""
        return judged("motion", self.length, self.error, SMALLEST, "px", "").needed


def motion_of(photos: PhotoSet) -> Motion | None:
    """The paths of the photos whose spectra are looked at; None with fewer than four, or too little detail.

    Kept with the photos.
    """
    kept = photos.__dict__
    if "_motion" not in kept:
        finder = _common(photos)
        kept["_motion"] = None if finder is None else _of({p.name: finder.path(p) for p in photos.looked_at})
    found: Motion | None = kept["_motion"]
    return found


def paths_of(photos: PhotoSet) -> dict[str, Path]:
    """The paths of all photos; empty where they cannot be told. Kept with the photos."""
    kept = photos.__dict__
    if "_paths" not in kept:
        finder = _common(photos)
        kept["_paths"] = {} if finder is None else find_paths(photos.photos, photos.rounding, finder)
    found: dict[str, Path] = kept["_paths"]
    return found


def _common(photos: PhotoSet) -> PathFinder | None:
    kept = photos.__dict__
    if "_path_finder" not in kept:
        enough = len(photos.looked_at) >= FEWEST
        finder = PathFinder(photos.looked_at, photos.rounding) if enough else None
        kept["_path_finder"] = finder if finder is not None and finder.possible else None
    found: PathFinder | None = kept["_path_finder"]
    return found


def _of(paths: dict[str, Path]) -> Motion:
    squares = np.array([path.length**2 for path in paths.values()])
    length = math.sqrt(float(squares.mean()))
    # Of a mean of squares: twice the length times its error, each, over the root of their number.
    each = np.array([2.0 * path.length * path.error for path in paths.values()])
    own = float(np.sqrt(np.square(each).mean() / len(each))) / (2.0 * max(length, 1.0))
    # A single path says little of a set: what is left without the longest one is as likely.
    alone = length - math.sqrt(float(np.sort(squares)[:-1].mean()))
    return Motion(length, math.hypot(own, UNSEEN, alone), {name: path.length for name, path in paths.items()}, paths)


def inspect(photos: PhotoSet) -> Evidence:
    """The camera's own movement during the exposures."""
    moved = motion_of(photos)
    if moved is None:
        return unknown("motion", "px", SMALLEST, "Not measured: four photos with detail are needed")
    worst = max(moved.photos, key=lambda name: moved.photos[name])
    longest = f"the longest {moved.photos[worst]:.1f} px in {worst}"
    text = f"Paths of {moved.length:.1f} px (rms) of the photos' own, {longest}"
    if moved.photos[worst] == 0.0:
        text = "No photo has a path of its own that stands clear of its noise"
    evidence = judged("motion", moved.length, moved.error, SMALLEST, "px", text)
    evidence.plots.update(lengths=moved.photos, paths=moved.paths)
    return evidence
