"""Features triangulated where the cameras are known: true points, and whether the cameras fit the photos.

Descriptors are matched between the pairs that the parent chose; what lies off the epipolar lines of the known cameras
is no match (and counts against the cameras); COLMAP's triangulator makes points of the rest. In the child process only.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..colmap_library import pycolmap
from ..numbers import number
from . import mapping
from .attempts import DATABASE, SfmResult, widest_angle
from .features import Features, matched, read_features
from .job import KNOWN, POINTS, SfmJob
from .provenance import FIRST_TRIED, LOOKED_AT
from .settings import recipes

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class KnownPoseSettings:
    """Of features at known poses."""

    features: int = number(
        1500,
        "count",
        "per photo, the largest: true points for ranges and checks, not a dense surface",
        FIRST_TRIED,
        LOOKED_AT,
    )
    image_size: int = number(
        800,
        "px",
        "longest side that features are looked for on: more finds more and takes longer",
        FIRST_TRIED,
        LOOKED_AT,
    )
    epipolar: float = number(
        2.0,
        "px",
        "that a match may lie off the epipolar lines: features are found to half a px or two",
        FIRST_TRIED,
        LOOKED_AT,
    )
    chance_share: float = number(
        0.5,
        "share",
        "of a pair's matches on their lines by which cameras are judged: pairs with fewer matches say nothing",
        FIRST_TRIED,
        LOOKED_AT,
    )
    angle: float = number(
        1.5, "degrees", "between the rays of a point at least: less shows no depth", "COLMAP's default"
    )


SETTINGS = KnownPoseSettings()


def run(job: SfmJob, say: Callable[..., None]) -> SfmResult:
    """Writes `POINTS` into the job's folder; 'done' with how well the cameras fit."""
    pycolmap.logging.minloglevel = 3
    pycolmap.logging.logtostderr = True
    known = json.loads((job.folder / KNOWN).read_text("utf-8"))
    recipe = recipes(job.kernel is not None)[0]
    recipe = replace(recipe, max_features=SETTINGS.features, image_size=SETTINGS.image_size)
    images, database = job.folder / "images", job.folder / DATABASE
    greys = mapping.filtered_greys(job, recipe.noise_to_signal)
    mapping.write_images(greys, images, job.settings.threads)
    separate = replace(job, settings=replace(job.settings, one_lens=False))
    mapping.extract(separate, recipe, database, images)
    say(joined=len(job.images) // 2)
    found = read_features(database, SETTINGS.features)
    lenses = {name: pycolmap.Camera(**row["lens"]) for name, row in known["cameras"].items()}
    pairs = _matches(job, known, found, lenses)
    say(joined=len(job.images))
    good = {pair: those[off < SETTINGS.epipolar] for pair, (those, off) in pairs.items()}
    model = _triangulated(job, known, found, lenses, good)
    if model.num_points3D():
        model.extract_colors_for_all_images(str(images))
    _write_points(job.folder / POINTS, model)
    every = np.concatenate([off for _, off in pairs.values()] or [np.zeros(0)])
    return SfmResult(
        "done",
        {
            "matches": len(every),
            "on_lines": float((every < SETTINGS.epipolar).mean()) if len(every) else 0.0,
            "points": model.num_points3D(),
            "reprojection_px": float(model.compute_mean_reprojection_error()) if model.num_points3D() else 0.0,
            "angle_deg": widest_angle(model),
        },
    )


def _matches(
    job: SfmJob, known: dict[str, Any], found: dict[str, Features], lenses: dict[str, Any]
) -> dict[tuple[str, str], tuple[NDArray[np.int64], Floats]]:
    """Of each pair: [M, 2] matches by their descriptors alone, and [M] px that they are off the epipolar lines."""
    rays = {}
    for name, features in found.items():
        at = features.positions.astype(float)
        flat = np.asarray(lenses[name].cam_from_img(at), float).reshape(-1, 2) if len(at) else np.zeros((0, 2))
        rays[name] = np.concatenate([flat, np.ones((len(flat), 1))], axis=1)

    def one(pair: list[str]) -> tuple[NDArray[np.int64], Floats]:
        first, second = pair
        those = matched(found[first], found[second])
        essential = _essential(known["cameras"][first], known["cameras"][second])
        focal = 0.5 * (lenses[first].mean_focal_length() + lenses[second].mean_focal_length())
        return those, focal * _off_lines(essential, rays[first][those[:, 0]], rays[second][those[:, 1]])

    with ThreadPoolExecutor(job.settings.threads) as pool:
        return dict(zip(map(tuple, known["pairs"]), pool.map(one, known["pairs"]), strict=True))


def _essential(first: dict[str, Any], second: dict[str, Any]) -> Floats:
    """E with second' E first = 0 for rays (x, y, 1) of the same point."""
    turn = np.array(second["rotation"], float) @ np.array(first["rotation"], float).T
    x, y, z = np.array(second["translation"], float) - turn @ np.array(first["translation"], float)
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn


def _off_lines(essential: Floats, first: Floats, second: Floats) -> Floats:
    """[M] Sampson's distance of rays [M, 3] from each other's epipolar lines, in units of the focal length."""
    lines, back = first @ essential.T, second @ essential
    slope = (lines[:, :2] ** 2).sum(1) + (back[:, :2] ** 2).sum(1)
    return np.asarray(np.abs((second * lines).sum(1)) / np.sqrt(np.maximum(slope, 1e-300)))


def _triangulated(
    job: SfmJob,
    known: dict[str, Any],
    found: dict[str, Features],
    lenses: dict[str, Any],
    good: dict[tuple[str, str], NDArray[np.int64]],
) -> Any:
    """A model of the known cameras with the points that the matches give."""
    path = job.folder / "known.db"
    model = pycolmap.Reconstruction()
    with pycolmap.Database.open(path) as store:
        numbers = {}
        for index, name in enumerate(sorted(known["cameras"]), start=1):
            row, lens = known["cameras"][name], lenses[name]
            lens.camera_id = store.write_camera(lens)
            numbers[name] = store.write_image(pycolmap.Image(name=name, camera_id=lens.camera_id, image_id=index))
            points = found[name].positions.astype(np.float32) if name in found else np.zeros((0, 2), np.float32)
            store.write_keypoints(numbers[name], points)
            model.add_camera_with_trivial_rig(lens)
            image = pycolmap.Image(
                name=name, keypoints=points.astype(float), camera_id=lens.camera_id, image_id=numbers[name]
            )
            rotation = pycolmap.Rotation3d(np.array(row["rotation"], float))
            model.add_image_with_trivial_frame(image, pycolmap.Rigid3d(rotation, np.array(row["translation"], float)))
        for (first, second), those in good.items():
            if len(those) == 0:
                continue
            store.write_matches(numbers[first], numbers[second], those.astype(np.uint32))
            geometry = pycolmap.TwoViewGeometry()
            geometry.config = pycolmap.TwoViewGeometryConfiguration.CALIBRATED
            geometry.inlier_matches = those.astype(np.uint32)
            store.write_two_view_geometry(numbers[first], numbers[second], geometry)
    options = pycolmap.IncrementalPipelineOptions()
    options.num_threads = 1  # sums of several threads differ from run to run
    options.triangulation.min_angle = SETTINGS.angle
    options.extract_colors = False
    output = job.folder / "known"
    output.mkdir()
    images = job.folder / "images"
    return pycolmap.triangulate_points(model, path, images, output, clear_points=True, options=options)


def _write_points(path: Path, model: Any) -> None:
    """Positions [M, 3], grey colours [M, 3], names of images, and observations [N, 2]: a point, and who sees it."""
    numbers = sorted(model.point3D_ids())
    names = sorted(model.images[i].name for i in model.reg_image_ids())
    index = {name: k for k, name in enumerate(names)}
    points = [model.points3D[i] for i in numbers]
    seen = [(k, index[model.images[e.image_id].name]) for k, p in enumerate(points) for e in p.track.elements]
    np.savez(
        path,
        positions=np.array([p.xyz for p in points], float).reshape(-1, 3),
        colours=np.array([p.color for p in points], np.uint8).reshape(-1, 3),
        names=np.array(json.dumps(names)),
        observations=np.array(seen, np.int64).reshape(-1, 2),
    )
