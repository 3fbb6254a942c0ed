"""A sheet of frosted glass that stands in the world: every camera looks through another part of it, at another angle.

It is placed against the mean camera: the mean of the centres, the mean of the axes and of what is down. Light does
there what `frosted_glass` says; the depth of the glass is another one for each camera and each ray,

    z_d(x, y) = (offset - normal . c) / (normal . R^T (x, y, 1))

with c: centre of the camera, R: world to camera, (x, y, 1): the ray in the camera's axes.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core.camera import Camera
from ....core.errors import DgsError
from ...axes import points_to_blender
from .frosted_glass import FORM, INDEX, SPARE, THICKNESS, values_of
from .medium import Medium, MediumSpec, Stage, Truth, Views

NAME = "standing-glass"
#: Cosine of the widest angle (78 degrees) at which a ray may meet the glass: beyond, it runs along it.
_GRAZING = 0.2
#: Paths whose cameras can stand on one side of a sheet.
_ONE_SIDED = "Give --path front, patch or rail, or less tilt"


@dataclass(frozen=True)
class Plane:
    """normal . x = offset, the engine's world.

    Attributes:
        origin: [3] where the mean camera's axis meets it.
        normal, along, down: [3] of length 1, at right angles; the normal points away from the cameras.
    """

    origin: NDArray[np.float64]
    normal: NDArray[np.float64]
    along: NDArray[np.float64]
    down: NDArray[np.float64]

    @property
    def offset(self) -> float:
        """Distance from the world's origin, along the normal."""
        return float(self.normal @ self.origin)


@dataclass(frozen=True)
class StandingGlass(Medium):
    """Rough glass, fixed to the world.

    Attributes:
        distance: depth at which the mean camera's axis meets the glass, in the scene's units.
        angle: standard deviation of the angle along each axis that light is turned by, degrees.
        tilt: degrees by which the right edge is turned away from the mean camera.
    """

    distance: float
    angle: float
    tilt: float
    every_photo = True

    def constants(self) -> Truth:
        """What the light meets; where it stands is said for each photo."""
        return {
            "distance": self.distance,
            "scattering_rad": float(np.radians(self.angle)),
            "tilt_rad": float(np.radians(self.tilt)),
            "plane": "normal . x = offset, in the engine's world; the same for all photos",
            "index_of_refraction": INDEX,
            "sigma": "sigma_px(z) = f scattering_rad (1 - z_d / z) where a ray meets the glass at a right angle (z_d: "
            "depth of the glass on that ray), larger elsewhere, as oblique() in "
            "dgs_addon/laboratory/media/frosted_glass.py says",
        }

    def plan(self, views: Views) -> list[Truth]:
        """The plane and the sheet's corners in the world, the same for all photos."""
        plane = self._plane(views.cameras)
        corners = _corners(plane, views.cameras)
        _check_between(plane, views, self.distance)
        truth = {"normal": plane.normal.tolist(), "offset": plane.offset, "corners": corners.tolist()}
        return [truth for _ in views.cameras]

    def standing(self, stage: Stage, plan: list[Truth]) -> AbstractContextManager[None]:
        """The sheet."""
        slope = float(np.radians(self.angle)) / (INDEX - 1)
        corners, away = (points_to_blender(plan[0][key]) for key in ("corners", "normal"))
        return stage.standing_sheet(corners, THICKNESS * self.distance * away, slope, INDEX)

    def _plane(self, cameras: Sequence[Camera]) -> Plane:
        """Where it stands before the mean camera."""
        middle = np.mean([camera.centre for camera in cameras], axis=0)
        axis = _direction(np.mean([camera.rotation[2] for camera in cameras], axis=0))
        down = np.mean([camera.rotation[1] for camera in cameras], axis=0)
        down = _direction(down - (down @ axis) * axis)
        right, tilt = np.cross(down, axis), np.radians(self.tilt)
        return Plane(
            middle + self.distance * axis,
            np.cos(tilt) * axis - np.sin(tilt) * right,
            np.cos(tilt) * right + np.sin(tilt) * axis,
            down,
        )


def _direction(vector: NDArray[np.float64]) -> NDArray[np.float64]:
    """[3] of length 1."""
    length = np.linalg.norm(vector)
    if length < _GRAZING:
        raise DgsError("The cameras look all around, and no sheet stands before them all", _ONE_SIDED)
    return np.asarray(vector / length)


def _check_between(plane: Plane, views: Views, distance: float) -> None:
    """Raises DgsError where a camera, or something it sees, is on the wrong side."""
    behind = [float(plane.normal @ (camera.centre - plane.origin)) for camera in views.cameras]
    before = [_nearest(plane, camera, depth) for camera, depth in zip(views.cameras, views.depths(), strict=True)]
    # Along the normal a way is shorter than along the mean camera's axis.
    lean = float(plane.normal @ _direction(np.mean([camera.rotation[2] for camera in views.cameras], axis=0)))
    least, most = distance + max(behind) / lean, distance + min(before) / lean
    if least >= most:
        raise DgsError(
            f"{views.cameras[int(np.argmax(behind))].name} stands beyond what "
            f"{views.cameras[int(np.argmin(before))].name} sees: no sheet fits between",
            _ONE_SIDED,
        )
    if not least < distance < most:
        where = int(np.argmax(behind)) if distance <= least else int(np.argmin(before))
        what = "before" if distance <= least else "behind what is nearest in"
        raise DgsError(
            f"The glass at {distance:g} stands {what} {views.cameras[where].name}",
            f"Give {NAME} a distance between {max(least, 0.0):.3g} and {most:.3g}",
        )


def _nearest(plane: Plane, camera: Camera, depth: NDArray[np.float32]) -> float:
    """Way along the normal from the plane to what a camera sees nearest to it; inf where it sees nothing."""
    small = camera.resized(depth.shape[1], depth.shape[0])
    rows, columns = np.nonzero(np.isfinite(depth))
    if not len(rows):
        return np.inf
    rays = np.stack([(columns + 0.5 - small.cx) / small.fx, (rows + 0.5 - small.cy) / small.fy, np.ones(len(rows))])
    ways = depth[rows, columns] * (plane.normal @ camera.rotation.T @ rays)
    return float(ways.min() + plane.normal @ (camera.centre - plane.origin))


def _corners(plane: Plane, cameras: Sequence[Camera]) -> NDArray[np.float64]:
    """[4, 3] in the engine's world, around what all frames see of the sheet, in order."""
    there = np.concatenate([_met(plane, camera) for camera in cameras]) - plane.origin
    across, down = there @ plane.along, there @ plane.down
    (left, right), (top, bottom) = (_widened(places) for places in (across, down))
    sides = ((left, top), (left, bottom), (right, bottom), (right, top))
    return np.array([plane.origin + a * plane.along + b * plane.down for a, b in sides])


def _widened(places: NDArray[np.float64]) -> tuple[float, float]:
    """The ends, moved apart to `SPARE` times their distance."""
    middle, half = (places.max() + places.min()) / 2, SPARE * (places.max() - places.min()) / 2
    return float(middle - half), float(middle + half)


def _met(plane: Plane, camera: Camera) -> NDArray[np.float64]:
    """[4, 3] where the rays of a frame's corners meet the plane."""
    sides = [(u - camera.cx) / camera.fx for u in (0.0, camera.width)]
    ends = [(v - camera.cy) / camera.fy for v in (0.0, camera.height)]
    rays = np.array([[x, y, 1.0] for x in sides for y in ends]) @ camera.rotation
    facing = rays @ plane.normal
    if (facing / np.linalg.norm(rays, axis=1)).min() < _GRAZING:
        raise DgsError(f"{camera.name} looks along the glass, or away from it", _ONE_SIDED)
    ways = plane.normal @ (plane.origin - camera.centre) / facing
    return np.asarray(camera.centre + ways[:, None] * rays)


def _parse(text: str) -> Medium:
    return StandingGlass(*values_of(NAME, text))


SPEC = MediumSpec(
    NAME,
    "Standing Glass",
    "A sheet of rough glass that stands in the scene: each camera looks through it from another place",
    FORM,
    "0.3,0.5",
    _parse,
)
