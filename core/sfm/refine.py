"""Makes the positions of matched features exact by comparing the photos themselves.

A feature found in one blurred photo is off by half a pixel or more; the same patch aligned between
two photos is off by a tenth of that. So every track keeps the place of one feature, and all others
are moved to where the photos agree with it (least squares of intensities: Lucas & Kanade 1981;
for tracks: Lindenberger et al. 2021, 'Pixel-Perfect SfM', there with learned features). With the
cameras estimated that well, every point is then looked for in the photos where no feature was found.
Runs in the child process only.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from ..colmap_library import pycolmap
from ..numbers import number
from .refine_kernels import align
from .settings import RefineSettings
from .straight import adjustment, with_straight_lenses
from .tracks import (
    Floats,
    Integers,
    PointTracks,
    ViewStack,
    chosen,
    longest,
    moved,
    normals_of,
    spread,
    tracks_of,
    views_of,
)


@dataclass(frozen=True)
class PatchAlignmentSettings:
    """Of the refinement, beside `RefineSettings`, which differ between small and large sets."""

    minimum_points: int = number(30, "count", "fewer aligned points hold no bundle adjustment together")
    points_to_place: int = number(150, "count", "points that are looked for in a photo whose pose is still to be found")
    second_reach: float = number(2.0, "px", "that points may lie from where refined cameras expect them")
    fewest_of_photo: int = number(
        15,
        "count",
        "observations that agree; a photo with fewer keeps those of its features, or nothing would hold it",
        "copr, shaken along its twin: a camera held by 10 went 463 px off, 76 with its features",
    )
    first_limit: float = number(
        4.0, "inlier limits", "that an observation may be off after the first of two bundle adjustments"
    )


SETTINGS = PatchAlignmentSettings()


def pixel_exact(model: Any, greys: dict[str, NDArray[np.float32]], settings: RefineSettings) -> Any:
    """Refines a pycolmap.Reconstruction by aligned patches and bundle adjustment.

    Args:
        model: reconstruction with points.
        greys: [H, W] float32 per image name, the photos that the features came from.

    Returns:
        A new reconstruction of the same images; its points are those that the photos agree on.
    """
    views = views_of(model, greys)
    limit = max(settings.observations, settings.observations_per_photo * len(views.ids))
    tracks = longest(tracks_of(model, views), len(views.ids), limit)
    tracks, agree = _agreeing(tracks, views, settings, settings.correlation)
    points = len(chosen(tracks, agree).positions)
    if agree.sum() < settings.fewest_per_photo * len(views.ids) or points < SETTINGS.minimum_points:
        return model  # the patches do not agree: no reason to trust them more than the features
    tracks = chosen(tracks, _held(tracks, agree, np.ones_like(agree), len(views.ids)))
    refined = _adjusted(model, views, tracks, settings)
    for _ in range(settings.rounds - 1):
        views = moved(views, refined)
        tracks = completed(refined, views, settings)
        refined = _adjusted(refined, views, tracks, settings)
    return with_straight_lenses(refined, settings)


def compile_early(settings: RefineSettings) -> None:
    """Compiles the kernel for the types that `_aligned` calls it with; does nothing else."""
    align(
        0,
        0,
        np.zeros((1, 1, 1), np.float32),
        np.zeros((1, 2), np.int32),
        np.zeros((0, 2), np.int32),
        np.zeros((0, 4)),
        np.zeros((0, 4)),
        settings.radius,
        settings.stride,
        settings.steps,
        settings.reach,
        np.zeros((0, 4)),
    )


def _aligned(tracks: PointTracks, views: ViewStack, settings: RefineSettings, correlation: float) -> PointTracks:
    """Moves all observations to where their photo agrees with the reference; drops the others."""
    return chosen(*_agreeing(tracks, views, settings, correlation))


def _agreeing(
    tracks: PointTracks, views: ViewStack, settings: RefineSettings, correlation: float
) -> tuple[PointTracks, NDArray[np.bool_]]:
    """The tracks, their observations moved to where photos agree with the reference; and which of them [N] do agree."""
    own = tracks.view == tracks.reference[tracks.point]
    anchor = np.zeros((len(tracks.positions), 2))
    anchor[tracks.point[own]] = tracks.pixels[own]
    others = np.flatnonzero(~own)
    point, view = tracks.point[others], tracks.view[others]
    axes = _plane_axes(normals_of(tracks, views))[point]
    to_other = _projected(axes, tracks.positions[point], view, views)
    to_reference = _projected(axes, tracks.positions[point], tracks.reference[point], views)
    warps = to_other @ np.linalg.inv(to_reference)
    pairs = np.stack([tracks.reference[point], view], axis=1).astype(np.int32)
    guesses = np.concatenate([anchor[point], tracks.pixels[others]], axis=1)
    out = np.zeros((len(others), 4))
    compiled.run(
        align,
        len(others),
        views.images,
        views.sizes,
        pairs,
        guesses,
        warps.reshape(-1, 4),
        settings.radius,
        settings.stride,
        settings.steps,
        settings.reach,
        out,
        grain=64,
    )
    good = out[:, 2] >= correlation
    pixels = tracks.pixels.copy()
    pixels[others[good]] = out[good, :2]
    keep = own.copy()
    keep[others[good]] = True
    return replace(tracks, pixels=pixels), keep


def _held(tracks: PointTracks, keep: NDArray[np.bool_], found: NDArray[np.bool_], photos: int) -> NDArray[np.bool_]:
    """`keep`, and of a photo that next to nothing holds then what was `found` in it before: its features."""
    weak = np.bincount(tracks.view[keep], minlength=photos) < SETTINGS.fewest_of_photo
    return keep | (found & weak[tracks.view])


def _plane_axes(normals: Floats) -> Floats:
    """[M, 3, 2] two axes of the plane across each normal."""
    helper = np.eye(3)[np.argmin(np.abs(normals), axis=1)]
    first = np.cross(normals, helper)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normals, first)], axis=2)


def _projected(axes: Floats, positions: Floats, view: Integers, views: ViewStack) -> Floats:
    """[N, 2, 2]: how the photo moves when the point moves along the axes of its plane."""
    local = np.einsum("nij,nj->ni", views.rotations[view], positions) + views.translations[view]
    x, y, z = local.T
    scale = views.focals[view] / z
    zero = np.zeros_like(x)
    jacobian = np.stack(
        [np.stack([scale, zero, -scale * x / z], 1), np.stack([zero, scale, -scale * y / z], 1)], axis=1
    )
    return np.asarray(jacobian @ views.rotations[view] @ axes)


def completed(
    model: Any, views: ViewStack, settings: RefineSettings, only: frozenset[int] | None = None
) -> PointTracks:
    """Searches for every point in all photos that should show it, close to where it should be.

    With `only`, image ids of the model, just there: the result holds what these photos show, beside the
    observation that each point is compared with.
    """
    tracks = tracks_of(model, views)
    normals = normals_of(tracks, views)
    count = len(tracks.positions)
    observed = np.zeros((count, len(views.ids)), bool)
    observed[tracks.point, tracks.view] = True
    margin = settings.radius * settings.stride + 4.0
    point, view, pixels = [tracks.point], [tracks.view], [tracks.pixels]
    for index, image_id in enumerate(views.ids):
        if only is not None and image_id not in only:
            continue
        local = tracks.positions @ views.rotations[index].T + views.translations[index]
        ray = views.centres[index] - tracks.positions
        facing = (ray * normals).sum(1) / np.linalg.norm(ray, axis=1)
        candidates = np.flatnonzero(~observed[:, index] & (local[:, 2] > 0) & (facing > settings.facing))
        if len(candidates) == 0:
            continue
        camera = model.cameras[model.images[image_id].camera_id]
        at = np.array(camera.img_from_cam(local[candidates]))
        width, height = views.sizes[index]
        inside = ((at > margin) & (at < [width - margin, height - margin])).all(1)
        point.append(candidates[inside])
        view.append(np.full(int(inside.sum()), index))
        pixels.append(at[inside])
    all_points = np.concatenate(point)
    order = np.argsort(all_points, kind="stable")
    longer = replace(
        tracks, point=all_points[order], view=np.concatenate(view)[order], pixels=np.concatenate(pixels)[order]
    )
    if only is not None:
        own = longer.view == longer.reference[longer.point]
        wanted = own | spread(longer, np.isin(np.array(views.ids)[longer.view], sorted(only)), SETTINGS.points_to_place)
        return _aligned(chosen(longer, wanted), views, settings, settings.new_correlation)
    limit = max(settings.observations, settings.observations_per_photo * len(views.ids))
    longer = longest(longer, len(views.ids), 2 * limit)
    before = observed[np.searchsorted(tracks.ids, longer.ids)[longer.point], longer.view]
    longer, agree = _agreeing(longer, views, replace(settings, reach=SETTINGS.second_reach), settings.new_correlation)
    return chosen(longer, _held(longer, agree, before, len(views.ids)))


def _adjusted(model: Any, views: ViewStack, tracks: PointTracks, settings: RefineSettings) -> Any:
    """Bundle adjustment of the tracks with a robust loss; drops misfits, and repeats."""
    result = rebuilt(model, views, tracks)
    options = adjustment(settings)
    for limit in (SETTINGS.first_limit * settings.inlier, settings.inlier):
        pycolmap.bundle_adjustment(result, options)
        _drop_misfits(result, limit, SETTINGS.first_limit * settings.inlier)
    return result


def rebuilt(model: Any, views: ViewStack, tracks: PointTracks) -> Any:
    """A reconstruction with the model's cameras and poses, and these tracks."""
    result = pycolmap.Reconstruction()
    for camera_id in sorted({model.images[i].camera_id for i in views.ids}):
        result.add_camera_with_trivial_rig(model.cameras[camera_id])
    slots = np.zeros(len(tracks.point), int)
    for index, image_id in enumerate(views.ids):
        old = model.images[image_id]
        mine = np.flatnonzero(tracks.view == index)
        slots[mine] = np.arange(len(mine))
        image = pycolmap.Image(name=old.name, keypoints=tracks.pixels[mine], camera_id=old.camera_id, image_id=image_id)
        result.add_image_with_trivial_frame(image, old.cam_from_world())
    ends = np.searchsorted(tracks.point, np.arange(len(tracks.positions) + 1))
    for index, position in enumerate(tracks.positions):
        elements = [
            pycolmap.TrackElement(views.ids[tracks.view[k]], int(slots[k])) for k in range(ends[index], ends[index + 1])
        ]
        result.add_point3D(position, pycolmap.Track(elements=elements), np.zeros(3, np.uint8))
    return result


def _drop_misfits(model: Any, limit: float, loosest: float) -> None:
    """Removes observations more than `limit` px from where their point projects.

    In a photo that fewer than `fewest_of_photo` would be left in, only those more than `loosest` px off.
    """
    misfits = []
    for image_id in sorted(model.reg_image_ids()):
        image = model.images[image_id]
        at = [k for k, p in enumerate(image.points2D) if p.has_point3D()]
        if not at:
            continue
        world = np.array([model.points3D[image.points2D[k].point3D_id].xyz for k in at])
        seen = np.array([image.points2D[k].xy for k in at])
        pose = image.cam_from_world()
        local = world @ pose.rotation.matrix().T + pose.translation
        pixel = np.array(model.cameras[image.camera_id].img_from_cam(local))
        off = np.where(local[:, 2] > 0, np.linalg.norm(pixel - seen, axis=1), np.inf)
        far = ~(off <= limit)
        if np.count_nonzero(~far) < SETTINGS.fewest_of_photo:
            far = ~(off <= loosest)
        misfits += [(image_id, k) for k, bad in zip(at, far, strict=True) if bad]
    for image_id, k in misfits:
        if model.images[image_id].points2D[k].has_point3D():  # gone when its point went
            model.delete_observation(image_id, k)
