"""Small models and databases of pycolmap whose every number is known."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pycolmap

#: Photos of `model_of` and their lens: px, and focal length in px.
WIDTH, HEIGHT, FOCAL = 200, 160, 100.0


def lens(focal: float = FOCAL, bend: float = 0.0) -> Any:
    """Without a number yet."""
    params = [focal, WIDTH / 2, HEIGHT / 2, bend]
    return pycolmap.Camera(model="SIMPLE_RADIAL", width=WIDTH, height=HEIGHT, params=params)


def rigid(centre: Sequence[float], rotation: np.ndarray | None = None) -> Any:
    """World to camera; looks along z unless turned."""
    turn = np.eye(3) if rotation is None else rotation
    return pycolmap.Rigid3d(pycolmap.Rotation3d(turn), -turn @ np.asarray(centre, float))


def pixels_of(centre: Sequence[float], points: np.ndarray, focal: float = FOCAL) -> np.ndarray:
    """[N, 2] where a camera that looks along z shows points [N, 3]."""
    local = np.asarray(points, float) - np.asarray(centre, float)
    return focal * local[:, :2] / local[:, 2:] + [WIDTH / 2, HEIGHT / 2]


def model_of(
    centres: Sequence[Sequence[float]],
    points: np.ndarray,
    off: float = 0.0,
    focal: float = FOCAL,
    seen_by: Sequence[Sequence[int]] | None = None,
) -> Any:
    """Cameras that look along z, numbered from 1, each seeing every point.

    Args:
        off: px that all of them see the points too far to the right.
        seen_by: images of each point, in the order of its track; all of them if None.
    """
    model = pycolmap.Reconstruction()
    camera = lens(focal)
    camera.camera_id = 1
    model.add_camera_with_trivial_rig(camera)
    for number, centre in enumerate(centres, start=1):
        image = pycolmap.Image(
            name=f"0/{number:04d}.png",
            keypoints=pixels_of(centre, points, focal) + [off, 0.0],
            camera_id=1,
            image_id=number,
        )
        model.add_image_with_trivial_frame(image, rigid(centre))
    for index, point in enumerate(np.asarray(points, float)):
        those = range(1, len(centres) + 1) if seen_by is None else seen_by[index]
        elements = [pycolmap.TrackElement(i, index) for i in those]
        model.add_point3D(point, pycolmap.Track(elements=elements), np.full(3, index % 200, np.uint8))
    return model


def grid_points(count: int, depth: float = 4.0) -> np.ndarray:
    """[count, 3] at one depth, 0.1 apart, about the axis."""
    side = int(np.ceil(np.sqrt(count)))
    at = (np.arange(side) - (side - 1) / 2) * 0.1
    x, y = np.meshgrid(at, at)
    return np.stack([x.ravel(), y.ravel(), np.full(side * side, depth)], axis=1)[:count]


def database_of(
    path: Path,
    features: Mapping[str, tuple[np.ndarray, np.ndarray]],
    pairs: Mapping[tuple[str, str], Any] | None = None,
    size: tuple[int, int] = (WIDTH, HEIGHT),
) -> dict[str, int]:
    """A database of images with keypoints [N, 2 or 6] and descriptors [N, 128]; numbers by name.

    Args:
        pairs: geometries between images.
    """
    numbers: dict[str, int] = {}
    with pycolmap.Database.open(path) as store:
        for name, (points, descriptors) in features.items():
            camera = pycolmap.Camera(
                model="SIMPLE_PINHOLE", width=size[0], height=size[1], params=[FOCAL, size[0] / 2, size[1] / 2]
            )
            number = store.write_camera(camera)
            numbers[name] = store.write_image(pycolmap.Image(name=name, camera_id=number))
            store.write_keypoints(numbers[name], points.astype(np.float32))
            data = pycolmap.FeatureDescriptors(pycolmap.FeatureExtractorType.SIFT, descriptors.astype(np.uint8))
            store.write_descriptors(numbers[name], data)
        for (first, second), geometry in (pairs or {}).items():
            store.write_two_view_geometry(numbers[first], numbers[second], geometry)
    return numbers


def geometry_of(matches: Sequence[tuple[int, int]], kind: str = "CALIBRATED", homography: Any = None) -> Any:
    """A verified pair."""
    geometry = pycolmap.TwoViewGeometry()
    geometry.config = getattr(pycolmap.TwoViewGeometryConfiguration, kind)
    geometry.inlier_matches = np.array(matches, np.uint32).reshape(-1, 2)
    if homography is not None:
        geometry.H = np.asarray(homography, float)
    return geometry


def tracked_model(folder: Path, errors: Sequence[float], binary: bool) -> None:
    """Writes four cameras and points of which the first was seen by two, the others by all, with these errors (px)."""
    points = np.array([[0.1 * k, -0.1 * k, 3.0] for k in range(len(errors))])
    seen_by = [(1, 2), *[(1, 2, 3, 4)] * (len(errors) - 1)]
    model = model_of([(0.1 * k, 0.0, 0.0) for k in range(4)], points, seen_by=seen_by)
    for number, error in zip(sorted(model.points3D), errors, strict=True):
        model.points3D[number].error = error
    folder.mkdir(exist_ok=True)
    (model.write_binary if binary else model.write_text)(str(folder))
