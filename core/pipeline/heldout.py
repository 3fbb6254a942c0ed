"""Renders the held-out views, writes them, and scores them against photos and truth."""

from __future__ import annotations

import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..errors import DgsError
from ..evaluation.metrics import bands, edge_sharpness, low_passed_truth_psnr, psnr, ssim
from ..imaging.formation.chain import Formation
from ..imaging.medium import Medium
from ..photos.load import Photo, load_photo, photo_files
from ..photos.scale import resized
from ..photos.write import photo_stem, write_png
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.pictures import ViewPictures
from .effects.matched import matched_psnr
from .views import Viewer, to_pixels

#: Bands of periods (coarsest, finest) in px that are compared with the truth.
BANDS = ((40.0, 20.0), (20.0, 14.0), (14.0, 10.0), (10.0, 7.0), (7.0, 4.0))
#: Border in px that `psnr_inside` leaves out.
INSIDE = 30


@dataclass
class Scores:
    """Scores of one view; None where there is nothing to compare with."""

    name: str
    degraded: dict[str, float | None] | None = None
    sharp: dict[str, float | None] | None = None
    low_passed: float | None = None
    bands: list[dict[str, float | None]] = field(default_factory=list)
    edge_sharpness: float | None = None


class TruthFolder:
    """Sharp photos by the names of the blurred ones, whatever their extension.

    Raises:
        PhotoError: the folder is missing or holds no photo.
    """

    def __init__(self, folder: Path) -> None:
        self._files = {photo_stem(path.name): path for path in photo_files(folder)}
        self._files.update({unicodedata.normalize("NFC", path.name): path for path in photo_files(folder)})

    def __contains__(self, name: str) -> bool:
        return name in self._files or photo_stem(name) in self._files

    def pixels(self, name: str) -> NDArray[np.uint8] | NDArray[np.uint16]:
        """[H, W, 3], sRGB-encoded; PhotoError if it cannot be read."""
        return load_photo(self._files.get(name) or self._files[photo_stem(name)]).pixels


@dataclass
class ViewScorer:
    """Renders and scores views of one twin.

    Attributes:
        viewer, reconstruction, medium: the twin, its cameras, and the medium on the photos' grid.
        truth: sharp photos, or None.
        period: finest period in px that one photo holds.
        progress: hears of what could not be compared.
        formation: effects besides the point spread.
    """

    viewer: Viewer
    reconstruction: Reconstruction
    medium: Medium
    truth: TruthFolder | None
    period: float
    progress: Progress
    formation: Formation = field(default_factory=Formation)

    def score(self, photo: Photo, heldout: bool, path: Path | None) -> tuple[Scores, ViewPictures]:
        """Renders one view, sharp (written to `path`) and degraded, and compares both."""
        lens, pose = self.reconstruction.lenses[photo.name], self.reconstruction.poses[photo.name]
        size = round(photo.size[0] / photo.scale[0]), round(photo.size[1] / photo.scale[1])
        twin = to_pixels(self.viewer.sharp(lens.resized(*size), pose, finer=1.0 / photo.scale[0]))
        if path is not None:
            write_png(path, twin)
        degraded = to_pixels(self.viewer.degraded(lens, pose, self.medium, photo.name, self.formation))
        scores = Scores(photo.name)
        taken = _unit(photo.pixels)
        scores.degraded = {
            "psnr": _number(psnr(_unit(degraded), taken, photo.mask)),
            "ssim": _number(ssim(_unit(degraded), taken, photo.mask)),
            "psnr_matched": _number(matched_psnr(_planes(degraded), _planes(photo.pixels), photo.mask)),
        }
        truth = self._true(photo.name, size)
        if truth is not None:
            self._compare(scores, _unit(twin), _unit(truth), photo)
        small = photo.size
        pictures = ViewPictures(
            name=photo.name,
            heldout=heldout,
            photo=_eight_bit(photo.pixels),
            twin=_eight_bit(twin if size == small else resized(twin, *small)),
            degraded=degraded,
            truth=None if truth is None else _eight_bit(truth if size == small else resized(truth, *small)),
            scores={"degraded": scores.degraded, "sharp": scores.sharp},
        )
        return scores, pictures

    def _true(self, name: str, size: tuple[int, int]) -> NDArray[np.uint8] | NDArray[np.uint16] | None:
        if self.truth is None:
            return None
        if name not in self.truth:
            self.progress.note(f"The truth has no picture of '{name}': it is scored against its photo only")
            return None
        try:
            truth = self.truth.pixels(name)
        except DgsError as error:
            self.progress.note(f"Not compared with the truth: {error}")
            return None
        width, height = truth.shape[1], truth.shape[0]
        if (width, height) == size:
            return truth
        if abs(width * size[1] - height * size[0]) > 0.02 * width * size[1]:
            self.progress.note(
                f"The truth of '{name}' is {width} x {height} px, its photo {size[0]} x {size[1]}: not compared"
            )
            return None
        self.progress.note(f"The truth of '{name}' was scaled from {width} x {height} to {size[0]} x {size[1]} px")
        return resized(truth, *size)

    def _compare(self, scores: Scores, twin: NDArray[np.float64], truth: NDArray[np.float64], photo: Photo) -> None:
        mask = photo.mask if photo.scale == (1.0, 1.0) else None
        scores.sharp = {
            "psnr": _number(psnr(twin, truth, mask)),
            "ssim": _number(ssim(twin, truth, mask)),
            "psnr_inside": _number(psnr(twin, truth, mask, INSIDE)),
        }
        if self.period > 2.0:
            cutoff = photo.scale[0] / self.period
            scores.low_passed = _number(low_passed_truth_psnr(truth, cutoff, mask))
        for (coarsest, finest), one in zip(BANDS, bands(twin, truth, BANDS), strict=True):
            scores.bands.append(
                {
                    "coarsest": coarsest,
                    "finest": finest,
                    "gain": _number(one.gain),
                    "correlation": _number(one.correlation),
                    "energy": _number(one.energy),
                }
            )
        scores.edge_sharpness = _number(edge_sharpness(twin, truth))


def mean_of(values: Sequence[float | None]) -> float | None:
    """Mean of what is there; None if nothing is."""
    known = [value for value in values if value is not None]
    return round(float(np.mean(known)), 4) if known else None


def _unit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    return pixels.astype(np.float64) / np.iinfo(pixels.dtype).max


def _planes(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    return _unit(pixels).transpose(2, 0, 1)


def _eight_bit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint8, copy=False)
    return np.asarray(np.round(pixels / 257.0), np.uint8)


def _number(value: float) -> float | None:
    """JSON has no NaN."""
    return round(value, 4) if np.isfinite(value) else None
