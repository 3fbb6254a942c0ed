"""Glass that leans and glass that stands in the world, as points show it: on drawn scenes, nothing given."""

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.benchmarks.glass_planes import FAR, Sheet, behind_sheet
from dgs.core.effects.glass import build, inspect
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.glass import FrostedGlass, GlassScene
from dgs.core.inspection import glass_planes
from dgs.core.inspection.glass_planes import glass_of


@pytest.mark.parametrize("standing", [False, True])
def test_widths_are_those_that_a_training_simulates(standing: bool):
    """Of one depth all over each photo, beside `FrostedGlass.widths`."""
    photos, distance = behind_sheet(4, Sheet(0.6, (-20.0, 5.0), standing=standing))
    rig, lean, depth = glass_planes._Rig.of(photos), np.tan(np.radians([-20.0, 5.0])), 1.3 * distance
    lens, diagonal = photos.cameras.lenses[photos.photos[0].name], math.hypot(288, 192)
    scene = GlassScene(lens.fx / diagonal, diagonal, stands=rig.stands if standing else None)
    glass = FrostedGlass.of(FAR / diagonal, distance, scene, tilt=tuple(lean))
    pixel = np.array([[20.5, 30.5], [250.5, 170.5]])
    for row, name in enumerate(rig.stands):
        plane = torch.full((192, 288), depth)
        whole = -glass.widths(list(glass.parameters.values()), plane, 0, Shot(name, 192, 288)).numpy()
        seen = rig.seen(pixel, np.full(2, depth), np.full(2, row))
        found = FAR * seen.behind(rig.planes(distance / rig.middle, lean, standing))
        assert found == pytest.approx([whole[30, 20], whole[170, 250]], rel=1e-3, abs=1e-3), name


def test_a_leaning_glass_is_found_with_its_angles_and_its_distance():
    photos, distance = behind_sheet(1, Sheet(0.7, (25.0, -10.0)))
    found = photos.once(glass_of).plane
    assert not found.standing and found.over_parallel.errors > 2.0
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
    photos, distance = behind_sheet(4, Sheet(0.6, (-20.0, 5.0), standing=True))
    found = photos.once(glass_of).plane
    assert found.standing and np.degrees(np.arctan(found.lean)) == pytest.approx([-20.0, 5.0], abs=6.0)
    assert 0.5 * distance < found.distance < 1.1 * distance
    sheet = build(photos)
    assert set(sheet.scene.stands) == {photo.name for photo in photos.photos}
    assert "stands in the world" in inspect(photos).evidence


def test_a_parallel_glass_is_not_said_to_lean():
    photos, distance = behind_sheet(4, Sheet(0.75))
    seen = photos.once(glass_of)
    assert seen.better_than_even and seen.plane is None
    assert build(photos).tilt == (0.0, 0.0)


def test_without_points_nothing_is_said():
    photos, _ = behind_sheet(4, Sheet(0.75))
    assert glass_of(replace(photos, cameras=None)) is None
