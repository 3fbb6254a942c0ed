"""Patches that are aligned between photos: the kernel on known shifts and turns, and the tracks that it moves."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pycolmap
import pytest
from dgs.core.sfm import refine
from dgs.core.sfm.refine import _aligned, _drop_misfits, _plane_axes, _projected, completed, pixel_exact, rebuilt
from dgs.core.sfm.refine_kernels import align
from dgs.core.sfm.settings import RefineSettings
from dgs.core.sfm.straight import adjustment
from dgs.core.sfm.tracks import tracks_of, views_of

from .models import FOCAL, HEIGHT, WIDTH, grid_points, model_of, pixels_of, rigid

DEPTH = 4.0


def waves(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """A smooth texture that is no multiple of itself anywhere near."""
    return (
        0.5
        + 0.1 * np.sin(0.31 * x + 0.05 * y)
        + 0.1 * np.cos(0.23 * y - 0.07 * x)
        + 0.08 * np.sin(0.17 * (x + y) + 0.002 * x * y)
        + 0.05 * np.cos(0.011 * x * x / 4)
    )


def picture(a: float = 1.0, b: float = 0.0, c: float = 0.0, d: float = 1.0, shift: tuple[float, float] = (0.0, 0.0)):
    """[160, 200] of `waves` at A (u - 100, v - 80) + (100, 80) + shift; px centres at +0.5."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    x, y = u - 100, v - 80
    return waves(a * x + b * y + 100 + shift[0], c * x + d * y + 80 + shift[1]).astype(np.float32)


def aligned(
    images: list[np.ndarray], point: tuple[float, ...], warp: tuple[float, ...] = (1, 0, 0, 1), **changes: float
):
    """x, y, correlation, move."""
    settings = {"radius": 6, "stride": 3.0, "steps": 12, "reach": 4.0} | changes
    out = np.full((1, 4), 7.0)
    align(
        0,
        1,
        np.stack(images),
        np.array([[image.shape[1], image.shape[0]] for image in images], np.int32),
        np.array([[0, 1]], np.int32),
        np.array([point], float),
        np.array([warp], float),
        settings["radius"],
        settings["stride"],
        settings["steps"],
        settings["reach"],
        out,
    )
    return out[0]


@pytest.mark.parametrize("shift", [(0.0, 0.0), (1.3, -0.7), (-2.4, 1.9)])
def test_a_moved_picture_is_found_to_a_hundredth_of_a_px(shift: tuple[float, float]) -> None:
    found = aligned([picture(), picture(shift=shift)], (100.2, 80.4, 100.2, 80.4))
    np.testing.assert_allclose(found[:2], [100.2 - shift[0], 80.4 - shift[1]], atol=0.01)
    assert found[2] > 0.9999 and found[3] == pytest.approx(np.hypot(*shift), abs=0.01)


def test_brightness_and_contrast_do_not_matter() -> None:
    found = aligned([picture(), 0.1 + 0.4 * picture(shift=(1.0, 0.5))], (100.0, 80.0, 100.0, 80.0))
    np.testing.assert_allclose(found[:2], [99.0, 79.5], atol=0.01)


def test_a_turned_and_stretched_picture_is_found() -> None:
    """From a guess of no turn, and from the right one, which needs no step."""
    a, b, c, d = 0.97, 0.08, -0.06, 1.04
    other = picture(a, b, c, d)
    found = aligned([picture(), other], (100.0, 80.0, 101.0, 79.2))
    np.testing.assert_allclose(found[:2], [100.0, 80.0], atol=0.01)
    back = np.linalg.inv([[a, b], [c, d]])
    still = aligned([picture(), other], (100.0, 80.0, 100.0, 80.0), tuple(back.ravel()), steps=0)
    assert still[2] > 0.9999 and still[3] == 0.0
    wrong = aligned([picture(), other], (100.0, 80.0, 100.0, 80.0), tuple(back.T.ravel()), steps=0)
    assert wrong[2] < still[2] - 0.01


def test_correlation_in_closed_form() -> None:
    """Without a step: weights exp(-2 r^2 / (span + stride)^2) over the samples."""
    first, second = picture(), picture(shift=(4.0, 3.0))
    found = aligned([first, second], (100.5, 80.5, 100.5, 80.5), steps=0)
    at = np.arange(-6, 7) * 3
    x, y = np.meshgrid(at, at)
    weight = np.exp(-2.0 * (x**2 + y**2) / 21.0**2)
    a, b = (image[80 + y, 100 + x].astype(float) for image in (first, second))
    a, b = (p - (weight * p).sum() / weight.sum() for p in (a, b))
    wanted = (weight * a * b).sum() / np.sqrt((weight * a * a).sum() * (weight * b * b).sum())
    assert found[2] == pytest.approx(wanted, abs=1e-5) and found[3] == 0.0


def test_what_moves_farther_than_it_may_is_not_believed() -> None:
    moved = [picture(), picture(shift=(2.0, 0.0))]
    assert aligned(moved, (100.0, 80.0, 100.0, 80.0), reach=2.1)[2] > 0.99
    assert aligned(moved, (100.0, 80.0, 100.0, 80.0), reach=1.9).tolist() == [7.0, 7.0, -1.0, 7.0]


@pytest.mark.parametrize(
    ("x", "y", "inside"),
    [(22.0, 80, True), (21.9, 80, False), (178.0, 80, True), (178.1, 80, False)]
    + [(100, 22.0, True), (100, 21.9, False), (100, 138.0, True), (100, 138.1, False)],
)
def test_patches_of_the_reference_lie_inside(x: float, y: float, inside: bool) -> None:
    """18 px to the last sample, and 4 for what a sample needs around it."""
    ramp = (np.arange(WIDTH) + np.arange(HEIGHT)[:, None]).astype(np.float32)
    assert (aligned([ramp, ramp], (x, y, 100.0, 80.0), steps=0)[2] > 0.0) == inside


@pytest.mark.parametrize(
    ("x", "y", "warp", "inside"),
    [
        (21.1, 80, (1, 0, 0, 1), True),
        (20.9, 80, (1, 0, 0, 1), False),
        (178.9, 80, (1, 0, 0, 1), True),
        (179.1, 80, (1, 0, 0, 1), False),
        (100, 20.9, (1, 0, 0, 1), False),
        (100, 139.1, (1, 0, 0, 1), False),
        (30.1, 80, (1, -0.5, 0, 1), True),
        (29.9, 80, (1, -0.5, 0, 1), False),
        (100, 29.9, (1, 0, -0.5, 1), False),
        (100, 30.1, (1, 0, -0.5, 1), True),
    ],
)
def test_patches_of_the_other_photo_lie_inside(x: float, y: float, warp: tuple[float, ...], inside: bool) -> None:
    """18 px to the last sample, where the warp puts it, and 3 for what a sample needs around it."""
    ramp = (np.arange(WIDTH) + np.arange(HEIGHT)[:, None]).astype(np.float32)
    found = aligned([ramp, ramp], (100.0, 80.0, x, y), tuple(map(float, warp)), steps=0)
    assert (found[2] > 0.0) == inside


def test_pictures_without_detail_are_not_aligned() -> None:
    flat = np.full((HEIGHT, WIDTH), 0.5, np.float32)
    for pair in ([flat, picture()], [picture(), flat], [picture(), 1.0 - picture()]):
        assert aligned(pair, (100.0, 80.0, 100.0, 80.0))[2] == -1.0


def test_the_axes_of_a_plane_lie_across_its_normal() -> None:
    normals = np.array([[0.0, 0.0, -1.0], [0.6, 0.0, 0.8], [1.0, 0.0, 0.0], [0.48, 0.6, -0.64], [0.6, -0.8, 0.0]])
    axes = _plane_axes(normals)
    for normal, (first, second) in zip(normals, axes.transpose(0, 2, 1), strict=True):
        assert np.linalg.norm(first) == pytest.approx(1.0) and np.linalg.norm(second) == pytest.approx(1.0)
        np.testing.assert_allclose([first @ normal, second @ normal, first @ second], 0.0, atol=1e-12)
        np.testing.assert_allclose(np.cross(normal, first), second, atol=1e-12)


CENTRES = [(-0.4, 0.0, 0.0), (0.0, 0.1, 0.0), (0.4, -0.1, 0.3)]


def photographed(model) -> dict[str, np.ndarray]:
    """Photos of the plane z = 4 with `waves` on it, 40 units of them to one of the world."""
    v, u = np.mgrid[:HEIGHT, :WIDTH] + 0.5
    greys = {}
    for number, image in model.images.items():
        centre = CENTRES[number - 1]
        far = (DEPTH - centre[2]) / FOCAL
        greys[image.name] = waves(
            40 * ((u - WIDTH / 2) * far + centre[0]), 40 * ((v - HEIGHT / 2) * far + centre[1])
        ).astype(np.float32)
    return greys


def test_how_a_photo_moves_when_a_point_does() -> None:
    """Against differences of projections, of a camera that is turned, too."""
    model = model_of(CENTRES, grid_points(1))
    turn = np.array([[0.8, 0.0, -0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 0.8]])
    model.images[2].frame.set_cam_from_world(1, rigid((0.3, 0.2, 0.1), turn))
    views = views_of(model, photographed(model))
    point = np.array([1.0, -0.5, 4.0])
    axes = _plane_axes(np.array([[0.48, 0.6, -0.64]]))
    for view in (0, 1):
        found = _projected(axes, point[None], np.array([view]), views)[0]

        def shown(at: np.ndarray, view: int = view) -> np.ndarray:
            local = views.rotations[view] @ at + views.translations[view]
            return FOCAL * local[:2] / local[2]

        for k in range(2):
            step = 1e-6 * axes[0, :, k]
            np.testing.assert_allclose(found[:, k], (shown(point + step) - shown(point - step)) / 2e-6, rtol=1e-6)


SETTINGS = RefineSettings(observations=40, observations_per_photo=1)


def flawed(error: float, count: int = 36):
    """A model whose features are off by up to `error` px, and its photos; the cameras and points are right."""
    model = model_of(CENTRES, grid_points(count))
    noise = np.random.default_rng(0)
    for number in (1, 3):  # (the photo between them is the one that patches are taken from)
        for point in model.images[number].points2D:
            point.xy = point.xy + noise.uniform(-error, error, 2)
    return model, photographed(model)


def test_features_move_to_where_the_photos_agree() -> None:
    model, greys = flawed(0.6)
    views = views_of(model, greys)
    tracks = tracks_of(model, views)
    assert (tracks.reference == 1).all()
    better = _aligned(tracks, views, RefineSettings(), 0.8)
    assert len(better.point) == len(tracks.point)
    for view, centre in enumerate(CENTRES):
        mine = better.view == view
        true = pixels_of(centre, better.positions)[better.point[mine]]
        assert np.abs(better.pixels[mine] - true).max() < 0.02
    own = better.view == 1
    assert np.array_equal(better.pixels[own], tracks.pixels[own])


def test_what_does_not_agree_is_dropped() -> None:
    model, greys = flawed(0.0)
    greys["0/0003.png"] = greys["0/0003.png"].copy()
    greys["0/0003.png"][:, : WIDTH // 2] = 0.5  # its left half shows nothing
    views = views_of(model, greys)
    tracks = tracks_of(model, views)
    better = _aligned(tracks, views, RefineSettings(), 0.8)
    lost = tracks.view == 2
    right = pixels_of(CENTRES[2], tracks.positions)[:, 0] > WIDTH / 2 + 22
    assert set(better.point[better.view == 2]) >= set(np.flatnonzero(right))
    assert (better.view == 2).sum() < lost.sum() and (better.view == 0).sum() == lost.sum()
    assert len(_aligned(tracks, views, RefineSettings(), 1.01).point) == 0  # nothing agrees so well


def test_points_are_looked_for_where_no_feature_was_found() -> None:
    points = grid_points(36)
    model = model_of(CENTRES, points, seen_by=[(1, 2)] * 36)
    greys = photographed(model)
    views = views_of(model, greys)
    longer = completed(model, views, RefineSettings())
    assert (np.bincount(longer.point) == 3).all() and (np.diff(longer.point) >= 0).all()
    mine = longer.view == 2
    assert np.abs(longer.pixels[mine] - pixels_of(CENTRES[2], points)[longer.point[mine]]).max() < 0.02
    only = completed(model, views, RefineSettings(), frozenset({3}))
    assert len(only.positions) == 36 and (only.view == 2).sum() == 36 and len(only.point) == 72
    assert (only.view[only.view != 2] == only.reference[only.point[only.view != 2]]).all()


def test_only_so_many_points_are_looked_for_in_a_photo(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(refine, "SETTINGS", replace(refine.SETTINGS, points_to_place=9))
    model = model_of(CENTRES, grid_points(36), seen_by=[(1, 2)] * 36)
    views = views_of(model, photographed(model))
    only = completed(model, views, RefineSettings(), frozenset({3}))
    assert (only.view == 2).sum() == 9


def test_points_are_not_looked_for_aside_behind_or_outside(monkeypatch: pytest.MonkeyPatch) -> None:
    points = np.array([[0.0, 0.0, DEPTH], [3.3, 0.0, DEPTH], [0.0, 2.5, DEPTH], [-3.3, 0.0, DEPTH], [0.0, -2.5, DEPTH]])
    centres = [(0.0, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, 8.0), (4.5, 0.0, 0.0), (0.0, 0.05, 0.0)]
    seen = model_of(centres, points, seen_by=[(1, 2)] * 5)
    asked: list[tuple[int, int]] = []
    views = views_of(seen, {image.name: np.zeros((HEIGHT, WIDTH), np.float32) for image in seen.images.values()})

    def noted(tracks, *_):
        asked.extend(zip(tracks.point.tolist(), tracks.view.tolist(), strict=True))
        return tracks, np.ones(len(tracks.point), bool)

    monkeypatch.setattr(refine, "_agreeing", noted)
    completed(seen, views, RefineSettings())
    new = [(point, view) for point, view in asked if view > 1]
    # Photo 2 is behind, photo 3 sees the points from aside; of what photo 4 sees only point 0 is 22 px inside.
    assert new == [(0, 4)]


def test_a_model_of_tracks() -> None:
    model = model_of(CENTRES, grid_points(4), seen_by=[(1, 2, 3), (3, 1), (2, 3), (1, 2)])
    views = views_of(model, photographed(model))
    tracks = tracks_of(model, views)
    again = rebuilt(model, views, tracks)
    assert again.num_points3D() == 4 and again.num_reg_images() == 3 and again.compute_num_observations() == 9
    for number, image in again.images.items():
        assert image.name == model.images[number].name
        np.testing.assert_allclose(image.projection_center(), CENTRES[number - 1])
        for point in image.points2D:
            where = again.points3D[point.point3D_id].xyz
            np.testing.assert_allclose(point.xy, pixels_of(CENTRES[number - 1], where[None])[0])
    seen = {tuple(np.round(p.xyz, 6)): sorted(e.image_id for e in p.track.elements) for p in again.points3D.values()}
    wanted = {tuple(np.round(p.xyz, 6)): sorted(e.image_id for e in p.track.elements) for p in model.points3D.values()}
    assert seen == wanted


def test_observations_that_do_not_fit_are_dropped() -> None:
    model = model_of(CENTRES, grid_points(4))
    model.images[1].points2D[0].xy = model.images[1].points2D[0].xy + [0.8, 0.0]
    model.images[2].points2D[1].xy = model.images[2].points2D[1].xy + [0.0, 1.2]
    first = model.images[1].points2D[0].xy.copy()
    _drop_misfits(model, 1.0, 1.0)
    assert model.compute_num_observations() == 11 and not model.images[2].points2D[1].has_point3D()
    assert model.images[1].points2D[0].has_point3D() and np.array_equal(model.images[1].points2D[0].xy, first)
    _drop_misfits(model, 0.5, 0.5)
    assert model.compute_num_observations() == 10 and not model.images[1].points2D[0].has_point3D()
    _drop_misfits(model, -1.0, -1.0)  # nothing is left
    assert model.num_points3D() == 0
    _drop_misfits(model, 1.0, 1.0)


def test_a_photo_that_little_holds_keeps_what_is_off_by_more() -> None:
    """Three of 16 observations are off: 13 would be too few, and those that are off by less than 4 px stay."""
    model = model_of(CENTRES, grid_points(16))
    for at, off in enumerate((2.0, 3.0, 5.0)):
        model.images[2].points2D[at].xy = model.images[2].points2D[at].xy + [off, 0.0]
    model.images[3].points2D[5].xy = model.images[3].points2D[5].xy + [2.0, 0.0]  # 15 are left without it
    _drop_misfits(model, 1.0, 4.0)
    kept = [[p.has_point3D() for p in model.images[number].points2D] for number in (1, 2, 3)]
    assert all(kept[0]) and [at for at, has in enumerate(kept[1]) if not has] == [2]
    assert [at for at, has in enumerate(kept[2]) if not has] == [5]


def test_a_photo_whose_patches_agree_with_no_other_keeps_its_features() -> None:
    """It would hang on nothing: its camera may go anywhere, and did."""
    model, greys = flawed(0.0)
    greys["0/0003.png"] = np.full_like(greys["0/0003.png"], 0.5)
    before = model.images[3].projection_center()
    exact = pixel_exact(model, greys, RefineSettings())
    assert exact is not model and exact.images[3].num_points3D >= 15
    assert np.linalg.norm(exact.images[3].projection_center() - before) < 0.01
    views = views_of(model, greys)
    assert 3 not in {views.ids[v] for v in _aligned(tracks_of(model, views), views, RefineSettings(), 0.8).view}


def test_points_behind_a_camera_are_dropped() -> None:
    model = model_of([*CENTRES, (0.0, 0.0, 8.0)], grid_points(4))
    _drop_misfits(model, 1.0, 1.0)
    assert model.compute_num_observations() == 12 and not any(p.has_point3D() for p in model.images[4].points2D)


@pytest.mark.parametrize(("fewest", "count", "refined"), [(3, 36, True), (13, 36, False), (3, 25, False)])
def test_patches_that_agree_too_seldom_change_nothing(fewest: int, count: int, refined: bool) -> None:
    """108 observations of three photos are 36 for each; 30 points are the least."""
    model, greys = flawed(0.3, count)
    settings = RefineSettings(fewest_per_photo=fewest if fewest < 10 else 37)
    assert (pixel_exact(model, greys, settings) is not model) is refined


def test_a_model_becomes_exact() -> None:
    model, greys = flawed(0.6)
    model.update_point_3d_errors()
    exact = pixel_exact(model, greys, RefineSettings())
    exact.update_point_3d_errors()
    assert model.compute_mean_reprojection_error() > 0.3 and exact.compute_mean_reprojection_error() < 0.02
    assert exact.num_reg_images() == 3 and exact.num_points3D() == 36


def test_how_cameras_are_adjusted() -> None:
    options = adjustment(RefineSettings(inlier=3.0, iterations=7, tolerance=0.25))
    assert options.ceres.loss_function_type == pycolmap.LossFunctionType.CAUCHY and not options.print_summary
    assert options.ceres.loss_function_scale == 1.5 and options.ceres.solver_options.num_threads == 1
    assert options.ceres.solver_options.max_num_iterations == 7
    assert options.ceres.solver_options.function_tolerance == 0.25
