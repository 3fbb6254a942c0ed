"""How far estimated cameras are from reference cameras, whatever world each of them lives in."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..errors import CameraError

#: A direction in which the centres spread less than this share of their widest spread fixes nothing.
RANK_TOLERANCE = 1.0e-2


@dataclass(frozen=True)
class Similarity:
    """x' = scale * rotation @ x + translation, from the estimated world into the reference's.

    Attributes:
        scale, rotation [3, 3], translation [3]: the map.
        rank: dimensions that the centres span: 3 in general, 2 in a plane, 1 on a rail, 0 in one
            point (no scale: it is left at 1). Below 2 the rotation rests on the orientations.
    """

    scale: float
    rotation: NDArray[np.float64]
    translation: NDArray[np.float64]
    rank: int

    def points(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """Maps [..., 3] positions."""
        return self.scale * positions @ self.rotation.T + self.translation

    def camera(self, camera: Camera) -> Camera:
        """The same camera, standing in the reference's world."""
        rotation = camera.rotation @ self.rotation.T
        return camera.moved(rotation, -rotation @ self.points(camera.centre))


def align_similarity(
    estimated: Mapping[str, Camera], reference: Mapping[str, Camera], orientation_weight: float = 1.0
) -> Similarity:
    """The similarity that aligns the estimated cameras with the reference, by centres AND orientations.

    The rotation maximises tr(R^T M), M = sum_i c'_i c_i^T + w sum_i R'_i^T R_i, with the centres c
    about their mean and scaled to unit rms (Kabsch/Umeyama with the axes of each camera as further
    points at w^0.5 times the rms spread). Centres alone would leave the roll of a rail free.

    Args:
        estimated, reference: cameras by name; only names in both count.
        orientation_weight: w above.

    Raises:
        CameraError: no name is in both.
    """
    names = sorted(set(estimated) & set(reference))
    if not names:
        raise CameraError("No camera is in both sets", "Compare cameras of the same photos")
    source = np.array([estimated[n].centre for n in names])
    target = np.array([reference[n].centre for n in names])
    source_mean, target_mean = source.mean(0), target.mean(0)
    source, target = source - source_mean, target - target_mean
    source_rms, target_rms = (float(np.sqrt((source**2).sum(1).mean())), float(np.sqrt((target**2).sum(1).mean())))
    spread = np.linalg.svd(target, compute_uv=False) if len(names) > 1 else np.zeros(3)
    floor = 1e-9 * max(1.0, float(np.abs(target_mean).max()))
    placed = source_rms > 0.0 and target_rms > floor
    rank = int((spread > RANK_TOLERANCE * spread[0]).sum()) if placed else 0
    moment = orientation_weight * sum(
        (reference[n].rotation.T @ estimated[n].rotation for n in names), np.zeros((3, 3))
    )
    if placed:
        moment = moment + (target / target_rms).T @ (source / source_rms)
    u, _, vt = np.linalg.svd(moment)
    rotation = u @ np.diag([1.0, 1.0, float(np.sign(np.linalg.det(u @ vt)))]) @ vt
    scale = float((target * (source @ rotation.T)).sum() / (source**2).sum()) if placed else 1.0
    if scale <= 0.0:  # the centres contradict the orientations (a mirrored or random model)
        scale = target_rms / source_rms
    return Similarity(scale, rotation, target_mean - scale * rotation @ source_mean, rank)


@dataclass(frozen=True)
class PoseErrors:
    """Errors of the cameras that are in both sets, in the order of `names`.

    Attributes:
        names: sorted names.
        centre: [n] distance between the centres, in units of the reference's world.
        centre_px: [n] centre / depth * fx, NaN without depths: by how many px a point at the
            depth of the scene moves in the photo when the camera is that far off. The field's
            'px-equivalent'.
        angle: [n] angle between the orientations in degrees.
        focal: [n] fx / reference fx - 1.
        alignment: the similarity that was applied first.
    """

    names: tuple[str, ...]
    centre: NDArray[np.float64]
    centre_px: NDArray[np.float64]
    angle: NDArray[np.float64]
    focal: NDArray[np.float64]
    alignment: Similarity


def scene_depth(camera: Camera, positions: NDArray[np.float64]) -> float:
    """Median depth of the [M, 3] positions that project into the frame; NaN if none does."""
    inside, depth = camera.in_frame(positions), camera.projected(positions)[1]
    return float(np.median(depth[inside])) if inside.any() else float("nan")


def pose_errors(
    estimated: Mapping[str, Camera],
    reference: Mapping[str, Camera],
    reference_points: NDArray[np.float64] | None = None,
) -> PoseErrors:
    """Aligns, then measures every camera that is in both sets.

    Args:
        estimated, reference: cameras by name.
        reference_points: [M, 3] points of the reference's world; they give each view its depth.

    Raises:
        CameraError: no name is in both.
    """
    similarity = align_similarity(estimated, reference)
    names = tuple(sorted(set(estimated) & set(reference)))
    centre, pixels, angle, focal = [], [], [], []
    for name in names:
        moved, truth = similarity.camera(estimated[name]), reference[name]
        distance = float(np.linalg.norm(moved.centre - truth.centre))
        depth = float("nan") if reference_points is None else scene_depth(truth, reference_points)
        centre.append(distance)
        pixels.append(distance / depth * truth.fx)
        # 2 asin(|A - B|_F / sqrt(8)) keeps its digits near 0, where arccos of the trace loses half.
        half = np.linalg.norm(moved.rotation - truth.rotation) / np.sqrt(8.0)
        angle.append(float(np.degrees(2.0 * np.arcsin(min(1.0, float(half))))))
        focal.append(estimated[name].fx / truth.fx - 1.0)
    return PoseErrors(names, np.array(centre), np.array(pixels), np.array(angle), np.array(focal), similarity)
