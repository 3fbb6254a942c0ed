"""Depths that views agree on: against closed forms, from depths that are off as those behind a blur are."""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.errors import Cancelled, DgsError
from dgs.core.mesh.build import MeshSettings, build_mesh
from dgs.core.mesh.matching import Matching, matched_surfaces, smooth_depth
from dgs.core.mesh.matching_kernels import nearest_places
from dgs.core.mesh.surfaces import SeenSurface, weights
from dgs.core.progress import Silent
from scipy.ndimage import binary_erosion

from .test_mesh import RADIUS, ball_depth, flat_ball, looking_at_the_middle


class Stopped(Silent):
    """Somebody who has asked to stop."""

    def cancelled(self) -> bool:
        return True


def painted(places: np.ndarray, plain_above: float = np.inf) -> np.ndarray:
    """[H, W] grey of places [H, W, 3] on a ball: waves of 5 to 10 px, none where y is less than `-plain_above`."""
    x, y, z = np.moveaxis(places, -1, 0)
    waves = np.sin(31 * x + 9 * y) + np.sin(37 * y - 11 * z) + np.sin(29 * z + 17 * x) + np.sin(43 * (x + y - z))
    return np.where(y < -plain_above, 0.5, 0.5 + 0.1 * waves)


def off(camera: Camera) -> np.ndarray:
    """[H, W] px by which a twin's depth is off: nearer by 4, and by blobs that every view has elsewhere."""
    x, y = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    return -4.0 + 1.5 * np.sin(x / 5.0 + float(camera.name)) * np.sin(y / 6.0)


def surfaces(plain_above: float = np.inf, wrong_by: float = 1.0) -> list[SeenSurface]:
    """A ball from ten places, 11 degrees apart, with depths that are off, by a factor on `off`."""
    found = []
    for angle in np.arange(10) * 0.2:
        camera = looking_at_the_middle(angle, width=120, height=100)
        depth = ball_depth(camera)
        x, y = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
        rays = np.stack([(x - camera.cx) / camera.fx, (y - camera.cy) / camera.fy, np.ones_like(x)], axis=-1)
        places = (rays * depth[..., None] - camera.translation) @ camera.rotation
        grey = np.nan_to_num(painted(places, plain_above))
        wrong = (depth * (1 + wrong_by * off(camera) / camera.fx)).astype(np.float32)
        image = np.repeat(grey[None], 3, axis=0).astype(np.float32)
        found.append(SeenSurface(camera, wrong, weights(wrong, camera), image))
    return found


def errors(found: list[SeenSurface]) -> np.ndarray:
    """px by which depths are off, of all px that have one."""
    each = []
    for surface in found:
        true = ball_depth(surface.camera)
        known = (surface.weight > 0) & np.isfinite(true)
        each.append((surface.depth / true - 1)[known] * surface.camera.fx)
    return np.concatenate(each)


def test_what_views_agree_on_is_right_where_all_depths_are_off() -> None:
    before = surfaces()
    assert np.median(np.abs(errors(before))) > 3.5
    agreed, share = matched_surfaces(before, "agreed", Silent())
    off_by = errors(agreed)
    assert 0.4 < share < 0.98
    assert len(off_by) > 0.4 * len(errors(before))
    assert np.median(np.abs(off_by)) < 0.4 and abs(np.median(off_by)) < 0.2
    assert np.mean(np.abs(off_by) < 1.5) > 0.9


def test_what_shows_nothing_is_left_out_or_filled() -> None:
    before = surfaces(plain_above=0.1)
    plain = []
    for surface in before:
        grey = surface.image[0]
        plain.append((surface.weight > 0) & (np.abs(grey - 0.5) < 1e-6))
    share = {}
    ways: tuple[Matching, ...] = ("agreed", "filled")
    for how in ways:
        found, _ = matched_surfaces(before, how, Silent())
        held = [np.mean(one.weight[where] > 0) for one, where in zip(found, plain, strict=True) if where.sum() > 100]
        share[how] = float(np.mean(held))
        if how == "filled":
            weight = np.concatenate(
                [one.weight[where & (one.weight > 0)] for one, where in zip(found, plain, strict=True)]
            )
            assert np.median(weight) < 0.01 * max(float(one.weight.max()) for one in found)
    assert share["agreed"] < 0.25
    assert share["filled"] > share["agreed"] + 0.3


def test_filling_leaves_no_holes_in_depths_that_are_right() -> None:
    """Not even of a px, beside places that are believed."""
    before = surfaces(wrong_by=0.0)
    for surface in before:  # plain spots, of which windows see nothing
        x, y = np.meshgrid(np.arange(surface.image.shape[2]), np.arange(surface.image.shape[1]))
        surface.image[:, (x % 14 < 7) & (y % 14 < 7)] = 0.5
    after, share = matched_surfaces(before, "filled", Silent())
    assert share < 0.9
    held = []
    for own, one in zip(before[2:-2], after[2:-2], strict=True):
        inner = binary_erosion(own.weight > 0, iterations=10)  # (of the rim some is seen by one view alone)
        assert inner.sum() > 300
        held.append(float(np.mean(one.weight[inner] > 0)))
    assert min(held) > 0.99, held
    assert np.median(np.abs(errors(after))) < 0.4


def test_the_nearest_place_is_the_least_of_what_a_px_and_those_beside_it_see() -> None:
    """Against plain Python: more places than are projected together, and views of two sizes."""
    random = np.random.default_rng(3)
    sizes = np.array([[21, 15], [13, 18]], np.int32)
    lens = np.array([[20.0, 0, 8], [0, 20, 7], [0, 0, 1]])
    projections, offsets = np.stack([lens, lens @ np.diag([1.0, 1, -1])]), np.array([[0.0, 0, 0], [1.0, 0, 6]])
    places = random.uniform([-2, -2, -1], [2, 2, 6], (400, 3))
    found = np.full((2, 18, 21), np.inf, np.float32)
    nearest_places(0, 2, places, projections, offsets, sizes, found)
    expected = np.full_like(found, np.inf)
    for view, (width, height) in enumerate(sizes):
        for u, v, depth in places @ projections[view].T + offsets[view]:
            if depth > 0 and 0 <= u / depth < width and 0 <= v / depth < height:
                i, j = int(u / depth), int(v / depth)
                around = expected[view, max(0, j - 1) : min(height, j + 2), max(0, i - 1) : min(width, i + 2)]
                around[:] = np.minimum(around, np.float32(depth))
    assert 0.1 < np.isinf(found[:, :15, :13]).mean() < 0.9
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_cameras_that_see_nothing_in_common_have_the_twins_own_surface() -> None:
    before = surfaces(wrong_by=0.0)
    turned = looking_at_the_middle(np.pi, width=120, height=100)
    opposite = SeenSurface(turned, before[0].depth, before[0].weight, np.full_like(before[0].image, 0.5))
    plain = SeenSurface(before[0].camera, before[0].depth, before[0].weight, np.full_like(before[0].image, 0.5))
    assert matched_surfaces([plain, opposite], "filled", Silent()) == ([plain, opposite], 0.0)


def test_off_changes_nothing_and_one_view_has_nobody_to_agree_with() -> None:
    before = surfaces()
    assert matched_surfaces(before, "off", Silent()) == (before, 1.0)
    assert matched_surfaces(before[:1], "agreed", Silent()) == (before[:1], 1.0)


def test_views_that_see_nothing_are_no_trouble() -> None:
    camera = looking_at_the_middle(0.0)
    nothing = np.full((camera.height, camera.width), np.nan, np.float32)
    blind = SeenSurface(camera, nothing, np.zeros_like(nothing), np.zeros((3, *nothing.shape), np.float32))
    ways: tuple[Matching, ...] = ("agreed", "filled")
    for how in ways:
        found, _ = matched_surfaces([*surfaces(), blind], how, Silent())
        assert not (found[-1].weight > 0).any() and (found[0].weight > 0).any()


def test_it_stops_when_asked_to() -> None:
    with pytest.raises(Cancelled):
        matched_surfaces(surfaces(), "filled", Stopped())


def test_without_opencv_it_says_what_does_without(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "cv2", None)  # (importing it fails then)
    with pytest.raises(DgsError, match="opencv-python-headless.*take --matching off"):
        matched_surfaces(surfaces(), "filled", Silent())
    assert matched_surfaces(surfaces(), "off", Silent())[1] == 1.0


def test_smooth_depths_keep_planes_and_steps() -> None:
    x, y = np.meshgrid(np.arange(40.0), np.arange(30.0))
    plane = 1.0 / (0.4 + 0.002 * x - 0.001 * y)
    smooth = smooth_depth(plane)
    inner = (slice(4, -4), slice(4, -4))
    assert np.allclose(smooth[inner], plane[inner], rtol=2e-4)
    step = np.where(x < 20, 2.0, 3.0)
    holed = step.copy()
    holed[10:13, 5:8] = np.nan
    holed[20, 30] = 1.0  # one splat
    assert np.allclose(smooth_depth(holed), step, rtol=1e-6)


@pytest.mark.parametrize("matching", ["filled", "off"])
def test_a_twin_that_is_right_stays_round(matching: Matching) -> None:
    cameras = [looking_at_the_middle(angle) for angle in np.arange(10) * 0.2]
    made = build_mesh(flat_ball(), cameras, MeshSettings(matching=matching), Silent())
    distance = np.linalg.norm(made.mesh.vertices, axis=1)
    assert np.median(np.abs(distance - RADIUS)) < 0.5 * made.pixel


def test_where_nothing_is_agreed_on_it_says_so() -> None:
    cameras = [looking_at_the_middle(angle) for angle in (0.0, 3.1)]
    with pytest.raises(DgsError, match="agree on no surface"):
        build_mesh(flat_ball(800), cameras, MeshSettings(matching="agreed"), Silent())


def test_the_command_names_the_ways(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["mesh", str(tmp_path), "--out", str(tmp_path / "m.ply"), "--matching", "guessed"]) == 2
    assert "'filled', 'agreed', 'off'" in capsys.readouterr().err
