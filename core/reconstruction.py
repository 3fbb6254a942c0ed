"""The cameras of a set: poses, lenses, points, and how they were found."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np

from .camera import Camera
from .lens import Lens
from .pose import Pose
from .views import SparsePoints

#: The verdict on a model that many of its own pairs of photos speak against.
CONTRADICTED = "pairs of photos contradict the cameras"


@dataclass(frozen=True)
class Attempt:
    """One way that was tried to find the cameras.

    Attributes:
        name, reason: what was tried, and why.
        registered, points, focal_px, reprojection_px, angle_deg: what it gave.
        contradicted: share of the pairs of photos whose matches it does not explain.
        seconds: wall time.
        verdict: 'trusted', or what spoke against it.
    """

    name: str
    reason: str
    registered: int = 0
    points: int = 0
    focal_px: float = 0.0
    reprojection_px: float = 0.0
    angle_deg: float = 0.0
    contradicted: float = 0.0
    seconds: float = 0.0
    verdict: str = ""


@dataclass(frozen=True)
class Figures:
    """How the cameras were found.

    Attributes:
        source: 'sfm' or the name of the camera file.
        given, registered: photos handed in, photos with a camera.
        focal_px: mean focal length of the registered photos in px.
        reprojection_px: mean reprojection error, NaN without tracks.
        angle_deg: median over the points of the widest angle between two of their rays.
        seconds: wall time.
        attempts: everything that was tried, in order.
        offset: what was taken from all positions, where the world lay too far from its origin for float32.
        scattered: whether the points are random ones, because the cameras came without any.
        from_photos: whether structure from motion found them, this one or another; False where they may be exact.
        doubted: share of the pairs of photos that contradict the cameras, where they are doubted for it; else 0.
    """

    source: str
    given: int
    registered: int
    focal_px: float
    reprojection_px: float
    angle_deg: float
    seconds: float
    attempts: tuple[Attempt, ...] = ()
    offset: tuple[float, float, float] | None = None
    scattered: bool = False
    doubted: float = 0.0
    from_photos: bool = False


@dataclass(frozen=True)
class Reconstruction:
    """Cameras of a set of photos.

    Attributes:
        poses, lenses: by photo name; the same names in both.
        points: sparse points (may be empty).
        figures: how they were found.
    """

    poses: dict[str, Pose] = field(repr=False)
    lenses: dict[str, Lens] = field(repr=False)
    points: SparsePoints = field(repr=False)
    figures: Figures

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the photos with a camera, sorted."""
        return tuple(sorted(self.poses))

    def cameras(self) -> dict[str, Camera]:
        """Cameras with their lens's focal length, as if it did not distort."""
        return {
            name: Camera(
                name,
                lens.width,
                lens.height,
                lens.fx,
                lens.fy,
                lens.cx,
                lens.cy,
                self.poses[name].rotation,
                self.poses[name].translation,
            )
            for name, lens in self.lenses.items()
        }

    def digest(self) -> str:
        """SHA-256 of names, lenses, poses and points: the same for what was read from the same files."""
        found = hashlib.sha256()
        for name in self.names:
            lens, pose = self.lenses[name], self.poses[name]
            found.update(f"{name}\0{lens.model} {lens.width} {lens.height} {[float(p) for p in lens.params]}".encode())
            found.update(np.asarray(pose.rotation, "<f8").tobytes() + np.asarray(pose.translation, "<f8").tobytes())
        found.update(np.asarray(self.points.positions, "<f8").tobytes() + self.points.colours.tobytes())
        return found.hexdigest()


def no_points() -> SparsePoints:
    """Not a single point."""
    return SparsePoints(np.zeros((0, 3)), np.zeros((0, 3), np.uint8))
