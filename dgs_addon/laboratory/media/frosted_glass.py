"""A sheet of frosted glass before the camera: smooth on the camera's side, rough on the object's.

Behind it, a point at depth z on the axis is seen as a Gaussian of

    sigma_px(z) = f s (1 - z_d / z)

f: focal length in px, s: standard deviation in rad of the angle by which light is turned, along each axis, z_d: depth
of the glass there. The rough face consists of facets with Gaussian slopes (Beckmann), each of which refracts; facets
of a standard deviation of m along each axis turn light by s = (n - 1) m where it meets the glass at a right angle, and
by more where it does not (`oblique`): off the axis, and everywhere behind a tilted glass. The tests measure all of it.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ....core.camera import Camera
from ....core.errors import DgsError
from .medium import Medium, MediumSpec, Stage, Truth, Views, numbers

FORM = "DISTANCE,ANGLE[,TILT]"
#: Refractive index of window glass.
INDEX = 1.5
#: Thickness as a share of the distance: it moves no ray by a hundredth of a pixel.
THICKNESS = 0.0005
#: Side of the sheet against what the frame needs.
SPARE = 1.5
#: Smallest distance, in the scene's units: nearer things are cut away by the camera.
_NEAREST = 0.02
#: Largest angles in degrees: beyond, light is turned by more than slopes of facets explain.
_WIDEST, _STEEPEST = 15.0, 45.0


@dataclass(frozen=True)
class FrostedGlass(Medium):
    """Rough glass, fixed to the camera.

    Attributes:
        distance: depth at which the camera's axis meets the glass, in the scene's units.
        angle: standard deviation of the angle along each axis that light is turned by, degrees.
        tilt: degrees by which the right edge is turned away from the camera.
    """

    distance: float
    angle: float
    tilt: float
    every_photo = True

    def constants(self) -> Truth:
        """The glass in the camera's axes."""
        return {
            "distance": self.distance,
            "scattering_rad": float(np.radians(self.angle)),
            "tilt_rad": float(np.radians(self.tilt)),
            "normal": self._normal().tolist(),
            "offset": float(self._normal()[2] * self.distance),
            "plane": "normal . x = offset, in every camera's axes (x right, y down, z away)",
            "index_of_refraction": INDEX,
            "sigma": "sigma_px(z) = f scattering_rad (1 - z_d / z) on the axis (z_d: depth of the glass); off it and "
            "behind tilted glass larger, as oblique() in dgs_addon/laboratory/media/frosted_glass.py says",
        }

    def plan(self, views: Views) -> list[Truth]:
        """Corners of the sheet in each camera's axes."""
        nearest, where = np.inf, ""
        for camera, depth in zip(views.cameras, views.depths(), strict=True):
            way = self._way(camera, depth)
            if way < nearest:
                nearest, where = way, camera.name
        if nearest <= self.distance:
            raise DgsError(
                f"The glass at {self.distance:g} stands behind what is nearest in {where}",
                f"Give frosted-glass a distance below {0.98 * nearest:.3g}",
            )
        return [{"corners": self._corners(camera).tolist()} for camera in views.cameras]

    def photo(self, stage: Stage, camera: Camera, truth: Truth) -> AbstractContextManager[None]:
        """The sheet before the camera."""
        slope = float(np.radians(self.angle)) / (INDEX - 1)
        return stage.sheet(self._corners(camera), THICKNESS * self.distance, slope, INDEX)

    def _normal(self) -> NDArray[np.float64]:
        tilt = np.radians(self.tilt)
        return np.array([-np.sin(tilt), 0.0, np.cos(tilt)])

    def _way(self, camera: Camera, depth: NDArray[np.float32]) -> float:
        """The distance at which a glass of this tilt would touch what is seen."""
        small = camera.resized(depth.shape[1], depth.shape[0])
        rows, columns = np.nonzero(np.isfinite(depth))
        if not len(rows):
            return np.inf
        x = (columns + 0.5 - small.cx) / small.fx
        normal = self._normal()
        return float((depth[rows, columns] * (normal[0] * x + normal[2])).min() / normal[2])

    def _corners(self, camera: Camera) -> NDArray[np.float64]:
        """[4, 3] in the camera's axes, around the frame as it sees the sheet."""
        tilt, middle = np.radians(self.tilt), np.array([0.0, 0.0, self.distance])
        normal, along = self._normal(), np.array([np.cos(tilt), 0.0, np.sin(tilt)])
        sides = [(u - camera.cx) / camera.fx for u in (0.0, camera.width)]
        ends = [(v - camera.cy) / camera.fy for v in (0.0, camera.height)]
        rays = np.array([[x, y, 1.0] for x in sides for y in ends])
        facing = rays @ normal
        if facing.min() < 0.1:
            raise DgsError(f"A glass tilted by {self.tilt:g} degrees does not cover the photo", "Give less tilt")
        there = rays * (normal @ middle / facing)[:, None] - middle
        wide, high = SPARE * np.abs(there @ along).max(), SPARE * np.abs(there[:, 1]).max()
        down = np.array([0.0, 1.0, 0.0])
        return np.array([middle + a * wide * along + b * high * down for a, b in ((-1, -1), (-1, 1), (1, 1), (1, -1))])


def oblique(cosine: float) -> tuple[float, float]:
    """By how much more light is turned, in the plane of incidence and across it, than at a right angle.

    A facet turned by m in the plane of incidence turns light by (n cos i / cos o - 1) m, one turned across it by
    (n cos i - cos o) m; o: angle outside the glass, i: inside (Snell's law, to first order in m). A pinhole camera
    with untilted glass sees, at an angle o off its axis, the first as another 1 / cos^2 o and the second as another
    1 / cos o in px.

    Args:
        cosine: of the angle between the light outside and the glass's normal.
    """
    inside = np.sqrt(1 - (1 - cosine**2) / INDEX**2)
    return (INDEX * inside / cosine - 1) / (INDEX - 1), (INDEX * inside - cosine) / (INDEX - 1)


def values_of(name: str, text: str) -> tuple[float, float, float]:
    """Distance, angle and tilt (degrees) of 'DISTANCE,ANGLE[,TILT]'.

    Raises:
        DgsError: they make no sense; it says what to write after `name`.
    """
    values = numbers(name, FORM, text, 2, 3)
    distance, angle, tilt = (*values, 0.0)[:3]
    if distance < _NEAREST:
        raise DgsError(f"A glass at {distance:g} is not before the camera", f"Give a distance of at least {_NEAREST}")
    if not 0 < angle <= _WIDEST:
        raise DgsError(
            f"Frosted glass cannot scatter by {angle:g} degrees", f"Give an angle above 0, up to {_WIDEST:g}"
        )
    if abs(tilt) > _STEEPEST:
        raise DgsError(f"A tilt of {tilt:g} degrees is too much", f"Give at most {_STEEPEST:g} either way")
    return distance, angle, tilt


def _parse(text: str) -> Medium:
    return FrostedGlass(*values_of("frosted-glass", text))


SPEC = MediumSpec(
    "frosted-glass",
    "Frosted Glass",
    "A sheet of rough glass before the camera: what is farther behind it is blurred more",
    FORM,
    "0.3,0.5",
    _parse,
)
