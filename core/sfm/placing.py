"""New photos placed in a world that stands: matches with reference photos, whose features have depth.

No mapping: a feature of a reference photo is where its ray meets the twin's surface, so that every match gives a
point in the world and its pixel in the new photo, and RANSAC finds the pose. Features that were kept when the
reference photos' cameras were found are used again; else these photos come along. Runs in the child process only.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..colmap_library import pycolmap
from ..numbers import number
from . import mapping
from .attempts import SfmResult, lighter
from .child import wait_for
from .features import FEATURES, load_features, matched, read_features, save_features
from .job import KEPT, PLAN, REFERENCES, SfmJob
from .settings import recipes


@dataclass(frozen=True)
class PlacingSettings:
    """Of the search for new photos' poses."""

    minimum_inliers: int = number(
        60,
        "count",
        "matches that must agree on a pose. One real photo with 41 lay 8 px from where structure from motion of all"
        " puts it, two with 237 and 365 half a px",
        "three real photos",
        "ten photos of the ball (rendered): 0.01 to 0.09 px",
    )
    max_error: float = number(
        6.0, "px", "that a match may be off: the twin's depth is less exact than a triangulated point's"
    )


SETTINGS = PlacingSettings()


@dataclass(frozen=True)
class ReferencePhoto:
    """A photo of the twin, whose camera and depth are given.

    Attributes:
        rotation [3, 3], translation [3]: world to camera; focal, centre: (x, y) in px of the depth map, a pinhole's.
        depth: [H, W] along the axis, in the world's units.
    """

    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    focal: tuple[float, float]
    centre: tuple[float, float]
    depth: NDArray[np.float32]

    def lifted(self, rays: NDArray[np.float64]) -> tuple[NDArray[np.float64], NDArray[np.bool_]]:
        """[N, 3] points in the world where rays [N, 2] (x/z, y/z) end, and which of them the depth map holds."""
        at = np.floor(rays * self.focal + self.centre).astype(int)
        height, width = self.depth.shape
        inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
        at = np.where(inside[:, None], at, 0)
        z = self.depth[at[:, 1], at[:, 0]].astype(np.float64)
        good = inside & np.isfinite(z) & (z > 0)
        local = np.concatenate([rays, np.ones((len(rays), 1))], axis=1) * np.where(good, z, 1.0)[:, None]
        return (local - self.translation) @ self.rotation, good


def run(job: SfmJob, say: Callable[..., None]) -> SfmResult:
    """Poses of the new photos: 'done' with {'poses': {image: {'rotation', 'translation', 'inliers'}}}."""
    kept = load_features(job.folder / KEPT)
    recipe = lighter(recipes(job.kernel is not None)[0], replace(job, settings=replace(job.settings, many=0)))
    if kept is not None:
        recipe = kept[1]
    references = json.loads((job.folder / REFERENCES).read_text("utf-8"))
    new = [name for name in job.images if name not in references]
    images, database = job.folder / "images", job.folder / "place.db"
    images.mkdir()
    say(stage="features", recipe="placing")
    greys = mapping.filtered_greys(job, recipe.noise_to_signal)
    mapping.write_images(greys, images, job.settings.threads)
    mapping.extract(job, recipe, database, images)
    found = read_features(database, None if kept is not None else recipe.max_features)
    old = found if kept is None else kept[0]
    say(stage="matches", recipe="placing")
    save_features(job.folder / FEATURES, found, recipe)
    matches = {}
    with ThreadPoolExecutor(job.settings.threads) as pool:
        for name in new:
            pairs = pool.map(lambda other, mine=found[name]: matched(mine, old[other]), references)
            matches[name] = dict(zip(references, pairs, strict=True))
    wait_for(job.folder / PLAN)  # poses and depth of the references may still be on their way
    plan = json.loads((job.folder / PLAN).read_text("utf-8"))
    lens = pycolmap.Camera(**plan["lens"])
    lifted = {}
    for name in references:
        pixels = old[name].positions.astype(float)
        rays = np.asarray(lens.cam_from_img(pixels), float).reshape(-1, 2) if len(pixels) else np.zeros((0, 2))
        lifted[name] = _reference(job, plan["references"][name]).lifted(rays)
    poses = {}
    for name in new:
        seen, at = [np.zeros((0, 2))], [np.zeros((0, 3))]
        for other, pair in matches[name].items():
            points, good = lifted[other]
            use = pair[good[pair[:, 1]]]
            seen.append(found[name].positions[use[:, 0]].astype(float))
            at.append(points[use[:, 1]])
        pose = _posed(np.concatenate(seen), np.concatenate(at), lens, recipe.seed)
        if pose is not None:
            poses[name] = pose
            say(joined=len(poses))
    return SfmResult("done", {"poses": poses})


def _reference(job: SfmJob, row: dict[str, Any]) -> ReferencePhoto:
    return ReferencePhoto(
        np.array(row["rotation"], float),
        np.array(row["translation"], float),
        tuple(row["focal"]),
        tuple(row["centre"]),
        np.load(job.folder / row["depth"], allow_pickle=False),
    )


def _posed(seen: NDArray[np.float64], at: NDArray[np.float64], lens: Any, seed: int) -> dict[str, Any] | None:
    """The camera that sees points [N, 3] at px [N, 2]; false matches among them are few together."""
    if len(seen) < SETTINGS.minimum_inliers:
        return None
    options = pycolmap.AbsolutePoseEstimationOptions()
    options.ransac.max_error = SETTINGS.max_error
    options.ransac.random_seed = seed
    answer = pycolmap.estimate_and_refine_absolute_pose(seen, at, lens, options)
    if answer is None or answer["num_inliers"] < SETTINGS.minimum_inliers:
        return None
    pose = answer["cam_from_world"]
    return {
        "rotation": pose.rotation.matrix().tolist(),
        "translation": [float(v) for v in pose.translation],
        "inliers": int(answer["num_inliers"]),
    }
