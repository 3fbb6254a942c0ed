"""A hand that shakes: in each exposure the camera runs along a curved path of its own, turning and moving.

The path is a sum of Legendre polynomials of the time, for three angles and three translations of the same size in
every direction; at the object, turning and moving blur alike. Each has the mean zero, so that the camera of the sharp
picture is the path's mean. It is not the exponential of a low-order polynomial, which an estimator might assume.
Cycles goes straight and at even speed between `NODES` poses of it.

With a rolling shutter every row is exposed for the same time, one after the other from the top. The path then covers
all of it, from the opening of the first row to the closing of the last one.
"""

from __future__ import annotations

from contextlib import AbstractContextManager
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre
from numpy.typing import NDArray

from ....core.camera import Camera
from ....core.errors import DgsError
from .medium import Medium, MediumSpec, Stage, Truth, Views, generator, numbers, span

FORM = "PX[,CURVE[,READOUT]]"
#: Poses of a path; Cycles takes 2^n + 1.
NODES = 17
#: Bends of the second, third and fourth order, as shares of CURVE.
_BENDS = (1.0, 0.6, 0.35)
#: Least length of a path against those of its turns and its moves alone: else they cancel at the object, and what is
#: nearer or farther is blurred without bounds.
_LEAST = 0.7
#: How exactly a path is as long as wanted, as a share.
_EXACT = 0.01
#: Exposures from the first row to the last one at most; beyond, a row's own blur is lost between the path's nodes.
_LONGEST_READOUT = 10.0
#: Passes that scale a path to its length: it is nearly linear.
_PASSES = 5


@dataclass(frozen=True)
class Shake(Medium):
    """Camera shake.

    Attributes:
        shortest, longest: px that the object's middle travels over the frame while the photo is taken.
        curve: size of the bends against the straight part; 0 is straight at even speed.
        readout: time from the first row's exposure to the last row's, in exposures; 0 for all rows at once.
    """

    shortest: float
    longest: float
    curve: float
    readout: float = 0.0
    every_photo = False

    @property
    def by_rows(self) -> bool:
        """Rows are exposed one after the other."""
        return self.readout > 0

    def constants(self) -> Truth:
        """Conventions of the paths, and of the shutter where it rolls."""
        rolling: Truth = {}
        if self.readout:
            rolling = {
                "readout": self.readout,
                "rows": "times then cover the whole photo: the row whose middle is at the share v of the height, from "
                "the top, is exposed from -0.5 + v readout / (1 + readout) on, for 1 / (1 + readout)",
            }
        return {
            "path_px": [self.shortest, self.longest],
            "curve": self.curve,
            "times": np.linspace(-0.5, 0.5, NODES).tolist(),
            "poses": "for each photo, [times, 3, 4] world to camera (R|t), x right, y down, z away; in shares of the "
            "exposure; straight and at even speed between them; cameras/ has the path's mean",
            **rolling,
        }

    def plan(self, views: Views) -> list[Truth]:
        """A path for each photo.

        Raises:
            DgsError: the camera would have to turn away from the object.
        """
        plans = []
        for index, camera in enumerate(views.cameras):
            random = generator(views.seed, "shake", index)
            wanted = random.uniform(self.shortest, self.longest)
            point = _subject(views, index)
            poses = self._path(camera, point, wanted, random)
            length = _length(_seen(camera, poses, point))
            if not abs(length - wanted) < _EXACT * wanted:
                raise DgsError(f"A path of {wanted:.0f} px does not fit {camera.name}", "Give shake fewer px")
            plans.append({"path_px": length, "poses": poses.tolist()})
        return plans

    def standing(self, stage: Stage, plan: list[Truth]) -> AbstractContextManager[None]:
        """The shutter stays open while the camera moves."""
        return stage.open_shutter(self.readout)

    def photo(self, stage: Stage, camera: Camera, truth: Truth) -> AbstractContextManager[None]:
        """The camera runs along the photo's path."""
        return stage.camera_path(camera, np.array(truth["poses"]))

    def _path(
        self, camera: Camera, target: NDArray[np.float64], wanted: float, random: np.random.Generator
    ) -> NDArray[np.float64]:
        """[NODES, 3, 4]: poses along which `target` travels `wanted` px."""

        def length(turn: NDArray[np.float64], move: NDArray[np.float64]) -> float:
            return _length(_seen(camera, _moved(camera, turn, move), target))

        turn, move = self._twists(camera, target, random)
        while length(turn, move) < _LEAST * np.hypot(length(turn, 0 * move), length(0 * turn, move)):
            turn, move = self._twists(camera, target, random)
        for _ in range(_PASSES):
            share = wanted / length(turn, move)
            turn, move = share * turn, share * move
        return _moved(camera, turn, move)

    def _twists(
        self, camera: Camera, target: NDArray[np.float64], random: np.random.Generator
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """[NODES, 3] rotation vectors and [NODES, 3] translations, of about a pixel each across the axis."""
        sizes = np.array([0.0, 1.0, *(self.curve * bend for bend in _BENDS)])
        directions = random.normal(size=(len(sizes), 6)) * sizes[:, None]
        motion = legendre.legval(np.linspace(-1.0, 1.0, NODES), directions).T  # mean 0
        depth = float(camera.rotation[2] @ target + camera.translation[2])
        return motion[:, :3] / camera.fx, motion[:, 3:] * depth / camera.fx


def _subject(views: Views, index: int) -> NDArray[np.float64]:
    """[3]: the object's middle, or what stands in the middle of a photo that does not show it."""
    camera = views.cameras[index]
    (place,) = _seen(camera, np.column_stack([camera.rotation, camera.translation])[None], views.target)
    depth = camera.rotation[2] @ views.target + camera.translation[2]
    if depth > 0 and (place >= 0).all() and (place <= [camera.width, camera.height]).all():
        return views.target
    seen = views.depths()[index]
    middle = float(np.median(seen[np.isfinite(seen)])) if np.isfinite(seen).any() else 1.0
    return np.asarray(camera.centre + middle * camera.rotation[2])


def _moved(camera: Camera, turn: NDArray[np.float64], move: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N, 3, 4] poses of `camera` turned by [N, 3] rotation vectors and moved by [N, 3], in its own axes."""
    step = _rotations(turn)
    translation = step @ camera.translation + move
    return np.concatenate([step @ camera.rotation, translation[..., None]], axis=-1)


def _rotations(turn: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N, 3, 3] of [N, 3] rotation vectors (Rodrigues)."""
    x, y, z = turn.T
    zero = np.zeros_like(x)
    cross = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1).reshape(-1, 3, 3)
    angle = np.linalg.norm(turn, axis=-1)[:, None, None]
    # np.sinc(a / pi) = sin(a) / a, smooth at zero.
    return np.asarray(
        np.eye(3) + np.sinc(angle / np.pi) * cross + 0.5 * np.sinc(angle / (2 * np.pi)) ** 2 * cross @ cross
    )


def _seen(camera: Camera, poses: NDArray[np.float64], point: NDArray[np.float64]) -> NDArray[np.float64]:
    """[N, 2] px at which the poses see a point of the world."""
    x, y, z = (poses[:, :, :3] @ point + poses[:, :, 3]).T
    return np.stack([camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy], axis=-1)


def _length(places: NDArray[np.float64]) -> float:
    return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())


def _parse(text: str) -> Medium:
    length, comma, rest = text.partition(",")
    shortest, longest = span("shake", FORM, length)
    bend, readout = [*(numbers("shake", FORM, rest, 1, 2) if comma else [0.5]), 0.0][:2]
    if shortest < 0 or longest == 0:
        raise DgsError("A path is longer than 0 px", "Give shake a length such as 8, or a range such as 4..16")
    if not 0 <= bend <= 10:
        raise DgsError(f"A path's bends are at least 0 and at most 10, not {bend:g}", "Give shake:8,0.5")
    if not 0 <= readout <= _LONGEST_READOUT:
        raise DgsError(
            f"A readout takes 0 to {_LONGEST_READOUT:g} exposures, not {readout:g}",
            "Give shake:8,0.5,1, or leave it out for all rows at once",
        )
    return Shake(shortest, longest, bend, readout)


SPEC = MediumSpec(
    "shake",
    "Camera Shake",
    "Each photo is blurred along a path of its own that the camera takes during the exposure",
    FORM,
    "4..12",
    _parse,
)
