"""Pairs of photos that speak against a model: matches that agree with one another, but not with its cameras.

A mapper that once takes a wrong turn (repeated bricks, two walls alike) builds a model whose points fit well: what does
not fit was left out. The pairs that were left out remember it. A wrong pair alone, of two things that look alike, says
nothing; where many pairs contradict, cameras are wrong.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..colmap_library import pycolmap
from ..numbers import number

Array = NDArray[np.float64]


@dataclass(frozen=True)
class ContradictionSettings:
    """When a pair contradicts."""

    off: float = number(
        0.01,
        "of the longest side",
        "distance of a pair's median match from the line that the cameras ask it to lie on: ten times what features"
        " err by, blurred ones too",
        "an indoor set of 48 photos of 400 px: 0.5 to 3 px in right models, 15 to 100 px in wrong ones",
    )
    agreed: float = number(
        2.0,
        "px",
        "distance of a match from that line within which cameras explain it; in shaken photos features err by 1",
        "room, plant and orrery, shaken: right models explain 0.84 to 0.93, wrong ones 0.18 to 0.92, each less than the"
        " right one; no other value was tried",
    )
    fewest: int = number(15, "count", "matches of a pair that is asked", "COLMAP's default for a pair")


SETTINGS = ContradictionSettings()


@dataclass(frozen=True)
class Agreement:
    """Between a model and the verified pairs that it was made from.

    Attributes:
        contradicted: share of the pairs of placed photos whose matches the cameras do not explain, in [0, 1].
        explained: share of all pairs' matches that the cameras explain; those of photos without a place are not.
    """

    contradicted: float
    explained: float


def agreement(database: Path, model: Any, settings: ContradictionSettings = SETTINGS) -> Agreement:
    """How far the model explains the verified pairs; where there is none, nothing contradicts it.

    Args:
        database: COLMAP's, with features and verified pairs.
        model: pycolmap's reconstruction of some of its images.
    """
    placed = set(model.reg_image_ids())
    features: dict[int, Array] = {}
    bad = []
    matched = explained = 0
    with pycolmap.Database.open(database) as store:
        ids, geometries = store.read_two_view_geometries()
        for pair, geometry in zip(ids, geometries, strict=True):
            images = pycolmap.pair_id_to_image_pair(pair)
            matches = np.asarray(geometry.inlier_matches)
            if len(matches) < settings.fewest:
                continue
            matched += len(matches)
            if not placed.issuperset(images):
                continue
            for image in images:
                if image not in features:
                    features[image] = _rays(store, model, image)
            first, second = (features[image][matches[:, side]] for side, image in enumerate(images))
            distance = _from_line(first, second, *(_pose(model, image) for image in images))
            cameras = [model.cameras[model.images[image].camera_id] for image in images]
            focal = float(np.mean([c.mean_focal_length() for c in cameras]))
            allowed = settings.off * np.mean([max(c.width, c.height) / c.mean_focal_length() for c in cameras])
            bad.append(not float(np.median(distance)) <= allowed)
            explained += int(np.count_nonzero(distance * focal < settings.agreed))
    return Agreement(float(np.mean(bad)) if bad else 0.0, explained / max(1, matched))


def _rays(store: Any, model: Any, image: int) -> Array:
    """[N, 3] rays of a photo's features in its camera's axes, at depth 1."""
    camera = model.cameras[model.images[image].camera_id]
    at = np.asarray(store.read_keypoints(image), np.float64)[:, :2]
    rays = np.asarray(camera.cam_from_img(at), np.float64)[:, :2]
    return np.column_stack([rays, np.ones(len(rays))])


def _pose(model: Any, image: int) -> Array:
    """[3, 4] world to camera."""
    return np.asarray(model.images[image].cam_from_world().matrix(), np.float64)


def _from_line(first: Array, second: Array, pose_first: Array, pose_second: Array) -> Array:
    """[N] Sampson distance of matched rays [N, 3] from their epipolar lines, in focal lengths."""
    turn = pose_second[:, :3] @ pose_first[:, :3].T
    x, y, z = pose_second[:, 3] - turn @ pose_first[:, 3]
    essential = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]) @ turn
    line_second, line_first = first @ essential.T, second @ essential
    slope = np.sqrt((line_second[:, :2] ** 2).sum(axis=1) + (line_first[:, :2] ** 2).sum(axis=1))
    return np.asarray(np.abs((second * line_second).sum(axis=1)) / np.maximum(slope, 1e-300))
