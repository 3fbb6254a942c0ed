"""Which photo shows which point, with what colour: the points of the cameras looked up in all photos.

Camera files seldom say which photo saw a point, so every point is projected into every photo, and a photo counts as
seeing it where the surroundings look the same (normalised correlation of small patches) as in the others. Colours
come in linear light, as gains, vignetting and haze are laws of light.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from .. import compiled
from ..colour import srgb_to_linear
from ..numbers import number
from ..photos.load import Photo
from ..reconstruction import Reconstruction

Array = NDArray[np.float64]

#: Half side of the patch that is correlated, samples.
_HALF = 4


@dataclass(frozen=True)
class ObservationSettings:
    """Numbers of looking points up in photos."""

    most_points: int = number(2500, "count", "points looked up at most: more cost time and say little more")
    most_photos: int = number(16, "count", "photos per point at most")
    fewest_photos: int = number(3, "count", "photos per point at least")
    fewest_points: int = number(50, "count", "points of the cameras at least")
    fewest_observations: int = number(100, "count", "observations at least")
    window: float = number(1.8, "px", "standard deviation of the window that a colour is the mean of, farthest photo")
    window_share: float = number(0.45, "share", "of the patch's half side: the same window")
    blur_windows: float = number(1.3, "ratio", "of the widest window to the photos' blur")
    path_room: float = number(1.3, "ratio", "of a window's variance to that of the photos' paths, so that they fit in")
    border: float = number(2.5, "windows", "that a point keeps from the frame's border")
    alike: float = number(0.85, "correlation", "from which on a photo's patch shows the point")
    roughly_alike: float = number(
        0.7,
        "correlation",
        "the same, where photos may be blurred differently",
        "defocused photos of banana: 25 of 26 photos have points enough, with 0.85 20, with 0.6 26 (but sharp ones then"
        " explain 0.009 by foci, 0.0035 with 0.7)",
    )
    varied: float = number(0.02, "share of full scale", "by which a patch varies at least, to be like no other")
    darkest: float = number(0.005, "linear light", "darker observations are mostly noise")
    brightest: float = number(0.97, "sRGB", "brighter ones are clipped")


SETTINGS = ObservationSettings()


#: Pairs of photos that are compared together: 32 MB.
_PAIRS_AT_ONCE = 2**23


@dataclass(frozen=True)
class PointObservations:
    """Observations of points (`sfm.tracks` matches features; these are points of given cameras, looked up).

    Attributes:
        point, photo: [N] indices; photos in the order of `names`.
        light: [N, 3] linear light around the projection.
        depth: [N] along the optical axis, divided by the median over all observations.
        distance: [N] way of the light from the point to the camera, in the same unit.
        radius: [N] distance from the photo's middle over half its diagonal.
        direction: [N, 3] unit vector from the point to the camera (world).
        pixel: [N, 2] px.
        block: [N] region of space that the point belongs to: errors within one are alike.
        names: photos.
        median_depth: what `depth` was divided by, in the cameras' unit of length.
    """

    point: NDArray[np.int64] = field(repr=False)
    photo: NDArray[np.int64] = field(repr=False)
    light: Array = field(repr=False)
    depth: Array = field(repr=False)
    distance: Array = field(repr=False)
    radius: Array = field(repr=False)
    direction: Array = field(repr=False)
    pixel: Array = field(repr=False)
    block: NDArray[np.int64] = field(repr=False)
    names: tuple[str, ...] = ()
    median_depth: float = 1.0

    def __len__(self) -> int:
        return len(self.point)


def observe_points(
    photos: Sequence[Photo],
    cameras: Reconstruction,
    blur: float,
    seed: int = 0,
    paths: Mapping[str, tuple[float, float]] = MappingProxyType({}),
    alike: float = SETTINGS.alike,
) -> PointObservations | None:
    """Finds the cameras' points in the photos; None where too few are seen often enough.

    Args:
        blur: standard deviation of the photos' blur, px: patches grow with it.
        paths: length (px) and direction (degrees) of photos that moved; colours are compared at equal blur.
        alike: correlation of the surroundings from which on a photo shows a point.
    """
    random = np.random.default_rng(seed)
    used = [photo for photo in photos if photo.name in cameras.poses]
    positions = cameras.points.positions
    if len(used) < SETTINGS.fewest_photos or len(positions) < SETTINGS.fewest_points:
        return None
    if len(positions) > SETTINGS.most_points:
        positions = positions[np.sort(random.choice(len(positions), SETTINGS.most_points, replace=False))]
    moved = np.array([paths.get(photo.name, (0.0, 0.0)) for photo in used])
    blur, widest = _window(blur, moved[:, 0])
    pixels, depths = _projected(used, cameras, positions, SETTINGS.border * widest)
    steps = _steps(depths, blur, widest)
    seen = _agreeing(_patches(used, pixels, depths, steps), alike)
    point, photo = np.nonzero(seen)
    if len(point) < SETTINGS.fewest_observations:
        return None
    light, valid = _colours(used, pixels, steps, seen, moved)
    light, point, photo = light[valid], point[valid], photo[valid]
    counts = np.bincount(point, minlength=len(positions))
    keep = counts[point] >= SETTINGS.fewest_photos
    light, point, photo = light[keep], point[keep], photo[keep]
    if len(point) < SETTINGS.fewest_observations:
        return None
    centres = np.stack([cameras.poses[p.name].centre for p in used])
    away = centres[photo] - positions[point]
    at, depth = pixels[point, photo], depths[point, photo]
    size = np.array([p.size for p in used], float)[photo]
    way, middle = np.linalg.norm(away, axis=1), float(np.median(depth))
    return PointObservations(
        point,
        photo,
        light,
        depth / middle,
        way / middle,
        np.linalg.norm(at - size / 2, axis=1) / (np.linalg.norm(size, axis=1) / 2),
        away / way[:, None],
        at,
        _blocks(positions, random)[point],
        tuple(p.name for p in used),
        middle,
    )


def _window(blur: float, paths: Array) -> tuple[float, float]:
    """The blur that photos share, px, and the widest half side of a window of colours, given lengths of paths [V].

    Of the blur, what motion adds on average is each photo's own; windows are wide enough to leave it room.
    """
    motion = float(np.median(paths**2)) / 24.0
    blur = math.sqrt(max(blur**2 - motion, 0.09)) if motion else blur
    long = float(np.quantile(paths, 0.9))
    for_paths = math.sqrt(blur**2 + SETTINGS.path_room * long**2 / 12.0)
    return blur, max(SETTINGS.window, SETTINGS.blur_windows * blur, for_paths)


def _projected(
    photos: Sequence[Photo], cameras: Reconstruction, positions: Array, border: float
) -> tuple[Array, Array]:
    """px [P, V, 2] (NaN where a point is not well inside the frame) and depths [P, V]."""
    pixels = np.full((len(positions), len(photos), 2), np.nan)
    depths = np.full(pixels.shape[:2], np.nan)
    for v, photo in enumerate(photos):
        pose, lens = cameras.poses[photo.name], cameras.lenses[photo.name]
        local = positions @ pose.rotation.T + pose.translation
        ahead = local[:, 2] > 1e-6
        uv = np.full((len(positions), 2), np.nan)
        uv[ahead] = lens.to_pixels(local[ahead, :2] / local[ahead, 2:])
        with np.errstate(invalid="ignore"):
            inside = ahead & (uv > border).all(axis=1) & (uv < np.array(photo.size) - border).all(axis=1)
        if photo.mask is not None:
            column, row = uv[inside].astype(int).T
            inside[np.flatnonzero(inside)[~photo.mask[row, column]]] = False
        pixels[inside, v], depths[inside, v] = uv[inside], local[inside, 2]
    return pixels, depths


def _steps(depths: Array, blur: float, window: float) -> Array:
    """[P, V] px between samples, so that window and blur together cover the same piece of surface at any distance.

    Were it the same px, a point farther away would be mixed with more of its surroundings, and fade as in haze.
    """
    with np.errstate(invalid="ignore"):
        farthest = np.nanmax(np.where(np.isfinite(depths), depths, -np.inf), axis=1, keepdims=True)
    total = window * np.clip(farthest / depths, 1.0, 3.0)
    return np.asarray(np.sqrt(np.maximum(total**2 - blur**2, 0.25)) / (SETTINGS.window_share * _HALF))


def _samples(plane: NDArray[np.float32], at: Array, steps: Array, half: int) -> NDArray[np.float32]:
    """[n, (2 half + 1)^2] values around px `at` [n, 2], `steps` [n] px apart."""
    t = np.arange(-half, half + 1)
    dy, dx = (g.ravel() for g in np.meshgrid(t, t, indexing="ij"))
    rows = at[:, 1, None] - 0.5 + steps[:, None] * dy
    columns = at[:, 0, None] - 0.5 + steps[:, None] * dx
    return np.asarray(ndimage.map_coordinates(plane, [rows, columns], order=1, mode="nearest"), np.float32)


def _patches(photos: Sequence[Photo], pixels: Array, depths: Array, steps: Array) -> NDArray[np.float32]:
    """[N, V, P] grey around each of N points in each of V photos; NaN where it is not in the frame."""
    patches = np.full((*depths.shape, (2 * _HALF + 1) ** 2), np.nan, np.float32)

    def look(v: int) -> None:
        there = np.isfinite(depths[:, v])
        patches[there, v] = _samples(_grey(photos[v]), pixels[there, v], steps[there, v], _HALF)

    with ThreadPoolExecutor(_at_once(photos)) as pool:
        list(pool.map(look, range(len(photos))))
    return patches


def _at_once(photos: Sequence[Photo]) -> int:
    return compiled.photos_at_once(max((photo.pixels.shape[0] * photo.pixels.shape[1] for photo in photos), default=0))


def _grey(photo: Photo) -> NDArray[np.float32]:
    red, green, blue = (photo.pixels[..., c] for c in range(3))  # (their sum is exact; numpy's own mean takes 5 times)
    return (red.astype(np.float32) + green + blue) / np.float32(3) / np.float32(np.iinfo(photo.pixels.dtype).max)


def _agreeing(patches: NDArray[np.float32], wanted: float) -> NDArray[np.bool_]:
    """[P, V] which photos show what most others show, for each point."""
    centred = patches - patches.mean(axis=2, keepdims=True)
    spread = np.sqrt(np.square(centred).mean(axis=2))
    unit = centred / np.maximum(spread, 1e-6)[:, :, None] / np.sqrt(patches.shape[2])
    good = np.isfinite(spread) & (spread > SETTINGS.varied)
    unit = np.where(good[:, :, None], unit, 0.0)
    out = np.zeros(good.shape, bool)
    # A few points at a time: every photo with every other is a square of photos for each of them.
    some = max(1, _PAIRS_AT_ONCE // good.shape[1] ** 2)
    for first in range(0, len(unit), some):
        part = slice(first, first + some)
        alike = np.einsum("pvn,pwn->pvw", unit[part], unit[part], optimize=True)
        best = np.argmax(alike.clip(min=0.5).sum(axis=2), axis=1)
        out[part] = np.take_along_axis(alike, best[:, None, None], axis=2)[:, :, 0] > wanted
    out &= good
    # More photos of one point than this add little and cost much.
    too_many = out.sum(axis=1) > SETTINGS.most_photos
    for p in np.flatnonzero(too_many):
        seen = np.flatnonzero(out[p])
        out[p, seen[(np.arange(len(seen)) * 7919 + p) % len(seen) >= SETTINGS.most_photos]] = False
    return out


def _colours(
    photos: Sequence[Photo], pixels: Array, steps: Array, seen: NDArray[np.bool_], paths: Array
) -> tuple[Array, NDArray[np.bool_]]:
    """[N, 3] linear light at every observation (in the order of nonzero), and whether it can be used."""
    light = np.zeros((*seen.shape, 3))
    valid = np.zeros(seen.shape, bool)
    t = np.arange(-_HALF, _HALF + 1)
    window = np.exp(-0.5 * (t[:, None] ** 2 + t[None, :] ** 2) / (SETTINGS.window_share * _HALF) ** 2).ravel()
    window /= window.sum()

    def look(v: int) -> None:
        points, photo = np.flatnonzero(seen[:, v]), photos[v].pixels
        if not len(points):
            return
        windows = _narrowed(window, paths[v], steps[points, v]) if paths[v, 0] else window
        for c in range(3):
            unit = photo[..., c].astype(np.float32) / np.float32(np.iinfo(photo.dtype).max)
            encoded = _samples(unit, pixels[points, v], steps[points, v], _HALF)
            light[points, v, c] = (srgb_to_linear(encoded) * windows).sum(axis=1)
            clean = encoded.max(axis=1) < SETTINGS.brightest
            valid[points, v] = clean if c == 0 else valid[points, v] & clean
        valid[points, v] &= light[points, v].min(axis=1) > SETTINGS.darkest

    with ThreadPoolExecutor(_at_once(photos)) as pool:
        list(pool.map(look, range(len(photos))))
    return light[seen], valid[seen]


def _narrowed(window: Array, path: Array, steps: Array) -> Array:
    """[n, (2 half + 1)^2] the window without what the photo's path has spread along itself already.

    Were it the same window, photos that moved would mix a point with more of its surroundings, as haze does.
    """
    t, turn = np.arange(-_HALF, _HALF + 1), math.radians(path[1])
    along = (math.cos(turn) * t[None, :] + math.sin(turn) * t[:, None]).ravel()
    wide = SETTINGS.window_share * _HALF
    share = np.clip(path[0] ** 2 / 12.0 / (steps * wide) ** 2, 0.0, 0.9)  # of the window's variance
    narrow = window * np.exp(-0.5 * (along[None, :] / wide) ** 2 * (share / (1.0 - share))[:, None])
    return np.asarray(narrow / narrow.sum(axis=1, keepdims=True))


def _blocks(positions: Array, random: np.random.Generator, count: int = 40) -> NDArray[np.int64]:
    """Region of space of every point: a few rounds of k-means."""
    centres = positions[random.choice(len(positions), min(count, len(positions)), replace=False)]
    nearest = np.zeros(len(positions), np.int64)
    for _ in range(6):
        nearest = np.argmin(((positions[:, None] - centres[None]) ** 2).sum(axis=2), axis=1)
        for k in range(len(centres)):
            if (nearest == k).any():
                centres[k] = positions[nearest == k].mean(axis=0)
    return nearest
