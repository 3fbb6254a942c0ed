"""What photos and twin see in common, on pictures and depths that are known in closed form."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.evaluation.shifts import Shifts
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.scale import SceneScale
from dgs.core.twin import changes as changes_module
from dgs.core.twin.changes import Changes, _splats, _width, wider
from dgs.core.twin.consensus import SETTINGS, _seen, _surface
from dgs.core.twin.pictures import draw_changes
from dgs.core.twin.refine_cameras import SETTINGS as REFINING
from dgs.core.twin.refine_cameras import Nearer, ViewAligner, _median
from dgs.core.twin.surface import surface_depth
from dgs.core.views import View
from PIL import Image
from scipy.spatial.transform import Rotation

HEIGHT, WIDTH = 96, 120


def camera() -> Camera:
    turn = Rotation.from_rotvec([0.1, -0.2, 0.3]).as_matrix()
    return Camera("a", WIDTH, HEIGHT, 90.0, 110.0, 57.0, 50.0, turn, np.array([0.3, -0.2, 0.5]))


def projected(c: Camera, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """[N, 2] px of the frame, and [N] depths."""
    local = points @ c.rotation.T + c.translation
    return local[:, :2] / local[:, 2:] * [c.fx, c.fy] + [c.cx, c.cy], local[:, 2]


def shifts(x: float = 0.0, y: float = 0.0, error: float = 0.5, detail: Any = None) -> Shifts:
    whole = np.ones((HEIGHT, WIDTH))
    return Shifts(np.stack([x * whole, y * whole]), error * whole, whole if detail is None else detail)


def test_points_of_the_surface_lie_behind_the_middles_of_px_at_their_depth() -> None:
    """One in each cell, where it holds most detail, off the border."""
    view = SimpleNamespace(camera=camera())
    detail = np.random.default_rng(0).random((HEIGHT, WIDTH))
    depth = 2.0 + 0.01 * np.arange(HEIGHT)[:, None] + 0.02 * np.arange(WIDTH)
    depth[:, 100:] = np.nan
    depth[40:, :20] = -1.0
    px, z = projected(view.camera, _surface(view, shifts(detail=detail), depth))  # type: ignore[arg-type]
    column, row = (px - 0.5).T
    np.testing.assert_allclose(column, np.round(column), atol=1e-6)
    np.testing.assert_allclose(row, np.round(row), atol=1e-6)
    column, row = np.round(column).astype(int), np.round(row).astype(int)
    np.testing.assert_allclose(z, depth[row, column], atol=1e-9)
    edge, cell = SETTINGS.edge, max(4, min(SETTINGS.cell, HEIGHT // SETTINGS.cells))
    assert cell == 9
    rows, columns = (HEIGHT - 2 * edge) // cell, (WIDTH - 2 * edge) // cell
    best = set()
    for i in range(rows):
        for j in range(columns):
            block = detail[edge + i * cell : edge + (i + 1) * cell, edge + j * cell : edge + (j + 1) * cell]
            r, c = np.unravel_index(block.argmax(), block.shape)
            place = int(edge + i * cell + r), int(edge + j * cell + c)
            if depth[place] > 0:
                best.add(place)
    assert {(int(r), int(c)) for r, c in zip(row, column, strict=True)} == best and len(best) > 50


def test_what_a_photo_sees_of_points() -> None:
    """Each at its own place and the photo's shift there, from the optical axis; hidden, doubtful ones and outer not."""
    view = SimpleNamespace(camera=camera())
    px = np.array([[60.25, 40.75], [8.5, 40.0], [7.5, 40.0], [60.0, 87.5], [60.0, 88.5], [111.5, 40.0], [112.5, 40.0]])
    depth = np.full((HEIGHT, WIDTH), 2.0)
    local = np.concatenate([(px - [57.0, 50.0]) / [90.0, 110.0] * 2.0, np.full((len(px), 1), 2.0)], axis=1)
    points = (local - view.camera.translation) @ view.camera.rotation
    index, position, error = _seen(view, points, shifts(1.5, -0.5), depth)  # type: ignore[arg-type]
    assert index.tolist() == [0, 1, 3, 5], "8 px from the border on"
    np.testing.assert_allclose(position, px[index] + [1.5, -0.5] - [57.0, 50.0], atol=1e-9)
    np.testing.assert_allclose(error, 0.5)
    behind = np.concatenate([points, -2 * points.mean(axis=0, keepdims=True) - 50 * view.camera.rotation[2]])
    assert _seen(view, behind, shifts(), depth)[0].tolist() == [0, 1, 3, 5]  # type: ignore[arg-type]
    near = (local / 8 - view.camera.translation) @ view.camera.rotation  # a quarter of a unit away
    assert _seen(view, near, shifts(), depth / 8)[0].tolist() == [0, 1, 3, 5]  # type: ignore[arg-type]
    for wrong in (depth * 1.031, depth * 0.969):
        assert len(_seen(view, points, shifts(), wrong)[0]) == 0  # type: ignore[arg-type]
    for right in (depth * 1.029, depth * 0.971):
        assert len(_seen(view, points, shifts(), right)[0]) == 4  # type: ignore[arg-type]
    for doubtful in (shifts(error=3.01), shifts(x=12.01), shifts(y=-12.01)):
        assert len(_seen(view, points, doubtful, depth)[0]) == 0  # type: ignore[arg-type]
    assert len(_seen(view, points, shifts(x=11.9, error=2.9), depth)[0]) == 4  # type: ignore[arg-type]
    assert _seen(view, points, shifts(error=0.01), depth)[2].tolist() == [0.05] * 4  # type: ignore[arg-type]
    sloped = shifts()
    sloped.shift[0] = np.arange(WIDTH) + 0.5  # at a px' middle its own x
    sloped.shift[0] *= 0.1
    first = _seen(view, points[:1], sloped, depth)[1][0]  # type: ignore[arg-type]
    np.testing.assert_allclose(first, px[0] + [0.1 * px[0, 0], 0.0] - [57.0, 50.0], atol=1e-9)


# --- refined cameras ---------------------------------------------------------------------------------------------


def test_how_much_nearer_photos_lie() -> None:
    """The mean of the ratio's logarithm and its standard error; photos that could not be aligned do not count."""
    before, after = np.array([1.0, 1.0, 1.0, np.nan, 1.0]), np.array([0.5, 0.25, 0.125, 1.0, np.nan])
    found = Nearer.of(before, after)
    change = np.log([0.5, 0.25, 0.125])
    assert found.change == pytest.approx(change.mean())
    assert found.error == pytest.approx(np.std(change, ddof=1) / np.sqrt(3))
    none = Nearer.of(before[:2], after[:2])
    assert (none.change, none.error, none.clear) == (0.0, float("inf"), False)
    small = Nearer.of(np.full(3, 0.001), np.full(3, 0.02))
    assert small.change == 0.0, "both count as no shift"
    limit = float(np.log(REFINING.clearly_nearer))
    assert Nearer(limit - 1e-6, 0.0).clear and not Nearer(limit + 1e-6, 0.0).clear
    assert Nearer(-1.0, 0.33).clear and not Nearer(-1.0, 0.34).clear
    assert _median(np.array([1.0, np.nan, 3.0])) == 2.0 and _median(np.array([np.nan])) is None


def test_a_camera_of_the_unit_world_and_a_grid_goes_back_to_the_world_and_its_photo() -> None:
    given, scale = camera(), SceneScale(np.array([1.0, -2.0, 3.0]), 2.5)
    unit = scale.camera_to_unit(given)
    aligner = ViewAligner(SimpleNamespace(scale=scale))  # type: ignore[arg-type]
    on_grid = replace(unit, fx=unit.fx / 3, fy=unit.fy / 3)
    back = aligner.world(given, on_grid, 3)
    np.testing.assert_allclose(back.rotation, given.rotation)
    np.testing.assert_allclose(back.translation, given.translation, atol=1e-12)
    assert (back.fx, back.fy, back.cx) == (pytest.approx(90.0), pytest.approx(110.0), 57.0)


# --- changes -----------------------------------------------------------------------------------------------------


def test_a_wider_spread_says_so() -> None:
    psf = PointSpread("gaussian", 2.0, 3.0, 30.0, source="gaussian:2,3,30")
    after = wider(psf, 1.5)
    assert (after.sigma_x, after.sigma_y, after.angle, after.source) == (3.0, 4.5, 30.0, "gaussian:3,4.5,30")


@pytest.mark.parametrize(("gain", "expected"), [(0.11, 1.35), (0.09, 1.0)])
def test_another_width_is_believed_if_it_explains_a_tenth_more(gain: float, expected: float) -> None:
    """By the median over px: a part that moved has no say."""
    view = SimpleNamespace(psf=PointSpread("gaussian", 2.0, 2.0))

    def residual(_view: Any, factor: float) -> torch.Tensor:
        out = torch.full((3, 10, 10), (1.0 if factor != 1.35 else 1 - gain) ** 0.5)
        out[:, :4] = 100.0 * factor
        return out

    found, by = _width([view, view], residual)  # type: ignore[list-item]
    assert found == expected and by == pytest.approx(gain if expected != 1.0 else 0.0, abs=1e-6)
    sampled = SimpleNamespace(psf=PointSpread("file", samples=np.ones((3, 3)) / 9))
    assert _width([view, sampled], residual) == (1.0, 0.0)  # type: ignore[list-item]
    assert _width([view, SimpleNamespace(psf=None)], residual) == (1.0, 0.0)  # type: ignore[list-item]


def three_discs(opacity: float = 6.0) -> Gaussians:
    """Three Gaussians side by side, two px wide, two apart from the camera by 4."""
    means = torch.tensor([[-1.0, 0.0, 0.0], [0.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    turn = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(3, 1)
    return Gaussians(means, torch.full((3, 3), np.log(0.1)), turn, torch.full((3,), opacity), torch.zeros(3, 1, 3))


def before_them() -> Camera:
    return Camera("a", 80, 40, 80.0, 80.0, 40.0, 20.0, np.eye(3), np.array([0.0, 0.0, 4.0]))


def test_splats_that_are_seen_mostly_where_something_changed() -> None:
    """One inside, one of which less than half lies inside, one outside; and one that nobody can see."""
    changed = np.zeros((40, 80), bool)
    changed[:, :39] = True  # the middle one's centre lies at 40
    view = SimpleNamespace(name="a", camera=before_them())
    found = _splats(three_discs(), [view], {"a": changed}, RasterSettings())  # type: ignore[list-item]
    assert found.tolist() == [True, False, False]
    found = _splats(three_discs(), [view], {"a": ~changed}, RasterSettings())  # type: ignore[list-item]
    assert found.tolist() == [False, True, True]
    faint = _splats(three_discs(-5.0), [view], {"a": ~changed}, RasterSettings())  # type: ignore[list-item]
    assert faint.tolist() == [False, False, False]
    assert not _splats(three_discs(), [view], {"a": changed & False}, RasterSettings()).any()  # type: ignore[list-item]
    assert changes_module.SHARE == 0.5


def test_a_surface_is_where_the_twin_is_solid() -> None:
    depth = surface_depth(three_discs(), before_them(), RasterSettings())
    assert depth[20, 40] == pytest.approx(4.0, abs=0.01) and depth.dtype == np.float32
    assert np.isnan(depth[2, 2]) and np.isnan(depth[20, 50])
    assert np.isnan(surface_depth(three_discs(0.4), before_them(), RasterSettings())).all()  # 60 % at most


def test_shares_of_changes() -> None:
    half, quarter = np.zeros((4, 4), bool), np.zeros((4, 4), bool)
    half[:2], quarter[0] = True, True
    made = Changes(1.0, 0.0, {"a": half, "b": quarter}, {}, {"a": quarter, "b": quarter}, torch.zeros(1))
    assert (made.share, made.unseen_share) == (0.375, 0.25)
    empty = Changes(1.0, 0.0, {}, {}, {}, torch.zeros(1))
    assert (empty.share, empty.unseen_share) == (0.0, 0.0)


def test_changes_are_drawn_in_their_colours(tmp_path: Path) -> None:
    """photo | residual: red brighter, blue darker | changes red, what no old photo saw green."""
    flat = np.full((8, 12, 3), 100, np.uint8)
    view = View(replace(camera(), name="x.jpg", width=12, height=8), flat)
    residual = np.zeros((4, 6), np.float32)
    residual[0, 0], residual[0, 1], residual[0, 2] = 0.15, -0.3, 0.075
    changed, unseen = np.zeros((4, 6), bool), np.zeros((4, 6), bool)
    changed[1, 1], unseen[2, 2] = True, True
    made = Changes(1.0, 0.0, {"x.jpg": changed}, {"x.jpg": residual}, {"x.jpg": unseen}, torch.zeros(1))
    draw_changes(tmp_path / "c", [view], made, 2)
    picture = np.asarray(Image.open(tmp_path / "c" / "x.png")).astype(int)
    assert picture.shape == (4, 18, 3)
    assert (picture[:, :6] == 100).all()
    assert picture[0, 6].tolist() == [200, 30, 30] and picture[0, 7].tolist() == [30, 60, 200]
    assert picture[0, 8].tolist() == [227, 142, 142] and picture[3, 9].tolist() == [255, 255, 255]
    assert picture[1, 13].tolist() == [160, 58, 58] and picture[2, 14].tolist() == [79, 118, 88]
    assert picture[0, 12].tolist() == [100, 100, 100]
