"""The photos under inspection, and what several effects look at, each computed once."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..colour import srgb_to_linear
from ..numbers import number
from ..photos.empty import background_shows
from ..photos.load import Photo
from ..reconstruction import Reconstruction
from .haze_fit import HazeFit, fit_haze
from .local_blur import LocalBlur, Tiles, fit_local_blur
from .motion_paths import SETTINGS as PATHS
from .motion_paths import MotionPath, MotionPathFinder, SetMotion, find_motion_paths, set_motion
from .noise_level import noise_of
from .observations import SETTINGS as OBSERVED
from .observations import PointObservations, observe_points
from .photometry import Photometry, fit_photometry
from .spectra import Blur, fit_blur, polar_power

Array = NDArray[np.float64]
T = TypeVar("T")


@dataclass(frozen=True)
class PhotoSetSettings:
    """Numbers of what is looked at."""

    most_photos: int = number(24, "count", "photos whose spectra are looked at; more show little more")
    tiles: int = number(4, "count", "tiles along the photo's shorter side")
    smallest_tile: int = number(48, "px", "side of a tile at least: a smaller one has too few frequencies")
    largest_tile: int = number(160, "px", "side of a tile at most: a larger one says little of a place")
    least_sigma: float = number(0.3, "px", "of the photos' blur: no photo is sharper")
    fewest_points: int = number(4, "count", "points in a tile with a depth")
    flat_tile: float = number(0.15, "share", "of its depth between quarters: a tile of more depth has none of its own")


SETTINGS = PhotoSetSettings()


def grey_of(photo: Photo, linear: bool) -> NDArray[np.float32]:
    """[H, W] mean of the channels, of light if `linear`; what a mask hides is filled with the rest's mean."""
    most = np.iinfo(photo.pixels.dtype).max
    if linear:
        # Each channel's light by itself: the light of a mean is not the mean of lights.
        light = np.asarray(srgb_to_linear(np.arange(most + 1, dtype=np.float64) / most), np.float32)
        grey = light[photo.pixels].mean(axis=2, dtype=np.float32)
    else:
        grey = photo.pixels.mean(axis=2, dtype=np.float32) / np.float32(most)
    if photo.mask is not None and photo.mask.any():
        grey = np.where(photo.mask, grey, grey[photo.mask].mean())
    return np.asarray(grey, np.float32)


@dataclass
class PhotoSet:
    """Photos, and cameras if there are any.

    Attributes:
        photos: all of them.
        cameras: None where none were given or found; why: the reason then.
        linear: read spectra on linear light instead of sRGB values.
        blur: standard deviation of the photos' blur, px, where it is known: points are then looked up without reading
            any spectrum, as if nothing had moved.
    """

    photos: Sequence[Photo]
    cameras: Reconstruction | None = None
    why: str = ""
    linear: bool = False
    blur: float | None = None
    _answers: dict[Callable[..., Any], Any] = field(default_factory=dict, init=False, repr=False, compare=False)

    def once(self, look: Callable[[PhotoSet], T]) -> T:
        """What `look` says of these photos, however often it is asked."""
        if look not in self._answers:
            self._answers[look] = look(self)
        answer: T = self._answers[look]
        return answer

    def of_each(self, look: Callable[..., T], *of: Sequence[Any]) -> list[T]:
        """What `look` says of each photo, as many at a time as there are threads and memory for."""
        largest = max((photo.pixels.shape[0] * photo.pixels.shape[1] for photo in self.photos), default=0)
        with ThreadPoolExecutor(compiled.photos_at_once(largest)) as pool:
            return list(pool.map(look, *of))

    @cached_property
    def looked_at(self) -> list[Photo]:
        """The photos whose spectra are read: evenly spread over the set, of the commonest size."""
        sizes = [photo.size for photo in self.photos]
        commonest = max(set(sizes), key=lambda size: (sizes.count(size), size))
        same = [photo for photo in self.photos if photo.size == commonest]
        picked = np.linspace(0, len(same) - 1, min(SETTINGS.most_photos, len(same))).round().astype(int)
        return [same[i] for i in picked]

    @cached_property
    def greys(self) -> list[NDArray[np.float32]]:
        """[H, W] mean of the channels of `looked_at`; what a mask hides is filled with the rest's mean."""
        return [grey_of(photo, self.linear) for photo in self.looked_at]

    @cached_property
    def clipped(self) -> list[NDArray[np.bool_]]:
        """[H, W] of each of `looked_at`: where a channel is at its upper end, or a mask hides what was there."""
        out = []
        for photo in self.looked_at:
            white = (photo.pixels == np.iinfo(photo.pixels.dtype).max).any(axis=2)
            behind = self.behind(photo)
            if behind is not None:
                white &= ~behind
            out.append(white if photo.mask is None else white | ~photo.mask)
        return out

    def behind(self, photo: Photo) -> NDArray[np.bool_] | None:
        """[H, W] px that show what is behind everything, however bright that is; None where the photo does not say."""
        return background_shows(photo)

    @cached_property
    def rounding(self) -> float:
        """Standard deviation of the files' rounding, in [0, 1]."""
        return 1.0 / float(np.iinfo(self.photos[0].pixels.dtype).max) / 12.0**0.5

    @cached_property
    def grey_noise(self) -> list[float]:
        """Standard deviation of the noise of each of `greys`."""
        return self.of_each(lambda grey: noise_of(grey, self.rounding / 3.0**0.5), self.greys)

    @cached_property
    def blurs(self) -> list[Blur | None]:
        """Blur of each of `looked_at`, over the whole frame."""
        return self.blurs_between(0.0, 0.5)

    def blurs_between(self, lowest: float, highest: float) -> list[Blur | None]:
        """Blur of each of `looked_at`, from frequencies in this range, cycles/px."""
        return [
            fit_blur(power, (grey.shape[0], grey.shape[1]), noise**2, highest=highest, lowest=lowest)
            for power, grey, noise in zip(self.powers, self.greys, self.grey_noise, strict=True)
        ]

    @cached_property
    def powers(self) -> list[Array]:
        """Polar spectrum of each of `greys`."""
        return self.of_each(polar_power, self.greys)

    @cached_property
    def sigma(self) -> float:
        """Standard deviation of the photos' blur, px, median over the photos; at least 0.3."""
        variances = [blur.variance for blur in self.blurs if blur is not None]
        return max(float(np.median(variances)), 0.09) ** 0.5 if variances else SETTINGS.least_sigma

    @cached_property
    def sharpest(self) -> float:
        """Standard deviation of the blur of the sharpest photo, px; at least 0.3."""
        variances = [blur.variance for blur in self.blurs if blur is not None]
        return max(min(variances), 0.09) ** 0.5 if variances else SETTINGS.least_sigma

    @property
    def tile_side(self) -> float:
        """Side of the tiles, px, where the photos are that large."""
        wanted = min(self.greys[0].shape) / SETTINGS.tiles
        return float(np.clip(wanted, SETTINGS.smallest_tile, SETTINGS.largest_tile))

    @cached_property
    def tiles(self) -> Tiles:
        """Blur of overlapping tiles of `looked_at`."""
        rows: list[tuple[float, ...]] = []
        height, width = self.greys[0].shape
        side = min(int(self.tile_side), height, width)
        ys = np.linspace(0, height - side, max(1, round(height / side * 1.5))).round().astype(int)
        xs = np.linspace(0, width - side, max(1, round(width / side * 1.5))).round().astype(int)
        for index, (grey, noise) in enumerate(zip(self.greys, self.grey_noise, strict=True)):
            pixel, depth = self.seen(index)
            for y in ys:
                for x in xs:
                    blur = fit_blur(polar_power(grey[y : y + side, x : x + side]), (side, side), noise**2)
                    if blur is None:
                        continue
                    inside = (np.abs(pixel - [x + side / 2, y + side / 2]) < side / 2).all(axis=1)
                    place = (index, x + side / 2, y + side / 2)
                    rows.append((*place, blur.variance, blur.variance_error, _depth_of(depth[inside])))
        table = np.array(rows, float).reshape(-1, 6)
        return Tiles(table[:, 0].astype(int), table[:, 1], table[:, 2], table[:, 3], table[:, 4], table[:, 5])

    def seen(self, index: int) -> tuple[Array, Array]:
        """px [n, 2] and relative depth [n] of the observed points in one of `looked_at`."""
        observations, name = self.observations, self.looked_at[index].name
        if observations is None or name not in observations.names:
            return np.zeros((0, 2)), np.zeros(0)
        mine = observations.photo == observations.names.index(name)
        return observations.pixel[mine], observations.depth[mine]

    @cached_property
    def local_blur(self) -> LocalBlur | None:
        """Blur by depth and place; None with too few tiles."""
        height, width = self.greys[0].shape
        return fit_local_blur(self.tiles, height, width)

    @cached_property
    def motion(self) -> SetMotion | None:
        """Motion of `looked_at`; None with fewer than four photos, or too little detail."""
        finder = self._path_finder
        if finder is None:
            return None
        paths = self.of_each(finder.path, self.looked_at)
        return set_motion({photo.name: path for photo, path in zip(self.looked_at, paths, strict=True)})

    @cached_property
    def motion_paths(self) -> dict[str, MotionPath]:
        """The paths of all photos by name; empty where they cannot be estimated."""
        finder = self._path_finder
        return {} if finder is None else find_motion_paths(self.photos, self.rounding, finder)

    @cached_property
    def _path_finder(self) -> MotionPathFinder | None:
        if len(self.looked_at) < PATHS.fewest_photos:
            return None
        finder = MotionPathFinder(self.looked_at, self.rounding)
        return finder if finder.possible else None

    @cached_property
    def observations(self) -> PointObservations | None:
        """Points in several photos; None without cameras or points."""
        return self._observed()

    @cached_property
    def rough_observations(self) -> PointObservations | None:
        """The same where surroundings may differ as much as blur makes them differ."""
        return self._observed(alike=OBSERVED.roughly_alike)

    def _observed(self, alike: float = OBSERVED.alike) -> PointObservations | None:
        if self.cameras is None:
            return None
        if self.blur is not None:
            return observe_points(self.photos, self.cameras, self.blur, alike=alike)
        moved = self.motion
        paths = self.motion_paths if moved is not None and moved.significant else {}
        own = {name: (path.length, path.angle) for name, path in paths.items() if path.length}
        return observe_points(self.photos, self.cameras, self.sigma, paths=own, alike=alike)

    @cached_property
    def photometry(self) -> Photometry | None:
        """Gains and vignetting out of the observations."""
        return None if self.observations is None else fit_photometry(self.observations)

    @cached_property
    def haze(self) -> HazeFit | None:
        """What the way to the camera takes of the light, and adds to it, out of the observations."""
        return None if self.observations is None else fit_haze(self.observations)

    @property
    def no_observations(self) -> str:
        """Why there are no observations, as a sentence."""
        return self.why or "too few points are seen in three photos"


def _depth_of(depths: Array) -> float:
    """The depth of a tile: the median where the points in it lie at much the same depth, else NaN."""
    if len(depths) < SETTINGS.fewest_points:
        return float("nan")
    low, middle, high = np.quantile(depths, [0.25, 0.5, 0.75])
    return float(middle) if high - low <= SETTINGS.flat_tile * middle else float("nan")
