"""Glass that leans and glass that stands in the world, as points show it: on drawn scenes, nothing given."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.benchmarks import effects as drawn
from dgs.benchmarks.effect_scenes import MARGIN, make_scene
from dgs.core.colour import linear_to_srgb
from dgs.core.effects.glass import build, inspect
from dgs.core.imaging.formation.glass import oblique
from dgs.core.imaging.formation.occluding import OccludingBlur
from dgs.core.imaging.formation.stands import middle_of
from dgs.core.inspection.glass_planes import glass_of

#: px far behind the glass.
FAR = 5.0


def behind_plane(seed, share, lean, standing):
    """Photos through a plane that leans by so many degrees (right, down), and its distance on the axis.

    Args:
        share: of the nearest depth, where it stands.
    """
    scene, inner = make_scene(seed, width=288, height=192, views=10, finer=1), slice(MARGIN, -MARGIN)
    distance = share * float(np.quantile(scene.depth[:, inner, inner], 0.02))
    first = np.array([*np.tan(np.radians(lean)), 1.0]) / distance
    middle = scene.cameras[middle_of(np.array([camera.centre for camera in scene.cameras]))]
    photos = []
    for camera, light, depth in zip(scene.cameras, scene.light, scene.depth, strict=True):
        plane = first
        if standing:
            turn, moved = middle.rotation @ camera.rotation.T, middle.rotation @ (camera.centre - middle.centre)
            plane = turn.T @ first / (1.0 - moved @ first)
        y, x = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5 - MARGIN
        x, y = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fx
        met = plane[0] * x + plane[1] * y + plane[2]
        cosine = met / np.sqrt((plane @ plane) * (1.0 + x**2 + y**2))
        sigma = FAR * oblique(x**2 + y**2, cosine) * np.clip(1.0 - 1.0 / (met * depth), 0.0, None)
        blur = OccludingBlur(-torch.from_numpy(sigma).float(), "gaussian")
        seen = blur.apply(torch.from_numpy(light).permute(2, 0, 1)).permute(1, 2, 0).numpy()[inner, inner]
        photos.append(np.round(255 * linear_to_srgb(np.clip(seen, 0, 1))).astype(np.uint8))
    return drawn.photo_set(scene, photos), distance


def test_a_leaning_glass_is_found_with_its_angles_and_its_distance():
    photos, distance = behind_plane(1, 0.7, (25.0, -10.0), standing=False)
    found = glass_of(photos).plane
    assert not found.standing and found.gain > 2.0 * found.gain_error
    assert found.distance == pytest.approx(distance, rel=0.1) and found.far == pytest.approx(FAR, rel=0.1)
    angles = np.degrees(np.arctan(found.lean))
    assert angles == pytest.approx([25.0, -10.0], abs=6.0)
    assert np.all(np.abs(np.array(found.lean) - np.tan(np.radians([25.0, -10.0]))) < 3.0 * np.array(found.lean_error))
    evidence = inspect(photos)
    assert evidence.needed and "the glass leans by" in evidence.evidence
    sheet = build(photos)
    assert sheet.tilt == pytest.approx(found.lean, rel=1e-5) and sheet.scene.stands is None
    assert sheet.spread * math.hypot(288, 192) <= found.far * (1 + 1e-6)


def test_a_glass_that_stands_in_the_world_is_no_leaning_one():
    photos, distance = behind_plane(4, 0.6, (-20.0, 5.0), standing=True)
    found = glass_of(photos).plane
    assert found.standing and np.degrees(np.arctan(found.lean)) == pytest.approx([-20.0, 5.0], abs=6.0)
    assert 0.5 * distance < found.distance < 1.1 * distance
    sheet = build(photos)
    assert set(sheet.scene.stands) == {photo.name for photo in photos.photos}
    assert "stands in the world" in inspect(photos).evidence


def test_a_parallel_glass_is_not_said_to_lean():
    photos, distance = behind_plane(4, 0.75, (0.0, 0.0), standing=False)
    seen = glass_of(photos)
    assert seen.better_than_even and seen.plane is None
    assert build(photos).tilt == (0.0, 0.0)


def test_without_points_nothing_is_said():
    photos, _ = behind_plane(4, 0.75, (0.0, 0.0), standing=False)
    assert glass_of(replace(photos, cameras=None)) is None
