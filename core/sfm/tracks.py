"""ViewStack and tracks of a reconstruction as flat arrays, which patches are aligned by. In the child process only."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]


@dataclass(frozen=True)
class PointTracks:
    """Observations of all points, as flat arrays.

    Attributes:
        positions: [M, 3] points.
        point, view: [N] indices of each observation's point and view, sorted by point.
        pixels: [N, 2] where it was seen.
        reference: [M] the view whose patch defines the point.
        ids: [M] the points' ids in the model.
    """

    positions: Floats
    point: Integers
    view: Integers
    pixels: Floats
    reference: Integers
    ids: Integers


@dataclass(frozen=True)
class ViewStack:
    """Cameras and photos as stacked arrays.

    Attributes:
        ids: image ids of the model.
        images: [V, H, W] float32, smaller photos padded; sizes: [V, 2] int32 width, height.
        rotations [V, 3, 3], translations [V, 3], centres [V, 3], focals [V].
    """

    ids: list[int]
    images: NDArray[np.float32]
    sizes: NDArray[np.int32]
    rotations: Floats
    translations: Floats
    centres: Floats
    focals: Floats


def _poses(model: Any, ids: list[int]) -> dict[str, Floats]:
    poses = [model.images[i].cam_from_world() for i in ids]
    rotations = np.array([p.rotation.matrix() for p in poses])
    translations = np.array([p.translation for p in poses])
    centres = -np.einsum("nji,nj->ni", rotations, translations)
    focals = np.array([model.cameras[model.images[i].camera_id].mean_focal_length() for i in ids])
    return {"rotations": rotations, "translations": translations, "centres": centres, "focals": focals}


def moved(views: ViewStack, model: Any) -> ViewStack:
    """The same photos with the cameras of a COLMAP model that has all of them."""
    poses = _poses(model, views.ids)
    return ViewStack(views.ids, views.images, views.sizes, **poses)


def views_of(model: Any, greys: dict[str, NDArray[np.float32]]) -> ViewStack:
    """Photos of a COLMAP model with their cameras.

    Args:
        greys: by photo name, [H, W] float32 each; smaller ones are filled up with zeros.
    """
    ids = sorted(model.reg_image_ids())
    photos = [greys[model.images[i].name] for i in ids]
    heights, widths = zip(*[p.shape for p in photos], strict=True)
    images = np.zeros((len(ids), max(heights), max(widths)), np.float32)
    for image, photo in zip(images, photos, strict=True):
        image[: photo.shape[0], : photo.shape[1]] = photo
    return ViewStack(ids, images, np.array([widths, heights], np.int32).T.copy(), **_poses(model, ids))


def tracks_of(model: Any, views: ViewStack) -> PointTracks:
    """Points of a COLMAP model, and where photos of `views` see them."""
    index = {image_id: i for i, image_id in enumerate(views.ids)}
    pixels = {i: np.array([p.xy for p in model.images[i].points2D]) for i in views.ids}
    point, view, seen, positions = [], [], [], []
    ids = sorted(model.point3D_ids())
    for number, point_id in enumerate(ids):
        item = model.points3D[point_id]
        positions.append(item.xyz)
        taken: set[int] = set()
        for element in item.track.elements:
            if element.image_id not in taken:
                taken.add(element.image_id)
                point.append(number)
                view.append(index[element.image_id])
                seen.append(pixels[element.image_id][element.point2D_idx])
    world = np.array(positions).reshape(-1, 3)
    tracks = PointTracks(
        world,
        np.array(point, int),
        np.array(view, int),
        np.array(seen).reshape(-1, 2),
        np.zeros(len(world), int),
        np.array(ids, int),
    )
    return replace(tracks, reference=_frontal(tracks, views))


def _frontal(tracks: PointTracks, views: ViewStack) -> Integers:
    """The view of each point that sees it straight on, from the middle distance."""
    rays = views.centres[tracks.view] - tracks.positions[tracks.point]
    distance = np.linalg.norm(rays, axis=1)
    normals = normals_of(tracks, views)
    frontal = (rays * normals[tracks.point]).sum(1) / distance
    logarithm = np.log(distance)
    count = np.maximum(np.bincount(tracks.point, minlength=len(tracks.positions)), 1)
    middle = np.bincount(tracks.point, logarithm, len(tracks.positions)) / count
    score = frontal - 0.3 * np.abs(logarithm - middle[tracks.point])
    order = np.lexsort((score, tracks.point))
    best = np.zeros(len(tracks.positions), int)
    best[tracks.point[order]] = tracks.view[order]  # the last one written is the best
    return best


def normals_of(tracks: PointTracks, views: ViewStack) -> Floats:
    """[M, 3] unit vectors from the points towards the cameras that see them."""
    rays = views.centres[tracks.view] - tracks.positions[tracks.point]
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    total = np.stack([np.bincount(tracks.point, rays[:, k], len(tracks.positions)) for k in range(3)], axis=1)
    return np.asarray(total / np.maximum(np.linalg.norm(total, axis=1, keepdims=True), 1e-12))


def longest(tracks: PointTracks, views: int, limit: int) -> PointTracks:
    """The longest tracks with about `limit` observations in all, every view getting its share."""
    if len(tracks.point) <= limit:
        return tracks
    length = np.bincount(tracks.point, minlength=len(tracks.positions))
    starts = np.concatenate([[0], np.cumsum(length)])
    seen = np.zeros(views, int)
    share = limit / views
    keep = np.zeros(len(tracks.positions), bool)
    total = 0
    for at in np.argsort(-length, kind="stable"):
        members = tracks.view[starts[at] : starts[at + 1]]
        if (seen[members] < share).any():
            keep[at] = True
            seen[members] += 1
            total += len(members)
            if total >= 1.5 * limit:
                break
    return chosen(tracks, keep[tracks.point])


def spread(tracks: PointTracks, among: NDArray[np.bool_], limit: int) -> NDArray[np.bool_]:
    """Of the observations in `among`, at most about `limit` per photo, evenly over the points."""
    at = np.flatnonzero(among)
    counts = np.bincount(tracks.view[at], minlength=int(tracks.view.max(initial=0)) + 1)
    order = at[np.argsort(tracks.view[at], kind="stable")]
    rank = np.arange(len(order)) - np.repeat(np.cumsum(counts) - counts, counts)
    step = np.maximum(counts / limit, 1.0)[tracks.view[order]]
    keep = np.zeros(len(tracks.view), bool)
    keep[order[np.floor(rank / step) != np.floor((rank - 1) / step)]] = True
    return keep


def chosen(tracks: PointTracks, keep: NDArray[np.bool_]) -> PointTracks:
    """Only the observations of `keep`, and the points that still have two."""
    length = np.bincount(tracks.point[keep], minlength=len(tracks.positions))
    alive = length >= 2
    keep = keep & alive[tracks.point]
    renumber = np.cumsum(alive) - 1
    return PointTracks(
        tracks.positions[alive],
        renumber[tracks.point[keep]],
        tracks.view[keep],
        tracks.pixels[keep],
        tracks.reference[alive],
        tracks.ids[alive],
    )
