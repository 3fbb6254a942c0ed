"""Lenses as COLMAP names them: where a ray meets the photo, distortion included.

    x, y = ray / z (normalised);   x', y' = distort(x, y);   u = fx x' + cx,   v = fy y' + cy

Pixel centres are at +0.5. Checked against pycolmap in the tests, but numpy only: Blender's process
must not depend on native code that may abort.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from .errors import FormatError
from .numbers import number

Floats = NDArray[np.float64]

#: model -> (one focal length for both axes?, number of distortion parameters)
MODELS = {
    "SIMPLE_PINHOLE": (True, 0),
    "PINHOLE": (False, 0),
    "SIMPLE_RADIAL": (True, 1),
    "RADIAL": (True, 2),
    "OPENCV": (False, 4),
    "FULL_OPENCV": (False, 8),
    "SIMPLE_RADIAL_FISHEYE": (True, 1),
    "RADIAL_FISHEYE": (True, 2),
    "OPENCV_FISHEYE": (False, 4),
}

#: Longest side of a photo (px): ten times the largest panoramas.
_LARGEST_SIDE = 2**20
_EXPORT = "Export the cameras again, or let them be found from the photos"


@dataclass(frozen=True)
class UndistortSettings:
    """Newton's method, which finds the ideal coordinates of distorted ones. All lengths are normalised (1 = focal)."""

    steps: int = number(20, "count", "most steps; where a ray exists the search ends long before")
    tolerance: float = number(
        1e-10, "normalised", "the search ends where no error is larger: far below what a float32 resolves"
    )
    difference: float = number(1e-6, "normalised", "step of the central differences that the derivative is taken from")
    least_determinant: float = number(1e-9, "normalised^2", "a derivative below it cannot be inverted: no ray there")
    accepted: float = number(1e-6, "normalised", "a larger error that is left means that no ray reaches this place")


UNDISTORT = UndistortSettings()


@dataclass(frozen=True)
class Lens:
    """Intrinsics of a photo.

    Attributes:
        model: one of `MODELS`.
        width, height: size of the photo in px.
        params: in COLMAP's order: f | fx, fy; cx, cy; distortion.
    """

    model: str
    width: int
    height: int
    params: tuple[float, ...]

    def __post_init__(self) -> None:
        if self.model not in MODELS:
            raise FormatError(f"The lens model '{self.model}' is not supported", f"Use one of {', '.join(MODELS)}")
        if not (0 < self.width <= _LARGEST_SIDE and 0 < self.height <= _LARGEST_SIDE):
            raise FormatError(f"A lens of {self.width} x {self.height} px makes no sense", _EXPORT)
        simple, distortion = MODELS[self.model]
        if len(self.params) != (3 if simple else 4) + distortion:
            raise FormatError(f"A lens '{self.model}' cannot have {len(self.params)} parameters", _EXPORT)
        if not np.isfinite(self.params).all() or self.fx <= 0 or self.fy <= 0:
            raise FormatError(f"A lens '{self.model}' has the parameters {self.params}, which make no sense", _EXPORT)

    @property
    def fx(self) -> float:
        """Horizontal focal length in px."""
        return self.params[0]

    @property
    def fy(self) -> float:
        """Vertical focal length in px."""
        return self.params[0 if MODELS[self.model][0] else 1]

    @property
    def cx(self) -> float:
        """Column of the principal point in px."""
        return self.params[1 if MODELS[self.model][0] else 2]

    @property
    def cy(self) -> float:
        """Row of the principal point in px."""
        return self.params[2 if MODELS[self.model][0] else 3]

    @property
    def distortion(self) -> tuple[float, ...]:
        """Parameters behind focal lengths and principal point; empty for a pinhole."""
        return self.params[3 if MODELS[self.model][0] else 4 :]

    def resized(self, width: int, height: int) -> Lens:
        """The same lens on a photo scaled to `width` x `height`."""
        sx, sy = width / self.width, height / self.height
        simple = MODELS[self.model][0]
        if simple:
            # A photo's size is a whole number, so the two scales differ by a fraction of a pixel.
            focal = self.fx * float(np.sqrt(sx * sy))
            head: tuple[float, ...] = (focal, self.cx * sx, self.cy * sy)
        else:
            head = (self.fx * sx, self.fy * sy, self.cx * sx, self.cy * sy)
        return replace(self, width=width, height=height, params=(*head, *self.distortion))

    def distort(self, xy: Floats) -> Floats:
        """Ideal normalised coordinates [..., 2] -> distorted ones."""
        k = self.distortion
        if not any(k) and not self.model.endswith("FISHEYE"):
            return xy
        x, y = xy[..., 0], xy[..., 1]
        r2 = x * x + y * y
        if self.model.endswith("FISHEYE"):
            r = np.sqrt(r2)
            theta = np.arctan(r)
            t2 = theta * theta
            series = np.ones_like(t2)
            power = np.ones_like(t2)
            for coefficient in k:
                power = power * t2
                series = series + coefficient * power
            gain = np.where(r > 1e-12, theta * series / np.maximum(r, 1e-12), 1.0)
            return np.stack([x * gain, y * gain], axis=-1)
        if self.model in ("SIMPLE_RADIAL", "RADIAL"):
            gain = 1.0 + r2 * (k[0] + (k[1] * r2 if len(k) > 1 else 0.0))
            return np.stack([x * gain, y * gain], axis=-1)
        k1, k2, p1, p2 = k[:4]
        gain = 1.0 + r2 * (k1 + r2 * k2)
        if self.model == "FULL_OPENCV":
            k3, k4, k5, k6 = k[4:]
            gain = (1.0 + r2 * (k1 + r2 * (k2 + r2 * k3))) / (1.0 + r2 * (k4 + r2 * (k5 + r2 * k6)))
        return np.stack(
            [
                x * gain + 2.0 * p1 * x * y + p2 * (r2 + 2.0 * x * x),
                y * gain + 2.0 * p2 * x * y + p1 * (r2 + 2.0 * y * y),
            ],
            axis=-1,
        )

    def undistort(self, xy: Floats) -> Floats:
        """Distorted normalised coordinates [..., 2] -> ideal ones (Newton's method); NaN where none."""
        if not any(self.distortion) and not self.model.endswith("FISHEYE"):
            return xy
        if self.model.endswith("FISHEYE"):
            # tan(r) is exact without distortion, a good start with it.
            r = np.sqrt((xy**2).sum(-1, keepdims=True))
            guess = xy * np.where(r > 1e-12, np.tan(np.minimum(r, 1.5)) / np.maximum(r, 1e-12), 1.0)
        else:
            guess = xy.copy()
        step = UNDISTORT.difference
        for _ in range(UNDISTORT.steps):
            error = self.distort(guess) - xy
            if not (np.abs(error) > UNDISTORT.tolerance).any():
                break
            dx = (self.distort(guess + [step, 0.0]) - self.distort(guess - [step, 0.0])) / (2 * step)
            dy = (self.distort(guess + [0.0, step]) - self.distort(guess - [0.0, step])) / (2 * step)
            det = dx[..., 0] * dy[..., 1] - dx[..., 1] * dy[..., 0]
            det = np.where(np.abs(det) < UNDISTORT.least_determinant, np.nan, det)
            move_x = (dy[..., 1] * error[..., 0] - dy[..., 0] * error[..., 1]) / det
            move_y = (dx[..., 0] * error[..., 1] - dx[..., 1] * error[..., 0]) / det
            guess = guess - np.stack([move_x, move_y], axis=-1)
        error = np.abs(self.distort(guess) - xy).max(-1)
        return np.where((error < UNDISTORT.accepted)[..., None], guess, np.nan)

    def to_pixels(self, xy: Floats) -> Floats:
        """Ideal normalised coordinates [..., 2] -> px."""
        return self.distort(xy) * [self.fx, self.fy] + [self.cx, self.cy]

    def from_pixels(self, uv: Floats) -> Floats:
        """px [..., 2] -> ideal normalised coordinates; NaN where no ray reaches."""
        return self.undistort((uv - [self.cx, self.cy]) / [self.fx, self.fy])

    def largest_shift(self) -> float:
        """By how many px distortion moves the most displaced point of the frame's border and grid."""
        if not any(self.distortion) and not self.model.endswith("FISHEYE"):
            return 0.0
        u, v = np.meshgrid(np.linspace(0.0, self.width, 33), np.linspace(0.0, self.height, 33))
        uv = np.stack([u, v], axis=-1)
        straight = (uv - [self.cx, self.cy]) / [self.fx, self.fy]
        shift = (self.from_pixels(uv) - straight) * [self.fx, self.fy]
        return float(np.nan_to_num(np.linalg.norm(shift, axis=-1), nan=np.inf).max())
