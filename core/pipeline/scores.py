"""The stage 'scores': held-out views as the twin shows them, kept, and compared with photos and truth."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import partial

import numpy as np
import torch
from numpy.typing import NDArray

from ..errors import DgsError
from ..evaluation.halves import exposed_by_halves
from ..evaluation.view_scores import NYQUIST_PERIOD, ViewScores
from ..imaging.formation.chain import Formation
from ..imaging.formation.effect import Shot
from ..imaging.formation.exposure import Exposure
from ..imaging.formation.motion import motion_of
from ..imaging.medium import Medium
from ..lens import Lens
from ..photos.empty import background_shows
from ..photos.load import Photo
from ..photos.scale import resized
from ..photos.store import kept_beside
from ..photos.truth import TruthFolder
from ..photos.write import png_bytes, render_names
from ..pose import Pose
from ..progress import Progress
from ..reconstruction import Reconstruction
from ..report.pictures import ViewPictures, spread
from ..twin.folder import TwinFolder
from .effects.corrected import over_filed
from .effects.matched import matched_psnr
from .timing import Timing
from .views import Viewer, to_pixels

Pixels = NDArray[np.uint8] | NDArray[np.uint16]

#: Standard deviation of 8-bit rounding over the amplitude of typical detail (contrast one half).
NOISE_TO_CONTRAST = 1.0 / (255.0 * math.sqrt(12.0)) / 0.5
#: Views that the page shows at most, and where none was held out: each is four pictures in one file.
SHOWN, SHOWN_FITTED = 6, 3
#: Fitted views that are scored at most, to compare unseen ones with.
SCORED_FITTED = 6
#: Of these, scored however short the time is: without them nothing can be said of the twin.
LEAST_FITTED = 2
#: A truth whose proportions differ by more than this share is of another view.
ASPECT_TOLERANCE = 0.02


def resolvable_period(medium: Medium) -> float:
    """Finest period in px that one 8-bit photo still holds in every direction; 2 without blur.

    Where the PSF's transfer of detail of contrast one half falls below the noise of rounding: about
    9 px for a Gaussian of sigma 5 px.
    """
    if medium.psf is None or medium.psf.is_identity:
        return NYQUIST_PERIOD
    return round(medium.psf.resolvable_period(NOISE_TO_CONTRAST), 2)


@dataclass
class ViewScorer:
    """Renders and scores views of one twin.

    Attributes:
        viewer, reconstruction, medium: the twin, its cameras, and the medium on the photos' grid.
        truth: sharp photos, or None.
        period: finest period in px that one photo holds.
        progress: hears of what could not be compared.
        formation: effects besides the point spread.
        found: the cameras were found from the photos, or adjusted to them. Where a path was learned of a photo, its
            sharp view is then taken from where the camera was on average; other cameras stay where they are.
    """

    viewer: Viewer
    reconstruction: Reconstruction
    medium: Medium
    truth: TruthFolder | None
    period: float
    progress: Progress
    formation: Formation = field(default_factory=Formation)
    found: bool = False

    def _stood(self, name: str, focal: float) -> tuple[Pose, float | None]:
        """Where the camera was on average, and how far from where it was found, px; None if nothing better is known."""
        pose, motion = self.reconstruction.poses[name], motion_of(self.formation.effects)
        if motion is None or not self.found:
            return pose, None
        return motion.mean_pose(name, pose, focal), motion.offset(name, focal)

    def score(
        self, photo: Photo, heldout: bool, keep: Callable[[NDArray[np.uint8]], None] | None = None
    ) -> tuple[ViewScores, ViewPictures]:
        """Renders one view, sharp (handed to `keep`: [H, W, 3], as large as the photo's file) and degraded."""
        lens = self.reconstruction.lenses[photo.name]
        pose, moved = self._stood(photo.name, lens.fx)
        size = round(photo.size[0] / photo.scale[0]), round(photo.size[1] / photo.scale[1])
        sharp = self.viewer.sharp(lens.resized(*size), pose, finer=1.0 / photo.scale[0])
        twin = to_pixels(self._exposed(sharp, photo))
        if keep is not None:
            keep(twin)
        degraded, scores = self._against_photo(photo)
        scores.moved = moved
        truth = self._true(photo.name, size)
        if truth is not None:
            mask = photo.mask if photo.scale == (1.0, 1.0) else None
            cutoff = photo.scale[0] / self.period if self.period > NYQUIST_PERIOD else None
            scores.add_truth(_unit(twin), _unit(truth), mask, cutoff)
        small = photo.size

        def kept(picture: Pixels) -> NDArray[np.uint8]:
            return kept_beside(photo.pixels, _eight_bit(picture))

        pictures = ViewPictures(
            name=photo.name,
            heldout=heldout,
            photo=kept(photo.pixels),
            twin=kept(twin if size == small else resized(twin, *small)),
            degraded=kept(degraded),
            truth=None if truth is None else kept(truth if size == small else resized(truth, *small)),
            scores={"degraded": scores.degraded, "sharp": scores.sharp},
        )
        return scores, pictures

    def _exposed(self, sharp: NDArray[np.float32], photo: Photo) -> NDArray[np.float32]:
        """[3, H, W] as the camera exposed this photo, as far as that is known; the very same otherwise.

        So it is before a known background, which no camera has exposed.
        """
        exposure = Formation([effect for effect in self.formation.sensor if isinstance(effect, Exposure)])
        if not exposure or photo.background is not None:
            return sharp
        shot = Shot(photo.name, sharp.shape[1], sharp.shape[2])
        return np.asarray(exposure.filed(torch.from_numpy(sharp), shot).numpy())

    def fitted(self, photo: Photo) -> ViewScores:
        """Scores of a view that was trained on, against its photo."""
        return self._against_photo(photo)[1]

    def _against_photo(self, photo: Photo) -> tuple[NDArray[np.uint8], ViewScores]:
        """The view through the medium, [H, W, 3], and its scores against the photo."""
        lens, pose = self.reconstruction.lenses[photo.name], self.reconstruction.poses[photo.name]
        degraded = to_pixels(self.viewer.degraded(lens, pose, self.medium, photo.name, self.formation))
        scores = ViewScores(photo.name)
        filed = self._filed(photo, lens)
        matched = matched_psnr(_planes(degraded), filed.transpose(2, 0, 1), photo.mask, background_shows(photo))
        scores.add_photo(_unit(degraded), filed, photo.mask, matched)
        if Exposure.name in self.formation.names:
            empty = photo.transparency()
            present = None if empty is None else 1.0 - empty
            halves = exposed_by_halves(_planes(degraded), filed.transpose(2, 0, 1), photo.mask, present)
            scores.add_halves(halves.transpose(1, 2, 0), filed, photo.mask)
        return degraded, scores

    def _filed(self, photo: Photo, lens: Lens) -> NDArray[np.float64]:
        """[H, W, 3] the photo in [0, 1], as a render is that went through lens and sensor."""
        if photo.alpha is None or not self.formation.sensor:
            return _unit(photo.pixels)
        planes = _planes(photo.pixels).astype(np.float32)
        shot = Shot(photo.name, lens.height, lens.width, middle=(lens.cx, lens.cy))
        shown = over_filed(planes, photo.transparency(), photo.background, self.formation, shot)
        return np.ascontiguousarray(shown.transpose(1, 2, 0), np.float64)

    def _true(self, name: str, size: tuple[int, int]) -> Pixels | None:
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
        if abs(width * size[1] - height * size[0]) > ASPECT_TOLERANCE * width * size[1]:
            self.progress.note(
                f"The truth of '{name}' is {width} x {height} px, its photo {size[0]} x {size[1]}: not compared"
            )
            return None
        self.progress.note(f"The truth of '{name}' was scaled from {width} x {height} to {size[0]} x {size[1]} px")
        return resized(truth, *size)


@dataclass(frozen=True)
class ScoredViews:
    """What the report says of views: scores of the held-out ones, and pictures of some.

    Attributes:
        fitted: scores of a few views that were trained on, against their photos.
    """

    scores: list[ViewScores]
    pictures: list[ViewPictures]
    fitted: list[ViewScores] = field(default_factory=list)


def score_views(
    scorer: ViewScorer, photos: Sequence[Photo], held: Sequence[str], threads: int, timing: Timing, folder: TwinFolder
) -> ScoredViews:
    """Renders and scores held-out views, all there is time for; a few fitted ones are shown where none is held out.

    Args:
        photos: those with a camera; held: names of those that no training saw.

    Raises:
        OutputError: a render cannot be written.
    """
    by_name = {photo.name: photo for photo in photos}
    wanted = [name for name in held if name in by_name]
    if not wanted:
        names = sorted(by_name)
        shown_ones = [by_name[names[i]] for i in spread(len(names), SHOWN_FITTED)]
        return ScoredViews([], [scorer.score(photo, False)[1] for photo in shown_ones])
    files, scores, pictures = render_names(wanted), [], []
    shown = set(spread(len(wanted), SHOWN))

    def keep(file: str, pixels: NDArray[np.uint8]) -> None:
        folder.save_render(file, png_bytes(pixels))

    def one(name: str) -> tuple[ViewScores, ViewPictures] | None:
        return scorer.score(by_name[name], True, partial(keep, files[name])) if timing.another() else None

    def fitted(name: str) -> ViewScores | None:
        return scorer.fitted(by_name[name]) if name in compared[:LEAST_FITTED] or timing.another() else None

    # Interpolation, transforms and files wait for one core at a time: whole views side by side do not.
    others = sorted(set(by_name) - set(wanted))
    compared = [others[i] for i in spread(len(others), min(SCORED_FITTED, len(wanted)))]
    with ThreadPoolExecutor(threads) as pool:
        for index, found in enumerate(pool.map(one, wanted)):
            if found is None:
                continue
            scores.append(found[0])
            if index in shown:
                pictures.append(found[1])
            scorer.progress.advance(index + 1)
        seen = [row for row in pool.map(fitted, compared) if row is not None]
    if len(scores) < len(wanted):
        scorer.progress.note(f"{len(scores)} of {len(wanted)} held-out views were scored: there was no time for more")
    return ScoredViews(scores, pictures, seen)


def _unit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    return pixels.astype(np.float64) / np.iinfo(pixels.dtype).max


def _planes(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.float64]:
    return _unit(pixels).transpose(2, 0, 1)


def _eight_bit(pixels: NDArray[np.uint8] | NDArray[np.uint16]) -> NDArray[np.uint8]:
    if pixels.dtype == np.uint8:
        return pixels.astype(np.uint8, copy=False)
    return np.asarray(np.round(pixels / 257.0), np.uint8)
