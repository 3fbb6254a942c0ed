"""Widths of the straight, isolated edges in a picture.

A step under a Gaussian blur is its error function, whose width is the blur's. Small round pieces around the crests of
the slope are fitted with one such step each, bent a little, on an even slope (`edge_kernels`). A piece counts where the
step is all there is: little is left over, and both sides are flat. That flatness distinguishes steps from the many
places in a textured picture that merely look like one.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, fields

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from ..compiled import run
from ..numbers import number
from .edge_kernels import fit_steps

Array = NDArray[np.float64]

#: What the rules of the blind blur were chosen on, and what they were checked on (docs/studies/blind_blur.md).
CALIBRATION = "drawn scenes and pictures of `benchmarks.blind_psf --calibrate`"
CHECKED = "benchmarks.blind_psf: 9 drawn scenes, 4 photo sets, 7 pictures; photographs miss 5 % in 6 of 28"


@dataclass(frozen=True)
class EdgeSettings:
    """Numbers of the fit of one blurred step to a piece, and of what counts as one."""

    finest_width: float = number(
        1.6, "px", "pictures are averaged until the blur is this wide: a piece then holds a few hundred values at most"
    )
    radius: float = number(2.8, "sigma", "of a piece: a step is flat beyond", CALIBRATION, CHECKED)
    bell: float = number(0.6, "sigma", "of the bell whose slope finds the edges")
    minimum_height: float = number(0.02, "share of full scale", "least height of a step")
    minimum_contrast: float = number(12.0, "noise", "least height of a step over the noise", CALIBRATION, CHECKED)
    maximum_edges: int = number(1000, "count", "edges of one picture that are fitted at most: time only")
    region: int = number(48, "px", "edges of one region of a picture may be one contour, and count as one")
    maximum_rest: float = number(
        0.03, "share of the height (rms)", "what a fit may leave over beside noise", CALIBRATION, CHECKED
    )
    maximum_slope: float = number(
        0.05,
        "heights per width",
        "slope beside a step: where there is one, something else is near",
        CALIBRATION,
        CHECKED,
    )
    slope_correction: float = number(
        1.5, "log width per slope", "what chance leaves of such a slope has narrowed the fitted width by as much"
    )
    maximum_curvature: float = number(0.2, "1 / width", "largest curvature of an edge")
    arc_widening: float = number(
        1.45,
        "ratio",
        "a blurred arc of curvature k is wider than a line by arc_widening k^2 / (1 + arc_saturation k^2)",
    )
    arc_saturation: float = number(10.0, "ratio", "see arc_widening")


SETTINGS = EdgeSettings()


@dataclass(frozen=True)
class Edges:
    """Edges that a blurred step describes.

    Attributes:
        photo: [N] index of the picture.
        x, y: [N] place, px.
        direction: [N] of the normal, radians from x towards y.
        variance: [N] of the blur across the edge, px^2, pixel's own averaging included.
        error: [N] standard deviation of `variance` by noise and by what the fit leaves over.
        left: [N] rms that the fit leaves over, of the height.
        height: [N].
    """

    photo: NDArray[np.int64] = field(repr=False)
    x: Array = field(repr=False)
    y: Array = field(repr=False)
    direction: Array = field(repr=False)
    variance: Array = field(repr=False)
    error: Array = field(repr=False)
    left: Array = field(repr=False)
    height: Array = field(repr=False)

    def __len__(self) -> int:
        return len(self.x)

    def chosen(self, which: NDArray[np.bool_]) -> Edges:
        """Some of them, [N]."""
        return Edges(*(getattr(self, f.name)[which] for f in fields(self)))

    @property
    def group(self) -> NDArray[np.int64]:
        """[N] number of the region of its picture, side `region` px."""
        cells = np.stack([self.photo, self.x // SETTINGS.region, self.y // SETTINGS.region], axis=1).astype(np.int64)
        return np.unique(cells, axis=0, return_inverse=True)[1].reshape(-1)


def together(several: list[Edges]) -> Edges:
    """All edges of several pictures."""
    return Edges(*(np.concatenate([getattr(e, f.name) for e in several]) for f in fields(Edges)))


def find_edges(
    grey: NDArray[np.float32],
    noise: float,
    sigma: float,
    clipped: NDArray[np.bool_] | None = None,
    photo: int = 0,
    most: int = SETTINGS.maximum_edges,
) -> Edges:
    """Fits the straight, isolated edges of a blurred picture.

    Args:
        grey: [H, W], in the light that the blur acts on.
        noise: its standard deviation.
        sigma: about what the blur is, px, within a third or so.
        clipped: [H, W], true where values are not those of the light.
        photo: number of the picture, kept with its edges.
        most: edges that are fitted, strongest first.
    """
    by = max(1, int(sigma / SETTINGS.finest_width))
    small = np.ascontiguousarray(averaged(grey, by), np.float32)
    noise = noise / by
    width = math.sqrt(sigma**2 + (by * by - 1) / 12.0) / by
    radius = max(SETTINGS.radius * width, 3.2)
    rows, columns, angles = _candidates(small, width, _least_height(noise), math.ceil(radius) + 1)
    if clipped is not None and len(rows):
        near = ndimage.maximum_filter(averaged(clipped.astype(np.float32), by), 2 * math.floor(radius) + 1)
        free = near[rows, columns] == 0
        rows, columns, angles = rows[free], columns[free], angles[free]
    rows, columns, angles = rows[:most], columns[:most], angles[:most]
    fitted = np.full((len(rows), 9), np.nan)
    if len(rows):
        run(fit_steps, len(rows), small, rows, columns, angles, width, radius, fitted, grain=32)
    steps = _Steps(*fitted.T)
    ok = steps.alone(width, noise)
    return steps.chosen(ok).edges(photo, rows[ok], columns[ok], noise, by)


def _least_height(noise: float) -> float:
    return max(SETTINGS.minimum_contrast * noise, SETTINGS.minimum_height)


@dataclass(frozen=True)
class _Steps:
    """What `fit_steps` finds of pieces, [N] each: lengths in px of the averaged picture, angles in radians.

    Attributes:
        size: width of the step; height, place, direction, curve: of it; left: rms that the fit leaves over.
        share: of what is left over in the width; across, along: slope beside the step.
    """

    size: Array
    height: Array
    place: Array
    direction: Array
    curve: Array
    left: Array
    share: Array
    across: Array
    along: Array

    @property
    def full(self) -> Array:
        """[N] height without its sign."""
        return np.abs(self.height)

    @property
    def slope(self) -> Array:
        """[N] across the step, heights per width."""
        with np.errstate(invalid="ignore", divide="ignore"):
            return self.across * self.size / self.height

    def chosen(self, which: NDArray[np.bool_]) -> _Steps:
        return _Steps(*(getattr(self, f.name)[which] for f in fields(self)))

    def alone(self, width: float, noise: float) -> NDArray[np.bool_]:
        """[N] where the step is all there is in its piece."""
        full = self.full
        with np.errstate(invalid="ignore", divide="ignore"):
            ok = (
                (np.abs(self.place) < width)
                & (full > _least_height(noise))
                & (np.abs(self.curve) * self.size < SETTINGS.maximum_curvature)
            )
            ok &= np.abs(self.slope) < SETTINGS.maximum_slope
            ok &= np.abs(self.along) * self.size < SETTINGS.maximum_slope * full
            return ok & (self.left < np.hypot(SETTINGS.maximum_rest * full, 1.5 * noise))

    def edges(self, photo: int, rows: NDArray[np.int64], columns: NDArray[np.int64], noise: float, by: int) -> Edges:
        """The same as edges of the picture, of which `by` px to a side were averaged."""
        bent = np.square(self.curve * self.size)
        true = (
            self.size
            * (1.0 - SETTINGS.arc_widening * bent / (1.0 + SETTINGS.arc_saturation * bent))
            * np.exp(SETTINGS.slope_correction * self.slope)
        )
        return Edges(
            np.full(len(bent), photo),
            (columns + 0.5) * by,
            (rows + 0.5) * by,
            self.direction,
            np.square(true * by) - (by * by - 1) / 12.0,
            2 * self.size * self.share * np.maximum(self.left, noise) * by * by,
            self.left / self.full,
            self.full,
        )


def averaged(values: NDArray[np.float32], by: int) -> NDArray[np.float32]:
    """[H // by, W // by] means of `by` x `by` px each; what is left over at the right and below is not in it."""
    h, w = (n // by for n in values.shape)
    if by == 1:
        return values
    return values[: h * by, : w * by].reshape(h, by, w, by).mean(axis=(1, 3), dtype=np.float32)


def _candidates(
    grey: NDArray[np.float32], width: float, least: float, border: int
) -> tuple[NDArray[np.int64], NDArray[np.int64], Array]:
    """Middles (row, column) and direction of the strongest slopes, at most one in a cell, strongest first."""
    bell = SETTINGS.bell * width
    gx = ndimage.gaussian_filter(grey, bell, order=(0, 1))
    gy = ndimage.gaussian_filter(grey, bell, order=(1, 0))
    slope = np.hypot(gx, gy)
    height = slope * math.sqrt(2 * math.pi * (bell**2 + width**2))
    inner = np.zeros(grey.shape, bool)
    if min(grey.shape) <= 2 * border + 2:
        none = np.zeros(0, np.int64)
        return none, none, np.zeros(0)
    inner[border:-border, border:-border] = True
    r, c = np.nonzero(inner & (height > least))
    dx, dy = gx[r, c] / slope[r, c], gy[r, c] / slope[r, c]
    # A crest of the slope: no lower than a px further along the normal.
    sx, sy = np.rint(dx).astype(int), np.rint(dy).astype(int)
    here = slope[r, c]
    crest = (here >= slope[r + sy, c + sx]) & (here > slope[r - sy, c - sx])
    r, c = r[crest], c[crest]
    order = np.argsort(-height[r, c], kind="stable")
    r, c = r[order], c[order]
    cell = max(2, round(1.5 * width))
    _, first = np.unique((r // cell) * (grey.shape[1] // cell + 1) + c // cell, return_index=True)
    first.sort()
    r, c = r[first], c[first]
    return r.astype(np.int64), c.astype(np.int64), np.arctan2(gy[r, c], gx[r, c]).astype(float)
