"""What the same points say of frosted glass: on drawn scenes with a glass, an even blur, shaken photos, and none."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.benchmarks import effects as drawn
from dgs.benchmarks.effect_scenes import MARGIN, Truth, degrade, make_scene
from dgs.core.colour import linear_to_srgb
from dgs.core.effects.glass import build, inspect
from dgs.core.imaging.formation.glass import oblique
from dgs.core.imaging.formation.occluding import OccludingBlur
from dgs.core.inspection import surface_bands as points
from dgs.core.inspection.glass_by_points import glass_by_points
from dgs.core.inspection.photo_set import PhotoSet

#: px far behind the glass.
FAR = 5.0


@pytest.fixture(scope="module")
def scene():
    return make_scene(1, width=288, height=192, views=10, finer=1)


@pytest.fixture(scope="module")
def distance(scene):
    """Of the glass: four fifths of what is nearest."""
    return 0.8 * float(np.quantile(scene.depth[:, MARGIN:-MARGIN, MARGIN:-MARGIN], 0.02))


@pytest.fixture(scope="module")
def behind(scene, distance):
    """Photos behind glass, by true depths."""
    photos, inner = [], slice(MARGIN, -MARGIN)
    for camera, light, depth in zip(scene.cameras, scene.light, scene.depth, strict=True):
        y, x = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5 - MARGIN
        tangent2 = ((x - camera.cx) ** 2 + (y - camera.cy) ** 2) / camera.fx**2
        sigma = FAR * oblique(tangent2) * np.clip(1.0 - distance / depth, 0.0, None)
        blur = OccludingBlur(-torch.from_numpy(sigma).float(), "gaussian")
        seen = blur.apply(torch.from_numpy(light).permute(2, 0, 1)).permute(1, 2, 0).numpy()[inner, inner]
        photos.append(np.round(255 * linear_to_srgb(np.clip(seen, 0, 1))).astype(np.uint8))
    return drawn.photo_set(scene, photos)


def others(scene, truth):
    return drawn.photo_set(scene, degrade(scene, replace(truth, noise=0.5), 1))


def test_photos_behind_glass_show_its_width_and_its_distance(behind, distance):
    seen = glass_by_points(behind)
    width = FAR * (1.0 - distance / seen.middle)
    assert seen.width == pytest.approx(width, rel=0.25) and seen.distance == pytest.approx(distance, rel=0.15)
    assert seen.better_than_even and seen.safe_width < width
    assert seen.sigma(seen.middle) == pytest.approx(seen.width)
    assert seen.grows == pytest.approx(seen.sigma(seen.farthest) - seen.sigma(seen.nearest), rel=1e-3)
    evidence = inspect(behind)
    assert evidence.needed and "alike in all photos" in evidence.evidence
    sheet = build(behind)
    assert sheet.distance == pytest.approx(seen.distance, rel=1e-5) and not sheet.learned
    assert sheet.sigma(seen.middle, math.hypot(288, 192)) == pytest.approx(seen.safe_width, rel=1e-4)


def test_a_given_width_leaves_the_distance(behind, distance):
    middle = behind.observations.median_depth
    seen = glass_by_points(behind, FAR * (1.0 - distance / middle), middle)
    assert seen.distance == pytest.approx(distance, rel=0.15)
    # The same glass, its width given elsewhere.
    there = glass_by_points(behind, FAR * (1.0 - distance / (1.3 * middle)), 1.3 * middle)
    assert there.distance == pytest.approx(distance, rel=0.15)


@pytest.mark.parametrize(
    "truth", [Truth(), Truth(psf=(2.0, 2.0, 0.0)), Truth(motion=8.0)], ids=["sharp", "psf", "motion"]
)
def test_no_glass_where_there_is_none(scene, truth):
    photos = others(scene, truth)
    evidence = inspect(photos)
    assert not evidence.needed and "--glass" in evidence.evidence
    assert build(photos).spread == 0.0


def test_an_even_blur_is_no_glass_though_a_glass_is_wider_off_the_axis():
    """Held against a glass right at the camera alone, this one grows by 2 px, five errors from zero."""
    scene = make_scene(2, width=288, height=192, views=10, finer=1)
    photos = others(scene, Truth(psf=(4.0, 4.0, 0.0)))
    seen = glass_by_points(photos)
    assert seen.over_camera.errors > 4.0 and seen.over_even.errors < 0.0
    assert not seen.better_than_even and not inspect(photos).needed


def test_too_little_to_say_anything(scene, behind):
    assert glass_by_points(PhotoSet(behind.photos)) is None
    black = [replace(photo, pixels=np.zeros_like(photo.pixels)) for photo in behind.photos]
    assert inspect(PhotoSet(black, behind.cameras)).estimate["value"] is None


def test_the_response_of_a_band_is_that_of_gaussians():
    """Energy of white noise that a blur of half the band's width leaves, against the table for a flat law."""
    random = np.random.default_rng(0)
    at = np.full((2, 1), 128.0)
    grey = random.normal(1.0, 0.05, (256, 256)).astype(np.float32)
    power = points._power_at(grey, 0.0, at, 3.0, 40.0)
    variances, signs = points._difference(3.0)
    gain = (signs[:, None] * signs / (variances[:, None] + variances)).sum() / (2 * np.pi)
    assert math.exp(power[0]) == pytest.approx(0.05**2 * gain, rel=0.3)
    assert np.all(np.diff(points.response(np.linspace(0, 4, 50))) < 0) and points.response(np.zeros(1))[0] == 0.0
