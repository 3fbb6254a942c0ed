"""Makes the positions of matched features exact by comparing the photos themselves.

A feature found in one blurred photo is off by half a pixel or more; the same patch aligned between
two photos is off by a tenth of that. So every track keeps the place of one feature, and all others
are moved to where the photos agree with it (least squares of intensities: Lucas & Kanade 1981;
for tracks: Lindenberger et al. 2021, 'Pixel-Perfect SfM', there with learned features).
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from .. import compiled
from .refine_kernels import align
from .settings import RefineSettings

Floats = NDArray[np.float64]


def pixel_exact(model: Any, greys: dict[str, NDArray[np.float32]], settings: RefineSettings) -> Any:
    """Refines a pycolmap.Reconstruction.

    Args:
        model: reconstruction with points; changed in place.
        greys: [H, W] float32 per image name, the photos that the features came from.

    Returns:
        The refined model.
    """
    for _ in range(settings.rounds):
        _move_observations(model, greys, settings)
        adjust(model, settings.inlier)
    return model


def _move_observations(
    model: Any, greys: dict[str, NDArray[np.float32]], settings: RefineSettings
) -> dict[str, float]:
    ids = sorted(model.reg_image_ids())
    index = {image_id: i for i, image_id in enumerate(ids)}
    images = [model.images[i] for i in ids]
    heights, widths = zip(*[greys[i.name].shape for i in images], strict=True)
    stack = np.zeros((len(ids), max(heights), max(widths)), np.float32)
    for i, image in enumerate(images):
        stack[i, : heights[i], : widths[i]] = greys[image.name]
    sizes = np.array([widths, heights], np.int32).T.copy()
    poses = [image.cam_from_world() for image in images]
    rotations = np.array([p.rotation.matrix() for p in poses])
    translations = np.array([p.translation for p in poses])
    centres = -np.einsum("nji,nj->ni", rotations, translations)
    focals = np.array([model.cameras[image.camera_id].mean_focal_length() for image in images])

    pairs, points, warps, where = [], [], [], []
    for point_id, point in model.points3D.items():
        elements = point.track.elements
        views = np.array([index[e.image_id] for e in elements])
        seen = np.array([images[v].points2D[e.point2D_idx].xy for v, e in zip(views, elements, strict=True)])
        to_camera = centres[views] - point.xyz
        distance = np.linalg.norm(to_camera, axis=1)
        normal = (to_camera / distance[:, None]).sum(0)
        normal /= np.linalg.norm(normal)
        # The most frontal view of the middle distance sees the patch with the least stretch.
        frontal = (to_camera @ normal) / distance
        ref = int(np.argmax(frontal - 0.3 * np.abs(np.log(distance / np.median(distance)))))
        tangents = _plane_axes(normal)
        maps = [_projected_axes(rotations[v], translations[v], focals[v], point.xyz, tangents) for v in views]
        back = np.linalg.inv(maps[ref])
        for k in range(len(views)):
            if k != ref:
                pairs.append((views[ref], views[k]))
                points.append((*seen[ref], *seen[k]))
                warps.append((maps[k] @ back).ravel())
                where.append((elements[k].image_id, elements[k].point2D_idx))
    if not pairs:
        return {"tried": 0.0, "kept": 0.0, "move_px": 0.0}
    out = np.zeros((len(pairs), 4))
    compiled.run(
        align, len(pairs), stack, sizes, np.array(pairs, np.int32), np.array(points), np.array(warps),
        settings.radius, settings.stride, settings.steps, settings.reach, out, grain=64,
    )  # fmt: skip
    good = out[:, 2] >= settings.correlation
    for k, (image_id, at) in enumerate(where):
        if good[k]:
            model.images[image_id].points2D[at].xy = out[k, :2]
        elif model.images[image_id].points2D[at].has_point3D():
            model.delete_observation(image_id, at)
    move = float(np.median(out[good, 3])) if good.any() else 0.0
    return {"tried": float(len(pairs)), "kept": float(good.sum()), "move_px": move}


def _plane_axes(normal: Floats) -> Floats:
    helper = np.eye(3)[int(np.argmin(np.abs(normal)))]
    first = np.cross(normal, helper)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(normal, first)], axis=1)


def _projected_axes(rotation: Floats, translation: Floats, focal: float, xyz: Floats, axes: Floats) -> Floats:
    """[2, 2]: how the photo moves when the point moves along the two axes of its plane."""
    x, y, z = rotation @ xyz + translation
    jacobian = focal / z * np.array([[1.0, 0.0, -x / z], [0.0, 1.0, -y / z]])
    return jacobian @ rotation @ axes


def adjust(model: Any, inlier: float) -> None:
    """Bundle adjustment with a robust loss; drops observations beyond `inlier` px, and repeats."""
    import pycolmap

    options = pycolmap.BundleAdjustmentOptions()
    options.print_summary = False
    options.ceres.loss_function_type = pycolmap.LossFunctionType.CAUCHY
    options.ceres.loss_function_scale = 0.5 * inlier
    options.ceres.solver_options.max_num_iterations = 50
    for limit in (4.0 * inlier, inlier):
        pycolmap.bundle_adjustment(model, options)
        _filter(model, limit)


def _filter(model: Any, limit: float) -> None:
    model.update_point_3d_errors()
    for image_id in model.reg_image_ids():
        image = model.images[image_id]
        camera = model.cameras[image.camera_id]
        pose = image.cam_from_world()
        for at in list(image.get_observation_point2D_idxs()):
            observed = image.points2D[at]
            local = pose * model.points3D[observed.point3D_id].xyz
            pixel = camera.img_from_cam(local) if local[2] > 0 else None
            if pixel is None or np.linalg.norm(pixel - observed.xy) > limit:
                if model.images[image_id].points2D[at].has_point3D():
                    model.delete_observation(image_id, at)
