"""A sheet of rough glass fixed to the camera: what is farther behind it is blurred more.

    sigma(z) = f s (1 - z_d / z) k(o)      (none in front of the glass)

f: focal length in px, s: standard deviation in rad of the angle by which light is turned, along each axis, z_d: depth
of the glass. k(o) >= 1 says by how much more that is at an angle o off the axis. One point spread is the case z_d = 0:
everything is far behind the glass.

A glass that leans towards the camera is met at another depth on each ray (x, y, 1):

    z_d(x, y) = d / (1 + a x + b y)

where a and b are the tangents of the angles by which its normal (a, b, 1) leans towards the right and downwards, and d
is its depth on the axis. Light then meets the glass at another angle than the axis.

A glass that stands in the world is such a plane for each photo. Its distance and tilt are those before one of the
cameras; before another one, turned by R and moved by t against it (X_first = R X + t), the plane m X_first = 1 with
m = (a, b, 1) / d is v X = 1 with v = R^T m / (1 - m t), and 1 / z_d(x, y) = v (x, y, 1).
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Self, TypeVar

from ...numbers import NOT_CHECKED, number
from .by_depth import DepthBlur, occlusion
from .effect import Shot, off_axis, radius2

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray
    from torch import Tensor

#: Numbers of either kind.
Values = TypeVar("Values", "Tensor", "NDArray[np.float64]")


@dataclass(frozen=True)
class GlassSettings:
    """Numbers of a sheet of rough glass."""

    index: float = number(1.5, "refractive index", "of window glass", "definition", "rendered glass")
    grazing: float = number(
        0.05, "share of the distance on the axis", "over the depth of a tilted glass, at least: no ray runs along it"
    )
    off: float = number(
        0.1,
        "share of the distance",
        "by which one that was found is off whatever chance does, root mean square: a twin takes up a part of the blur,"
        " edges look wider than they are",
        "six sets behind Cycles' glass, distances shown by points or learned with the twin: 1 to 20 % off, where chance"
        " left 1 to 6 (docs/real_blur.md)",
        NOT_CHECKED,
    )
    off_tilt: float = number(
        15.0,
        "degrees",
        "by which an angle that was found is off whatever chance does, root mean square",
        "angles learned with the twin: 4 to 36 degrees off behind Cycles' glass, 1 to 4 behind the engine's own, where"
        " chance left 0.3 to 0.6",
        NOT_CHECKED,
    )


GLASS = GlassSettings()


@dataclass(frozen=True)
class Stand:
    """Where a camera stands against the first one: X_first = turn @ X + moved.

    Attributes:
        turn: [3, 3]; moved: [3], in the unit of the render's depth.
    """

    turn: NDArray[np.float64] = field(repr=False)
    moved: NDArray[np.float64] = field(repr=False)

    def scaled(self, factor: float) -> Stand:
        """The same in a world that is `factor` times as large."""
        return replace(self, moved=self.moved * factor)


@dataclass(frozen=True)
class GlassScene:
    """What the photos behind a glass have in common.

    Attributes:
        focal: length in diagonals of the photo; diagonal: of the photos, px.
        nearest, farthest: depths between which nearly all lies, in the unit of the render's depth.
        stands: of each photo, where a tilted glass stands in the world; None where it moves with the camera.
    """

    focal: float
    diagonal: float = 0.0
    nearest: float = math.inf
    farthest: float = math.inf
    stands: Mapping[str, Stand] | None = field(default=None, repr=False)

    def scaled(self, factor: float) -> GlassScene:
        """The same in a world that is `factor` times as large."""
        stands = None if self.stands is None else {name: stand.scaled(factor) for name, stand in self.stands.items()}
        return replace(self, nearest=self.nearest * factor, farthest=self.farthest * factor, stands=stands)


class FrostedGlass(DepthBlur):
    """One glass before all photos.

    Args:
        spread: [] f s, standard deviation far behind the glass, as a share of the photo's diagonal.
        distance: [] depth of the glass on the axis, in the unit of the render's depth.
        scene: before which it stands.
        clear: names of photos that were taken without it.
        errors: standard errors of both, 0 where they were given.
        learned: names of the parameters that a training learns.
        tilt: [2] a and b above; None for a glass that faces the camera and stays so.

    Attributes:
        tilt_errors: standard errors of a and b, 0 where they were given.
    """

    name = "glass"
    physics = "Rough glass turns light by small random angles: what is farther behind it is blurred more."
    shape = "gaussian"

    def __init__(
        self,
        spread: Tensor,
        distance: Tensor,
        scene: GlassScene,
        clear: frozenset[str] = frozenset(),
        errors: tuple[float, float] = (0.0, 0.0),
        learned: frozenset[str] = frozenset(),
        tilt: Tensor | None = None,
    ) -> None:
        super().__init__({"spread": spread, "distance": distance, **({} if tilt is None else {"tilt": tilt})})
        self.scene, self.clear, self.errors, self.learned = scene, clear, errors, learned
        self.tilt_errors = 0.0, 0.0

    @classmethod
    def of(
        cls,
        spread: float,
        distance: float,
        scene: GlassScene,
        clear: frozenset[str] = frozenset(),
        learned: frozenset[str] = frozenset(),
        tilt: tuple[float, float] | None = None,
    ) -> Self:
        """From numbers."""
        far, where = occlusion().scalars(spread, distance)
        lean = None if tilt is None else far.new_tensor(tilt)
        return cls(far, where, scene, clear, learned=learned, tilt=lean)

    @property
    def distance(self) -> float:
        """Depth of the glass."""
        return float(self.parameters["distance"].detach())

    @property
    def spread(self) -> float:
        """Standard deviation far behind it, as a share of the photo's diagonal."""
        return float(self.parameters["spread"].detach())

    @property
    def tilt(self) -> tuple[float, float]:
        """Tangents of the angles by which its normal leans towards the right and downwards."""
        if "tilt" not in self.parameters:
            return 0.0, 0.0
        right, down = (float(value) for value in self.parameters["tilt"].detach())
        return right, down

    @property
    def angle(self) -> float:
        """Standard deviation along each axis of the angle that light is turned by, rad."""
        return self.spread / self.scene.focal

    def sigma(self, depth: float, diagonal: float) -> float:
        """Standard deviation on the axis (px of a photo of this diagonal) of what lies at a depth."""
        return self.spread * diagonal * max(0.0, 1.0 - self.distance / depth)

    def row_of(self, name: str) -> int | None:
        """See `DepthBlur`: one for all photos behind it."""
        return None if name in self.clear else 0

    def widths(self, values: Sequence[Tensor], depth: Tensor, row: int, shot: Shot) -> Tensor:
        """See `DepthBlur`: negative, as all of it lies behind the glass."""
        spread, distance, *tilted = (value.to(depth) for value in values)
        tangent2 = radius2(shot, depth[None]) * (0.5 / self.scene.focal) ** 2
        if not tilted:
            behind = (1.0 - distance / depth.clamp(min=1e-6)).clamp(min=0.0)
            return -spread * shot.diagonal * oblique(tangent2) * behind
        y, x = (place / (self.scene.focal * shot.diagonal) for place in off_axis(shot, depth[None]))
        plane = self._plane(distance, tilted[0], shot.name)
        nearness = plane[0] * x[None, :] + plane[1] * y[:, None] + plane[2]  # 1 / depth of the glass on each ray
        met = nearness.clamp(min=GLASS.grazing * plane[2].detach().abs())
        behind = (1.0 - 1.0 / (met * depth.clamp(min=1e-6))).clamp(min=0.0)
        cosine = met / (plane.square().sum() * (1.0 + tangent2)).sqrt()
        return -spread * shot.diagonal * oblique(tangent2, cosine) * behind

    def _plane(self, distance: Tensor, tilt: Tensor, name: str) -> Tensor:
        """[3] v of the glass before a photo's camera: v X = 1."""
        plane = occlusion().plane_of(distance, tilt)
        stand = None if self.scene.stands is None else self.scene.stands.get(name)
        if stand is None:
            return plane
        turn, moved = plane.new_tensor(stand.turn), plane.new_tensor(stand.moved)
        return (turn.T @ plane) / (1.0 - moved @ plane)

    def reach(self, diagonal: float) -> float:
        """See `Effect`: that of what is far behind the glass."""
        return self.spread * diagonal

    def scaled(self, factor: float) -> Self:
        """The same in a world that is `factor` times as large."""
        values = {key: value.detach().clone() for key, value in self.parameters.items()}
        errors = self.errors[0], self.errors[1] * factor
        scene, distance = self.scene.scaled(factor), values["distance"] * factor
        found = type(self)(values["spread"], distance, scene, self.clear, errors, self.learned, values.get("tilt"))
        found.tilt_errors = self.tilt_errors
        return found

    def described(self) -> Mapping[str, object]:
        """Angle in degrees, depth of the glass in the cameras' unit, standard errors (0 where given), widths in px.

        Errors are those of chance, and what experience adds to them.
        """
        scene = self.scene
        shown = {
            "angle": math.degrees(self.angle),
            "angle_error": math.degrees(self.errors[0] / scene.focal),
            "distance": self.distance,
            "distance_error": _stated(self.errors[1], GLASS.off * self.distance),
            "width_nearest": self.sigma(scene.nearest, scene.diagonal),
            "width_farthest": self.sigma(scene.farthest, scene.diagonal),
        }
        if "tilt" in self.parameters:
            names = ("tilt_right", "tilt_down")
            shown |= {name: math.degrees(math.atan(lean)) for name, lean in zip(names, self.tilt, strict=True)}
            errors = (_stated(math.degrees(error), GLASS.off_tilt) for error in self.tilt_errors)
            shown |= {f"{name}_error": error for name, error in zip(names, errors, strict=True)}
        return {key: float(f"{value:.5g}") for key, value in shown.items()}


def _stated(error: float, beyond_chance: float) -> float:
    """A standard error, with what is off whatever chance does; 0 of what was given."""
    return math.hypot(error, beyond_chance) if error else 0.0


def oblique(tangent2: Values, incidence: Values | None = None) -> Values:
    """[...] by how much wider than on the axis a glass blurs in px, at tan^2 of an angle off it.

    Args:
        incidence: [...] cosine of the angle at which light meets the glass; None for a glass that faces the camera.

    Root mean square of both directions: along the radius light is turned (n cos i / cos o - 1) / (n - 1) times as much,
    across it (n cos i - cos o) / (n - 1) times (o outside the glass, i inside), and a pinhole sees these as another
    1 / cos^2 and 1 / cos of the angle off the axis. That a tilted glass turns light along its own tilt and not along
    the radius is left out: the mean over both directions is nearly the same.
    """
    n = GLASS.index
    cosine = (1.0 + tangent2) ** -0.5
    outside = cosine if incidence is None else incidence
    inside = n * (1.0 - (1.0 - outside**2) / n**2) ** 0.5
    along = (inside / outside - 1.0) / cosine**2
    across = (inside - outside) / cosine
    return ((along**2 + across**2) / 2.0) ** 0.5 / (n - 1.0)
