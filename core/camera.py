"""A pinhole camera in COLMAP's convention: x right, y down, z forward, world to camera.

    p_camera = rotation @ p_world + translation
    u = fx * x / z + cx,   v = fy * y / z + cy

Pixel (column, row) covers [column, column + 1) x [row, row + 1); its centre is at +0.5.
Lens distortion is undone before a `Camera` is made (`core.photos`).
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray


@dataclass(frozen=True)
class Camera:
    """One view's pinhole camera.

    Attributes:
        name: the photo's file name, unique within a set.
        width, height: frame size in px.
        fx, fy, cx, cy: focal lengths and principal point in px.
        rotation: [3, 3] float64, world to camera.
        translation: [3] float64, world to camera, in world units.
    """

    name: str
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    rotation: NDArray[np.float64] = field(repr=False)
    translation: NDArray[np.float64] = field(repr=False)

    @property
    def centre(self) -> NDArray[np.float64]:
        """Position of the camera in the world, [3]."""
        return -self.rotation.T @ self.translation

    def resized(self, width: int, height: int) -> Camera:
        """The same view on a grid of `width` x `height` pixels."""
        sx, sy = width / self.width, height / self.height
        return replace(
            self, width=width, height=height, fx=self.fx * sx, fy=self.fy * sy, cx=self.cx * sx, cy=self.cy * sy
        )

    def with_margin(self, margin: int) -> Camera:
        """The same view with `margin` more pixels on every side (less, if negative)."""
        return replace(
            self,
            width=self.width + 2 * margin,
            height=self.height + 2 * margin,
            cx=self.cx + margin,
            cy=self.cy + margin,
        )

    def moved(self, rotation: NDArray[np.float64], translation: NDArray[np.float64]) -> Camera:
        """The same lens at another pose."""
        return replace(self, rotation=rotation, translation=translation)

    def projected(self, points: NDArray[np.floating]) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """[M, 2] px where points [M, 3] of the world lie, NaN behind the camera, and [M] their depths."""
        x, y, depth = (points @ self.rotation.T + self.translation).T
        ahead = np.where(depth > 0, depth, np.nan)
        return np.stack([self.fx * x / ahead + self.cx, self.fy * y / ahead + self.cy], axis=1), depth

    def in_frame(self, points: NDArray[np.floating], beside: float = 0.0) -> NDArray[np.bool_]:
        """Which points [M, 3] of the world are in front of the camera and in its frame: [M] bool.

        Args:
            beside: of the frame's sides, by which it counts as wider on each of them.
        """
        u, v = self.projected(points)[0].T  # (NaN is in no frame)
        right, down = beside * self.width, beside * self.height
        across = (u >= -right) & (u < self.width + right)
        return np.asarray(across & (v >= -down) & (v < self.height + down))
