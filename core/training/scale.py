"""The scene in units of its own: median viewing distance 1, origin among the points.

Step sizes, the near plane and float32 all want a scene of about unit size; photos come in metres,
millimetres or UTM coordinates of 1e6. Everything is trained in these units and converted back.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import torch
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import CameraError
from ..gaussians import Gaussians
from ..numbers import number
from ..views import SparsePoints


@dataclass(frozen=True)
class ScaleSettings:
    """Numbers of the scene's unit."""

    points: int = number(
        2000, "count", "sparse points that the medians are taken of, where there are at least twice as many"
    )


SCALE = ScaleSettings()


@dataclass(frozen=True)
class SceneScale:
    """world = origin + size * unit.

    Attributes:
        origin: [3] float64 world position of the unit scene's origin.
        size: world units per unit.
    """

    origin: NDArray[np.float64]
    size: float

    def camera_to_unit(self, camera: Camera) -> Camera:
        """The same view of the unit scene."""
        t = (camera.rotation @ self.origin + camera.translation) / self.size
        return camera.moved(camera.rotation, t)

    def points_to_unit(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """World positions [M, 3] in unit coordinates."""
        return (positions - self.origin) / self.size

    def to_world(self, gaussians: Gaussians) -> Gaussians:
        """Unit Gaussians in world coordinates (float32; origin added in float64)."""
        out = gaussians.detached()
        origin = torch.from_numpy(self.origin).to(out.means.device)
        out.means = (out.means.double() * self.size + origin).to(out.means.dtype)
        out.log_scales = out.log_scales + float(np.log(self.size))
        return out

    def sparse_to_unit(self, points: SparsePoints) -> SparsePoints:
        """World points, with their samples of surfaces, in unit coordinates."""
        samples = None if points.samples is None else self.sparse_to_unit(points.samples)
        return replace(points, positions=self.points_to_unit(points.positions), samples=samples)

    def to_unit(self, gaussians: Gaussians) -> Gaussians:
        """World Gaussians in unit coordinates."""
        out = gaussians.detached()
        origin = torch.from_numpy(self.origin).to(out.means.device)
        out.means = ((out.means.double() - origin) / self.size).to(out.means.dtype)
        out.log_scales = out.log_scales - float(np.log(self.size))
        return out


def scene_scale(cameras: Sequence[Camera], points: SparsePoints) -> SceneScale:
    """The unit of a scene: the median depth at which cameras see the points.

    Raises:
        CameraError: no point lies in front of any camera.
    """
    positions = points.positions
    if len(positions) > 2 * SCALE.points:
        positions = positions[:: len(positions) // SCALE.points]
    depths = []
    for camera in cameras:
        z = positions @ camera.rotation[2] + camera.translation[2]
        depths.append(z[z > 0])
    seen = np.concatenate(depths) if depths else np.zeros(0)
    if len(seen) == 0:
        raise CameraError(
            "No reconstructed point lies in front of a camera", "Check the cameras' axes (world to camera, z forward)"
        )
    return SceneScale(np.median(positions, axis=0).astype(np.float64), float(np.median(seen)))


def twin_scale(cameras: Sequence[Camera], means: NDArray[np.float32]) -> SceneScale:
    """The unit of a scene whose twin is there: as `scene_scale`, of the Gaussians' centres [N, 3]."""
    return scene_scale(cameras, SparsePoints(means.astype(np.float64), np.zeros(means.shape, np.uint8)))
