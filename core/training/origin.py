"""What a training was made from, as a checkpoint keeps it: photos by their content, cameras by their values, points."""

from __future__ import annotations

import hashlib
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..views import SparsePoints, View

#: Share by which a camera's values may differ: files round their last digits, and nobody sees a millionth.
SAME_CAMERA = 1e-6
#: What `origin` says of photos, by name.
CONTENTS = ("contents", "held out")


def origin(views: Sequence[View], heldout: Sequence[View], points: SparsePoints) -> dict[str, Any]:
    """For a checkpoint's fingerprint; `first_difference` compares two of them.

    Args:
        views: that the training sees; heldout: that it is judged on.
        points: that it starts from.

    Returns:
        'contents' and 'held out': a digest of each photo (its files, or its px where it came from none);
        'cameras': [19] values of each; 'points': one digest.
    """
    fitted, watched = ({view.name: view.content or _pixels(view) for view in group} for group in (views, heldout))
    return {
        "contents": fitted,
        "held out": watched,
        "cameras": {view.name: _values(view.camera).tolist() for view in (*views, *heldout)},
        "points": hashlib.sha256(
            np.ascontiguousarray(points.positions, "<f8").tobytes() + np.ascontiguousarray(points.colours).tobytes()
        ).hexdigest(),
    }


def cameras_of(kept: Mapping[str, Any], like: Mapping[str, Camera]) -> list[Camera]:
    """Cameras that a training went by, where `origin` kept them; the given ones where it did not.

    Args:
        kept: a checkpoint's fingerprint, out of a file; like: cameras by photo, whose lenses are taken.
    """
    values, found = _object(kept, "cameras"), []
    for name, camera in like.items():
        try:
            where = np.array(values[name], np.float64)[6:18]
            rotation, centre = where[:9].reshape(3, 3), where[9:]
        except (KeyError, TypeError, ValueError):
            found.append(camera)
            continue
        found.append(camera.moved(rotation, -rotation @ centre) if np.isfinite(where).all() else camera)
    return found


def first_difference(kept: Mapping[str, Any], now: Mapping[str, Any]) -> str | None:
    """What is not as it was, in words; None where all is. Only what both have is compared.

    Args:
        kept: out of a file, so that anything may be in it; now: of `origin`.
    """
    for key in CONTENTS:
        for name, content in sorted(_object(now, key).items()):
            if _object(kept, key).get(name, content) != content:
                return f"was made from another photo '{name}' (or mask of it)"
    before, after = _object(kept, "cameras"), _object(now, "cameras")
    for name in sorted(after.keys() & before.keys()):
        if not _same(before[name], after[name], max(abs(row[-1]) for row in after.values())):
            return f"was made with another camera of '{name}'"
    if "points" in kept and kept["points"] != now.get("points"):
        return "began with other points"
    return None


def rank_difference(first: Mapping[str, Any], other: Mapping[str, Any]) -> str | None:
    """What another rank has that is not what the first one has, as 'has another seed (1, not 0)'; None if nothing.

    Args:
        first, other: what `Trainer.fingerprint` says, with 'version' and all of 'settings', as JSON holds it.
    """
    if first["version"] != other["version"]:
        return f"runs version {other['version']}, not {first['version']}"
    before, after = _object(first, "settings"), _object(other, "settings")
    for name in sorted(before.keys() | after.keys()):
        if before.get(name) != after.get(name):
            return f"has another {name} ({after.get(name)}, not {before.get(name)})"
    for key in CONTENTS:
        mine, theirs = _object(first, key), _object(other, key)
        for name in sorted(mine.keys() | theirs.keys()):
            if name not in theirs:
                return f"lacks the photo '{name}'"
            if mine.get(name) != theirs[name]:
                return (
                    f"has another photo '{name}' (or mask of it)" if name in mine else f"has one more photo, '{name}'"
                )
    if first_difference(first, other) is not None:
        return f"has other cameras or points: {first_difference(first, other)}"
    differing = sorted(key for key in (first.keys() | other.keys()) - {"cameras"} if first.get(key) != other.get(key))
    return f"has another {differing[0]}" if differing else None


def _object(facts: Mapping[str, Any], key: str) -> dict[str, Any]:
    value = facts.get(key)
    return value if isinstance(value, dict) else {}


def _values(camera: Camera) -> NDArray[np.float64]:
    """[19]: frame and lens (px), rotation, and the centre with its distance from the origin (world units)."""
    inside = [camera.width, camera.height, camera.fx, camera.fy, camera.cx, camera.cy]
    where = [*camera.centre, np.linalg.norm(camera.centre)]
    return np.concatenate([inside, np.ravel(camera.rotation), where]).astype(np.float64)


def _same(kept: object, now: Sequence[float], extent: float) -> bool:
    """Whether two cameras are one, up to rounding; `extent` is of the world."""
    try:
        before, after = np.array(kept, np.float64), np.array(now, np.float64)
    except (TypeError, ValueError):
        return False
    if before.shape != after.shape:
        return False
    scale = np.concatenate([np.full(6, after[:2].max()), np.ones(9), np.full(4, max(extent, 1e-300))])
    return bool((np.abs(before - after) <= SAME_CAMERA * scale).all())


def _pixels(view: View) -> str:
    """Digest of a photo that came from no file, and of its mask."""
    found = hashlib.sha256(f"{view.photo.shape}{view.photo.dtype}".encode())
    found.update(np.ascontiguousarray(view.photo).data)
    if view.mask is not None:
        found.update(np.ascontiguousarray(view.mask).data)
    return found.hexdigest()
