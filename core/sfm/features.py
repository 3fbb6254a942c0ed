"""Features of a set's photos, kept with the twin: new photos are matched with them, the old ones are not read again."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from .settings import Recipe

#: The file's name, beside a model and in a twin's sfm/.
FEATURES = "features.npz"
#: Kept per photo, the largest first: they survive blur and a change of distance best (a photo takes 0.2 MB).
MOST = 1500
#: COLMAP's descriptors are unit vectors times this.
UNIT = 512.0
#: Similarity to the second best over that to the best, as distances (Lowe 2004 takes 0.8).
DISTINCT = 0.8


@dataclass(frozen=True)
class Features:
    """Of one photo.

    Attributes:
        places: [N, 2] float32 px, pixel centres at +0.5, distortion included.
        descriptors: [N, 128] uint8, of length 512.
    """

    places: NDArray[np.float32]
    descriptors: NDArray[np.uint8]


def read_features(database: Path, most: int = MOST) -> dict[str, Features]:
    """The largest of each image in COLMAP's database; runs in the child process only."""
    import pycolmap

    found = {}
    with pycolmap.Database.open(database) as store:
        for image in store.read_all_images():
            points = np.asarray(store.read_keypoints(image.image_id), np.float32)
            descriptors = np.asarray(store.read_descriptors(image.image_id).data, np.uint8)
            size = np.hypot(points[:, 2], points[:, 4]) if points.shape[1] >= 6 else points[:, 2]
            largest = np.argsort(-size, kind="stable")[:most]
            found[image.name] = Features(points[largest, :2].copy(), descriptors[largest])
    return found


def save_features(path: Path, found: Mapping[str, Features], recipe: Recipe) -> None:
    """Writes an .npz file without pickles: everything in one row, with how many belong to each photo."""
    names = sorted(found)
    np.savez(
        path,
        names=np.array(json.dumps(names)),
        recipe=np.array(json.dumps(asdict(recipe))),
        counts=np.array([len(found[name].places) for name in names], np.int64),
        places=np.concatenate([found[name].places for name in names] or [np.zeros((0, 2), np.float32)]),
        descriptors=np.concatenate([found[name].descriptors for name in names] or [np.zeros((0, 128), np.uint8)]),
    )


def load_features(path: Path) -> tuple[dict[str, Features], Recipe] | None:
    """What `save_features` wrote; None if it is not there or not readable: features can be found again."""
    try:
        with np.load(path, allow_pickle=False) as content:
            names, recipe = json.loads(str(content["names"])), Recipe(**json.loads(str(content["recipe"])))
            cuts = np.cumsum(content["counts"])[:-1]
            places, descriptors = np.split(content["places"], cuts), np.split(content["descriptors"], cuts)
        pairs = zip(places, descriptors, strict=True)
        return {name: Features(*one) for name, one in zip(names, pairs, strict=True)}, recipe
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile):
        return None


def matched(first: Features, second: Features) -> NDArray[np.int64]:
    """[M, 2] indices of features that are each other's nearest, and clearly nearer than the second best."""
    if len(first.places) < 2 or len(second.places) < 2:
        return np.zeros((0, 2), np.int64)
    similar = (first.descriptors.astype(np.float32) / UNIT) @ (second.descriptors.astype(np.float32) / UNIT).T
    best, rows = similar.argmax(axis=1), np.arange(len(first.places))
    mutual = similar.argmax(axis=0)[best] == rows
    top = similar[rows, best].copy()
    similar[rows, best] = -1.0
    distance, rival = (np.sqrt(np.maximum(2 - 2 * s, 0)) for s in (top, similar.max(axis=1)))
    clear = np.flatnonzero(mutual & (distance < DISTINCT * rival))
    return np.stack([clear, best[clear]], axis=1)
