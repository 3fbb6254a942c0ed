"""Features of a set's photos, kept with the twin: new photos are matched with them, the old ones are not read again."""

from __future__ import annotations

import io
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from ..files import parse_json, write_bytes
from ..json_shape import check_shape, text
from ..npy import read_npz
from ..numbers import BY_DEFINITION, number
from .settings import Recipe

#: The file's name, beside a model and in a twin's sfm/.
FEATURES = "features.npz"
#: COLMAP's descriptors are unit vectors times this.
UNIT = 512.0


@dataclass(frozen=True)
class FeatureSettings:
    """Of the features that are kept, and of their matches."""

    kept_per_photo: int = number(
        1500,
        "count",
        "features kept of each photo, the largest first: they survive blur and a change of distance best (a photo takes"
        " 0.2 MB)",
    )
    distinct: float = number(
        0.8,
        "ratio",
        "a match must be nearer than the second best by this (Lowe 2004 takes 0.8); smaller: fewer and surer matches",
        BY_DEFINITION,
    )


SETTINGS = FeatureSettings()


@dataclass(frozen=True)
class Features:
    """Of one photo.

    Attributes:
        positions: [N, 2] float32 px, pixel centres at +0.5, distortion included.
        descriptors: [N, 128] uint8, of length 512.
        content: digest of the photo that shows them (`Photo.content`), by which a photo that is another under the same
            name follows from it; empty where it is not known.
    """

    positions: NDArray[np.float32]
    descriptors: NDArray[np.uint8]
    content: str = ""

    def shown_by(self, content: str) -> bool:
        """Whether they are those of the photo with this digest."""
        return bool(content) and self.content == content


def read_features(database: Path, most: int | None = None) -> dict[str, Features]:
    """The largest of each image in COLMAP's database; runs in the child process only.

    Args:
        most: of each image; None for as many as are kept.
    """
    from ..colmap_library import pycolmap  # late: ends the process where it fails, so only the child loads it

    most = SETTINGS.kept_per_photo if most is None else most

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
    """Writes an .npz file without pickles: everything in one row, with how many belong to each photo.

    Raises:
        OutputError: it cannot be written.
    """
    names = sorted(found)
    positions = [found[name].positions for name in names]
    archive = io.BytesIO()
    np.savez(
        archive,
        names=np.array(json.dumps(names)),
        contents=np.array(json.dumps([found[name].content for name in names])),
        recipe=np.array(json.dumps(asdict(recipe))),
        counts=np.array([len(one) for one in positions], np.int64),
        places=np.concatenate(positions or [np.zeros((0, 2), np.float32)]),
        descriptors=np.concatenate([found[name].descriptors for name in names] or [np.zeros((0, 128), np.uint8)]),
    )
    write_bytes(path, archive.getvalue())


def _text(array: NDArray[Any]) -> Any:
    return parse_json(str(array).encode("utf-8"))


def load_features(path: Path) -> tuple[dict[str, Features], Recipe] | None:
    """What `save_features` wrote; None if it is not there or not readable: features can be found again."""
    try:
        content = read_npz(path)
        names, recipe = _text(content["names"]), Recipe(**_text(content["recipe"]))
        contents = _text(content["contents"])
        check_shape([names, contents], [[text]])
        counts, places, descriptions = content["counts"], content["places"], content["descriptors"]
        whole = int(counts.sum())
        if counts.dtype != np.int64 or (counts < 0).any() or counts.shape != (len(names),):
            return None
        if places.shape != (whole, 2) or descriptions.shape != (whole, 128) or descriptions.dtype != np.uint8:
            return None
        cuts = np.cumsum(counts)[:-1]
        positions, descriptors = np.split(places, cuts), np.split(descriptions, cuts)
        every = zip(positions, descriptors, contents, strict=True)
        return {name: Features(*one) for name, one in zip(names, every, strict=True)}, recipe
    except (OSError, ValueError, KeyError, TypeError, EOFError, BadZipFile, NotImplementedError):
        return None


def matched(first: Features, second: Features) -> NDArray[np.int64]:
    """[M, 2] indices of features that are each other's nearest, and clearly nearer than the second best."""
    if len(first.positions) < 2 or len(second.positions) < 2:
        return np.zeros((0, 2), np.int64)
    similar = (first.descriptors.astype(np.float32) / UNIT) @ (second.descriptors.astype(np.float32) / UNIT).T
    best, rows = similar.argmax(axis=1), np.arange(len(first.positions))
    mutual = similar.argmax(axis=0)[best] == rows
    top = similar[rows, best].copy()
    similar[rows, best] = -1.0
    distance, rival = (np.sqrt(np.maximum(2 - 2 * s, 0)) for s in (top, similar.max(axis=1)))
    clear = np.flatnonzero(mutual & (distance < SETTINGS.distinct * rival))
    return np.stack([clear, best[clear]], axis=1)
