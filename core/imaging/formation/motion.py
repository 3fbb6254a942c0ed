"""The camera's own path during each exposure.

A camera that moves while its shutter is open collects what it sees on its way, in linear light:

    photo = integral over t in [-1/2, 1/2] of view(exp(xi(t)) o pose) dt,    xi(t) = sum over m of P_m(2 t) c_m

with Legendre's polynomials P_m and twists c_m in the camera's own axes. They are orthogonal over the exposure, so that
c_0 alone says where the camera was on average; c_1 is half of the straight way, the others bend it.

A rolling shutter exposes the sensor's rows, which lie along a photo's longer side, one after the other, the last one
`readout` exposures after the first. Then t is the time of the whole photo, 1 + |readout| exposures long, and each row
is the mean over its own window of it (`row_windows`): c_0 is the mean over the whole time, and at t = 0 the middle row
is half exposed. Photos do not say whether rows are read from one end or from the other: what the camera did backwards
makes the same photo.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import ModuleType
from typing import TYPE_CHECKING, cast

from ...numbers import BY_DEFINITION, number
from ...tone_curve import ToneCurve
from .effect import Effect, Shot

if TYPE_CHECKING:
    from torch import Tensor

    from ...camera import Camera
    from ...pose import Pose


@dataclass(frozen=True)
class MotionSettings:
    """How finely an exposure is cut into frames."""

    still: float = number(
        0.7, "px of the grid", "a path that is shorter is one frame: it blurs less than a px does", BY_DEFINITION
    )
    fewest: int = number(3, "frames", "of a path, however short: fewer have no bend")
    bent: int = number(
        5, "frames", "that a path has before they lie more than a px apart: as many as a path of degree 4 has shapes"
    )
    spacing: float = number(
        1.5,
        "px of the grid",
        "between the frames of a longer path: what that adds lies beyond what a grid's px can show",
        "plant (Cycles) shaken by 4 to 20 px, true cameras, 1500 steps: 35.27 dB in 146 s, with 1 px 35.30 in 197;"
        " shelf by 2 to 6 px, with `bent` of 3: 32.42 and 126, with 1 px 32.46 and 148, with 2 px 32.39 and 115;"
        " nothing else checks it",
    )
    most: int = number(
        9, "frames", "of a path, however long: frames that lie 2 px apart leave ripples that splats cannot follow"
    )


SETTINGS = MotionSettings()


def _mathematics() -> ModuleType:
    from . import path_poses  # heavy: torch

    return path_poses


class CameraMotion(Effect):
    """Paths of V photos; photos that are not named stood still.

    `twists` [V, M + 1, 6]: coefficients c_m, translation (unit of the world that is drawn) and rotation (radians); the
    scene is `unit` of the world's units away. `readout`: exposures from the first row to the last one, of all photos;
    below 0 the last row is read first; 0 for all rows at once. `readout_given`: it is not to be learned.
    """

    name = "motion"
    physics = "A camera that moves while its shutter is open smears each photo along the path that it took."
    place = "camera"

    def __init__(
        self, names: Sequence[str], twists: Tensor, unit: float = 1.0, readout: float = 0.0, readout_given: bool = False
    ) -> None:
        super().__init__({"twists": twists})
        self.names, self.unit, self.readout, self.readout_given = tuple(names), unit, readout, readout_given
        self.readout_error: float | None = None  # standard error of one that was learned
        self.curve = ToneCurve()  # the camera's own, by which it files the light that it collected
        self.curve_error: tuple[float, float] | None = None  # standard errors of its toe and shoulder, if learned
        self._index = {name: i for i, name in enumerate(self.names)}

    @property
    def order(self) -> int:
        """Degree of the paths."""
        return int(self.parameters["twists"].shape[1]) - 1

    @property
    def exposures(self) -> float:
        """How many exposures a photo takes, from the opening of its first row to the closing of its last one."""
        return 1.0 + abs(self.readout)

    def row_weights(self, count: int, height: int, width: int, margin: int = 0) -> Tensor | None:
        """Shares that frames have of the light of each row of the sensor; None where all rows see all alike.

        [count, height + 2 margin, 1]; of a photo that was turned upright [count, 1, width + 2 margin].
        """
        if self.readout == 0.0 or count < 2:
            return None
        return cast("Tensor", _mathematics().shares_of_rows(count, height, width, self.readout, margin))

    def poses(self, name: str, camera: Camera, times: Tensor | None = None) -> Tensor | None:
        """[T, 3, 4] world to camera at times [T] of the exposure; None for a photo that stood still.

        Args:
            camera: of the photo, on the grid that is drawn; times: None for as many as the path has px there.
        """
        index = self._index.get(name)
        if index is None:
            return None
        twists = self.parameters["twists"][index]
        found = _mathematics()
        times = found.middles(self.frames(name, camera)) if times is None else times
        return cast("Tensor", found.poses_on(twists, camera, times))

    def frames(self, name: str, camera: Camera) -> int:
        """How many frames a photo is the mean of, on the grid of `camera`."""
        return self._count(name, camera.fx)

    def _count(self, name: str, focal: float) -> int:
        px = self.length(name, focal)
        # An exposure of each row is a part of the frames only, where the shutter rolls.
        most = round(SETTINGS.most * self.exposures)
        if px < SETTINGS.still:
            return 1
        short = min(math.ceil(px) + 1, SETTINGS.bent)
        return min(max(SETTINGS.fewest, short, math.ceil(px / SETTINGS.spacing) + 1), most)

    def length(self, name: str, focal: float) -> float:
        """About how many px a path crosses in the middle of the photo, at the scene's distance.

        Args:
            focal: focal length, px.
        """
        way = self.way(name, focal)
        return 0.0 if way is None else float((way[1:] - way[:-1]).norm(dim=1).sum())

    def way(self, name: str, focal: float, count: int = 17) -> Tensor | None:
        """[count, 2] where the path leads what is in the middle of the photo, px along x and y; arguments as `length`.

        None for a photo that stood still.
        """
        index = self._index.get(name)
        if index is None:
            return None
        twists = self.parameters["twists"][index].detach()
        return cast("Tensor", _mathematics().way_on(twists, self.unit, focal, count))

    def twists_of(self, name: str) -> Tensor | None:
        """[M + 1, 6] the coefficients of a photo's path, without gradient; None for one that stood still."""
        index = self._index.get(name)
        return None if index is None else self.parameters["twists"][index].detach()

    def mean_pose(self, name: str, pose: Pose, focal: float) -> Pose:
        """Where the camera was on average over the frames of a photo; the very same for one that stood still.

        Of few frames that is not where c_0 says: a photo of one frame is seen from the middle of its path, which may be
        bent by a part of a px. Not differentiable.

        Args:
            pose: that the path begins at, in the world of the twists; focal: focal length, px of the grid.
        """
        index = self._index.get(name)
        if index is None:
            return pose
        twist = self.parameters["twists"][index].detach()
        return cast("Pose", _mathematics().mean_pose(twist, pose, self._count(name, focal)))

    def from_means(self, focals: Mapping[str, float]) -> CameraMotion:
        """The same paths, counted from where each camera was on average (`mean_pose`); to first order.

        Args:
            focals: px of the grid, by name of each photo that has a path.
        """
        twists = self.parameters["twists"].detach().clone()
        for name, i in self._index.items():
            twists[i, 0] -= _mathematics().mean_twist(twists[i], self._count(name, focals[name])).to(twists)
        return self._with(self.names, twists, self.unit)

    def offset(self, name: str, focal: float) -> float | None:
        """How far from where the path begins the camera was on average, px in the photo's middle; None if it stood."""
        index = self._index.get(name)
        if index is None:
            return None
        twists = self.parameters["twists"][index, :1].detach()
        return float(_mathematics().way_on(twists, self.unit, focal, 1).norm())

    def scaled(self, factor: float) -> CameraMotion:
        """The same paths in a world that is `factor` times as large."""
        twists = self.parameters["twists"].detach().clone()
        twists[..., :3] *= factor
        return self._with(self.names, twists, self.unit * factor)

    def rolling(self, readout: float) -> CameraMotion:
        """The same with another readout: at the speeds that paths have, they are as much longer as the photo takes."""
        other = self._with(self.names, self.parameters["twists"].detach().clone(), self.unit)
        other.roll(readout)
        return other

    def roll(self, readout: float) -> None:
        """The same in place."""
        before = self.exposures
        self.readout = readout
        self.parameters["twists"][:, 1:] *= self.exposures / before

    def for_photos(self, names: Iterable[str]) -> CameraMotion:
        """Of these photos only."""
        wanted = set(names)
        kept = [i for i, name in enumerate(self.names) if name in wanted]
        twists = self.parameters["twists"].detach()[kept].clone()
        return self._with([self.names[i] for i in kept], twists, self.unit)

    def _with(self, names: Sequence[str], twists: Tensor, unit: float) -> CameraMotion:
        other = CameraMotion(names, twists, unit, self.readout, self.readout_given)
        other.readout_error, other.curve, other.curve_error = self.readout_error, self.curve, self.curve_error
        return other

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """The very same light: the path is in the frames."""
        return light

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """The very same gradient; how paths are learned is in `core.training.paths.camera_paths`."""
        return upstream

    def described(self) -> Mapping[str, object]:
        """The unit, by photo the twists, [M + 1][6], a shutter's readout, the camera's own curve; errors if learned."""
        twists = self.parameters["twists"].detach().cpu().double().numpy()
        rows = zip(self.names, twists, strict=True)
        return {
            "unit": float(f"{self.unit:.6g}"),
            "twists": {name: [[float(f"{v:.5g}") for v in part] for part in row] for name, row in rows},
            **({"readout": float(f"{self.readout:.5g}")} if self.readout else {}),
            **({"readout_error": float(f"{self.readout_error:.3g}")} if self.readout and self.readout_error else {}),
            **self._described_curve(),
        }

    def _described_curve(self) -> dict[str, list[float]]:
        """Toe and shoulder, and their errors; nothing of sRGB's own."""
        if not self.curve:
            return {}
        found = {"curve": [float(f"{value:.4g}") for value in (self.curve.toe, self.curve.shoulder)]}
        return found | ({"curve_error": [float(f"{e:.3g}") for e in self.curve_error]} if self.curve_error else {})


def straight_paths(ways: Mapping[str, tuple[float, float]], order: int) -> CameraMotion:
    """Paths that begin as turns of the camera.

    Args:
        ways: by photo, how far its middle moves along x and y, in focal lengths.
    """
    return CameraMotion(list(ways), _mathematics().straight(list(ways.values()), order))


def motion_of(effects: Iterable[Effect]) -> CameraMotion | None:
    """The camera's motion among a chain's effects."""
    return next((effect for effect in effects if isinstance(effect, CameraMotion)), None)
