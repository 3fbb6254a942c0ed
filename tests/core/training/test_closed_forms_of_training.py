"""Schedules, scales, first Gaussians, grids, density control and guards where the right number can be written down."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.colour import decoding_derivative, linear_to_srgb, srgb_to_linear
from dgs.core.constants import LOG_SCALE_LIMIT, LOW_PASS_VARIANCE, SH_C0
from dgs.core.errors import CameraError
from dgs.core.frames import Frame
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.fourier import FourierFilter
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from dgs.core.imaging.spectrum import BINS, NoiseToSignal
from dgs.core.rasterizer import ScreenStatistics
from dgs.core.training.behind import mean_colour
from dgs.core.training.density.control import DENSITY, DensityControl, _copies
from dgs.core.training.density.footprint import pixel_sizes, widened
from dgs.core.training.density.initial import INITIAL, first_gaussians, gaussians_at, lifted_points
from dgs.core.training.grid import GridView, averaged, coarse_camera, coarse_view, grid_step
from dgs.core.training.guards import non_finite_rows, out_of_range
from dgs.core.training.job import PlannedTraining
from dgs.core.training.kept_state import counts_of, fingerprint_of
from dgs.core.training.loss.contrast import MINIMUM_CONTRAST, scene_contrast
from dgs.core.training.loss.objective import LossAndGradient, Objective
from dgs.core.training.loss.photometric import FILL, PhotometricLoss, valid_pixels
from dgs.core.training.loss.specks import speck_gradient, speck_price
from dgs.core.training.loss.variation import SMOOTH, variation_gradient
from dgs.core.training.optimizer import Adam
from dgs.core.training.scale import SCALE, SceneScale, scene_scale
from dgs.core.training.schedule import SCHEDULE, Schedule
from dgs.core.training.settings import CALM_END, LONG_RUN, TrainingSettings, rates_of_long_runs, smoothed_for
from dgs.core.training.trainer import Trainer
from dgs.core.views import SparsePoints, View
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, camera_at
from scipy.spatial.transform import Rotation

CPU = torch.device("cpu")


def straight(z: float = 0.0, width: int = 40, height: int = 30, focal: float = 50.0) -> Camera:
    """Looks along z from (0, 0, z)."""
    return Camera("a", width, height, focal, focal, width / 2, height / 2, np.eye(3), np.array([0.0, 0.0, -z]))


def gaussians(means: object, opacity: object = 1.0, log_scales: object = -1.0) -> Gaussians:
    at = torch.tensor(means, dtype=torch.float32)
    n = len(at)
    turn = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(n, 1)
    sizes = torch.as_tensor(log_scales, dtype=torch.float32).expand(n, 3).clone()
    return Gaussians(
        at, sizes, turn, torch.as_tensor(opacity, dtype=torch.float32).expand(n).clone(), torch.zeros(n, 1, 3)
    )


# --- schedule ----------------------------------------------------------------------------------------------------

PLAN = TrainingSettings(steps=100)


def test_a_resumed_run_with_a_limit_leaves_its_last_phases_their_time() -> None:
    late = Schedule(PLAN, 10.0, step=99)
    assert late.share(99, 0.0) == pytest.approx(SCHEDULE.latest_resumption)
    assert late.share(120, 5.0) == pytest.approx((1 + SCHEDULE.latest_resumption) / 2)
    assert late.share(150, 20.0) == 1.0
    without = Schedule(PLAN, None, step=40)
    assert without.share(40, 0.0) == 0.4 and without.share(90, 1e6) == 0.9 and without.share(200, 0.0) == 1.0


def test_steps_that_are_asked_for_stretch_the_plan() -> None:
    """20 of 50 steps took 8 s: all take 20 s, twice the limit; after them the time is up."""
    schedule = Schedule(replace(PLAN, min_steps=50), 10.0)
    assert schedule.share(0, 0.0) == 0.0
    assert schedule.share(20, 8.0) == pytest.approx(8 / 20)
    assert schedule.ended(49, 19.0) is None and schedule.ended(50, 20.0) == "time limit"
    quick = Schedule(replace(PLAN, min_steps=50), 10.0)
    assert quick.share(20, 1.0) == pytest.approx(0.1) and quick.ended(60, 6.0) is None
    resumed = Schedule(replace(PLAN, min_steps=50), 10.0, step=30)
    assert resumed.share(40, 8.0) == pytest.approx(0.3 + 0.7 * 8 / 16)


def test_the_most_steps_end_every_run() -> None:
    most = SCHEDULE.maximum_steps
    assert Schedule(PLAN, 10.0).ended(most - 1, 1.0) is None and Schedule(PLAN, 10.0).ended(most, 1.0) == "done"
    stubborn = Schedule(replace(PLAN, min_steps=10 * most), 1.0)
    assert stubborn.ended(most - 1, 5.0) is None and stubborn.ended(most, 5.0) == "time limit"
    assert Schedule(replace(PLAN, min_steps=200), None).ended(100, 0.0) == "done", "without a limit steps are the plan"


def test_good_enough_is_at_least_what_was_asked() -> None:
    schedule = Schedule(replace(PLAN, until="25.0", min_steps=10), None)
    schedule.evaluated(5, 0.0, 24.9)
    assert schedule.ended(20, 0.0) is None
    schedule.evaluated(5, 0.0, None)
    assert schedule.ended(20, 0.0) is None
    schedule.evaluated(5, 0.0, 25.0)
    assert schedule.ended(9, 0.0) is None and schedule.ended(10, 0.0) == "quality"
    schedule.evaluated(30, 0.0, 20.0)
    assert schedule.ended(30, 0.0) == "quality", "once met, met"


@pytest.mark.parametrize(("gain", "cools"), [(0.04, True), (0.06, False)])
def test_a_plateau_is_a_last_quarter_that_brought_little(gain: float, cools: bool) -> None:
    settings = replace(PLAN, steps=1000, until="plateau", coarse_share=0.1, start_share=0.1)
    schedule = Schedule(settings, None)
    schedule.evaluated(300, 0.0, 20.0)
    schedule.evaluated(375, 0.0, 20.0 + gain)  # within the last quarter of 400: the best of it counts
    schedule.evaluated(400, 0.0, 19.0)
    assert schedule.share(400, 0.0) == pytest.approx(0.4)
    # Over 0.15 of the work done the share rises from 0.4 to 1.
    assert schedule.share(430, 0.0) == pytest.approx(0.7 if cools else 0.43)
    assert schedule.share(460, 0.0) == pytest.approx(1.0 if cools else 0.46)
    assert schedule.ended(459, 0.0) is None and schedule.ended(460, 0.0) == ("plateau" if cools else None)


@pytest.mark.parametrize("settings", [{"min_steps": 401}, {"coarse_share": 0.31}, {"start_share": 0.31}])
def test_a_plateau_is_not_believed_before_the_first_phases_are_over(settings: dict[str, float]) -> None:
    plan = replace(PLAN, steps=1000, until="plateau", coarse_share=0.1, start_share=0.1)
    schedule = Schedule(replace(plan, **settings), None)  # type: ignore[arg-type]
    schedule.evaluated(300, 0.0, 20.0)
    schedule.evaluated(400, 0.0, 20.0)
    assert schedule.share(430, 0.0) == pytest.approx(0.43)


# --- scale -------------------------------------------------------------------------------------------------------


def test_a_scenes_unit_is_the_median_depth_and_its_origin_the_points_median() -> None:
    positions = np.array([[0.0, 0.0, 2.0], [1.0, 5.0, 4.0], [2.0, 1.0, 9.0]])
    points = SparsePoints(positions, np.zeros((3, 3), np.uint8))
    scale = scene_scale([straight(0.0)], points)
    assert scale.size == 4.0 and scale.origin.tolist() == [1.0, 1.0, 4.0]
    assert scene_scale([straight(3.0)], points).size == 3.5, "points behind a camera do not count: 1 and 6"
    with pytest.raises(CameraError):
        scene_scale([straight(20.0)], points)
    with pytest.raises(CameraError):
        scene_scale([], points)


def test_worlds_and_back() -> None:
    scale = SceneScale(np.array([1.0, -2.0, 3.0]), 4.0)
    unit = gaussians([[0.5, 0.25, -0.5]], log_scales=0.0)
    world = scale.to_world(unit)
    assert world.means.tolist() == [[3.0, -1.0, 1.0]]
    assert world.log_scales[0, 0] == pytest.approx(math.log(4.0))
    back = scale.to_unit(world)
    torch.testing.assert_close(back.means, unit.means)
    torch.testing.assert_close(back.log_scales, unit.log_scales)
    assert scale.points_to_unit(np.array([[3.0, -1.0, 1.0]])).tolist() == [[0.5, 0.25, -0.5]]
    turn = Rotation.from_rotvec([0.1, 0.2, 0.3]).as_matrix()
    camera = straight().moved(turn, np.array([1.0, 2.0, 3.0]))
    seen = camera.rotation @ [3.0, -1.0, 1.0] + camera.translation
    in_unit = scale.camera_to_unit(camera)
    np.testing.assert_allclose(in_unit.rotation @ [0.5, 0.25, -0.5] + in_unit.translation, seen / 4.0)


# --- first Gaussians ---------------------------------------------------------------------------------------------


def test_px_are_lifted_to_the_plane_that_the_points_span() -> None:
    """Inverse depth is linear in the image: a tilted plane is met exactly between its points, margin included."""
    x, y = (plane.ravel() for plane in np.meshgrid(np.linspace(-4, 4, 30), np.linspace(-4, 4, 30)))
    positions = np.stack([x, y, 4.0 + 0.3 * x - 0.2 * y], axis=1)
    camera = straight()
    lifted, pixels = lifted_points(camera, positions, 200, 0.0, np.random.default_rng(0))
    assert len(lifted) == pytest.approx(200, rel=0.15)
    seen = lifted[:, :2] / lifted[:, 2:] * 50.0 + [20.0, 15.0]
    np.testing.assert_allclose(seen, pixels, atol=1e-9)
    assert pixels.min() >= 0 and (pixels < [40, 30]).all()
    off = lifted[:, 2] - (4.0 + 0.3 * lifted[:, 0] - 0.2 * lifted[:, 1])
    inner = ((pixels > 5) & (pixels < [35, 25])).all(axis=1)
    assert np.abs(off[inner]).max() < 1e-9
    # One px in each cell: no quarter of the frame is empty or crowded.
    quarters = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=[4, 3], range=[[0, 40], [0, 30]])[0]
    assert quarters.min() >= 0.6 * quarters.mean() and quarters.max() <= 1.5 * quarters.mean()
    _, wide = lifted_points(camera, positions, 200, 5.0, np.random.default_rng(0))
    assert wide.min() < -3 and wide.min() >= -5 and wide[:, 0].max() > 43 and wide[:, 0].max() <= 45
    nothing = lifted_points(camera, positions[:0], 200, 0.0, np.random.default_rng(0))
    assert nothing[0].shape == (0, 3) and nothing[1].shape == (0, 2)
    few = np.concatenate([positions[(np.abs(x) < 1) & (np.abs(y) < 1)][:8], positions[:1] * 100])
    assert len(lifted_points(camera, few, 50, 0.0, np.random.default_rng(0))[0]) > 0, "eight are enough"
    assert len(lifted_points(camera, few[1:], 50, 0.0, np.random.default_rng(0))[0]) == 0


def test_gaussians_at_their_places() -> None:
    """Half the root mean square distance to the three next ones; half opaque; the colour in the zeroth harmonic."""
    centres = np.array([[0.0, 0, 0], [1, 0, 0], [0, 2, 0], [0, 0, 3], [9, 9, 9]])
    rgb = np.array([[0.5, 0.0, 1.0]] * 5, np.float32)
    made = gaussians_at(centres, rgb, 1)
    assert made.log_scales[0].tolist() == pytest.approx([math.log(0.5 * math.sqrt(14 / 3))] * 3, rel=1e-6)
    assert made.opacity_logits.tolist() == [0.0] * 5 and made.quaternions[0].tolist() == [1, 0, 0, 0]
    assert made.sh.shape == (5, 4, 3) and float(made.sh[:, 1:].abs().max()) == 0.0
    np.testing.assert_allclose(made.sh[0, 0] * SH_C0 + 0.5, rgb[0], atol=1e-6)
    lone = gaussians_at(centres[:1], rgb[:1], 0)
    assert lone.log_scales[0, 0] == pytest.approx(math.log(INITIAL.size * INITIAL.lone_spacing))
    pair = gaussians_at(centres[:2], rgb[:2], 0)
    assert pair.log_scales[0, 0] == pytest.approx(math.log(0.5))
    assert float(gaussians_at(centres[[0, 0]], rgb[:2], 0).log_scales[0, 0]) == pytest.approx(
        math.log(0.5e-7), rel=1e-5
    )


def test_first_gaussians_have_the_photos_colours_where_they_are_seen() -> None:
    x, y = (plane.ravel() for plane in np.meshgrid(np.linspace(-4, 4, 12), np.linspace(-4, 4, 12)))
    points = SparsePoints(np.stack([x, y, np.full(144, 5.0)], axis=1), np.full((144, 3), 10, np.uint8))
    image = np.zeros((3, 30, 40), np.float32)
    image[0] = np.arange(40) / 40
    image[1] = (np.arange(30) / 30)[:, None]
    camera = straight()
    made = first_gaussians([camera], lambda i: image, points, 500, 0, np.random.default_rng(0))
    assert 0.7 * 500 <= len(made) <= 500
    seen = made.means[:, :2] / made.means[:, 2:] * 50.0 + torch.tensor([20.0, 15.0])
    colour = made.sh[:, 0] * SH_C0 + 0.5
    np.testing.assert_allclose(colour[:, 0], np.floor(seen[:, 0]) / 40, atol=2e-2)
    np.testing.assert_allclose(colour[:, 1], np.floor(seen[:, 1]) / 30, atol=3e-2)
    # Dense points come on top, with colours of their own.
    dense = SparsePoints(np.tile(points.positions, (4, 1)), np.tile(points.colours, (4, 1)))
    both = first_gaussians([camera], lambda i: image, dense, 500, 0, np.random.default_rng(0))
    own = (both.sh[:, 0] * SH_C0 + 0.5 - 10 / 255).abs().max(dim=1).values < 1e-5
    assert len(both) == 500 and 100 < int(own.sum()) < 400


# --- grids -------------------------------------------------------------------------------------------------------


def test_a_grids_step_by_its_rule() -> None:
    steps = lambda s, *size: grid_step(Medium(PointSpread("gaussian", s, 2 * s)), *size)  # noqa: E731
    assert [steps(s, 4000, 3000) for s in (1.0, 3.7, 3.8, 6.2, 6.3, 10.0)] == [1, 1, 2, 2, 3, 4]
    assert [steps(10.0, 4000, height) for height in (95, 96, 191, 192, 383, 384)] == [1, 1, 1, 2, 3, 4]


def test_the_view_of_a_coarse_grid() -> None:
    photo = np.random.default_rng(0).integers(0, 256, (7, 9, 3)).astype(np.uint8)
    mask = np.ones((7, 9), bool)
    mask[0, 0] = False
    camera = replace(straight(), width=9, height=7)
    view = View(camera, photo, mask)
    found = coarse_view(view, 2)
    assert found.photo.shape == (3, 4, 3) and found.photo.dtype == np.uint16 and found.levels == 255
    np.testing.assert_allclose(found.photo[1, 2] / 65535, photo[2:4, 4:6].mean(axis=(0, 1)) / 255, atol=1e-5)
    assert found.mask is not None and found.mask.sum() == 11 and not found.mask[0, 0]
    assert (found.camera.width, found.camera.height, found.camera.fx, found.camera.cx) == (4, 3, 25.0, 10.0)
    assert coarse_view(view, 1) is view
    grid = GridView(view, camera, 2, PointSpread("gaussian", 2.0, 2.0), "srgb")
    np.testing.assert_allclose(grid.planes()[:, 1, 2], photo[2:4, 4:6].mean(axis=(0, 1)) / 255, atol=1e-5)
    assert grid.valid is not None and int(grid.valid.sum()) == 11 and grid.psf is not None
    assert grid.psf.sigma_x == pytest.approx(math.sqrt(4 + 0.25) / 2)
    assert GridView(replace(view, mask=np.ones((7, 9), bool)), camera, 2, PointSpread(), "srgb").valid is None
    assert GridView(view, camera, 1, PointSpread(), "srgb").psf is None
    other = grid.seen_by(coarse_camera(straight(1.0), 2))
    assert other.camera.translation[2] == -1.0 and grid.camera.translation[2] == 0.0
    assert grid.blurred_by(None).psf is None and grid.psf is not None
    linear = averaged(view.planes(), 2, "linear")[0, 1, 2]
    light = float(np.asarray(srgb_to_linear(photo[2:4, 4:6, 0] / 255.0)).mean())
    assert float(np.asarray(srgb_to_linear(np.array([linear])))[0]) == pytest.approx(light, abs=1e-5)


# --- footprint ---------------------------------------------------------------------------------------------------


def test_the_size_of_a_px_at_a_gaussian() -> None:
    """z over f, the median over the views that see it; where none does, the median of the others."""
    cameras = [straight(0.0), straight(-2.0), replace(straight(0.0), fx=40.0, fy=60.0, width=20)]
    twin = gaussians([[0.0, 0.0, 4.0], [0.0, 0.0, -1.0], [100.0, 0.0, 4.0]])
    sizes = pixel_sizes(twin, cameras)
    assert sizes.tolist() == pytest.approx([0.08, 0.02, 0.02]), "of two the lower is the median"
    assert pixel_sizes(gaussians([[0.0, 0.0, -9.0]]), cameras).tolist() == [0.0]
    edge = gaussians([[1.59, 0.0, 4.0], [1.61, 0.0, 4.0], [0.0, 1.19, 4.0], [0.0, 1.21, 4.0]])
    seen = pixel_sizes(edge, [straight(0.0), straight(-100.0)])
    assert seen.tolist() == pytest.approx([0.08, 2.08, 0.08, 2.08]), "the near one ends at its width and height"


def test_widening_adds_a_pxs_variance() -> None:
    twin = gaussians([[0.0, 0.0, 4.0]], log_scales=math.log(0.1))
    wide = widened(twin, [straight()], 1.3)
    assert float(wide.log_scales[0, 0]) == pytest.approx(0.5 * math.log(0.01 + (1.3 - LOW_PASS_VARIANCE) * 0.08**2))
    assert torch.equal(widened(twin, [straight()], LOW_PASS_VARIANCE).log_scales, twin.log_scales)
    assert torch.equal(widened(twin, [straight()], 0.1).log_scales, twin.log_scales)


# --- density control and guards ----------------------------------------------------------------------------------


def test_copies_are_drawn_from_the_gaussian_itself() -> None:
    """Their places have its covariance; sizes shrink by the factor, the rest stays."""
    turn = Rotation.from_rotvec([0.3, -0.8, 0.5])
    one = gaussians([[1.0, 2.0, 3.0]], opacity=0.7, log_scales=[math.log(v) for v in (0.5, 0.1, 0.02)])
    one.quaternions = torch.tensor(turn.as_quat()[[3, 0, 1, 2]], dtype=torch.float32)[None] * 3.0
    made = _copies(one, torch.zeros(20000, dtype=torch.long), 1.6, np.random.default_rng(0))
    offset = made.means.double().numpy() - [1.0, 2.0, 3.0]
    own = offset @ turn.as_matrix()
    np.testing.assert_allclose(own.std(axis=0), [0.5, 0.1, 0.02], rtol=0.03)
    np.testing.assert_allclose(np.corrcoef(own.T) - np.eye(3), 0.0, atol=0.03)
    np.testing.assert_allclose(made.log_scales[0], np.log([0.5 / 1.6, 0.1 / 1.6, 0.02 / 1.6]), atol=1e-5)
    assert torch.equal(made.quaternions[5], one.quaternions[0]) and float(made.opacity_logits[5]) == pytest.approx(0.7)


def test_gradients_count_by_the_views_that_saw_a_gaussian() -> None:
    """Half of the larger ones are split, smaller ones cloned; no more than the growth allows."""
    control = DensityControl(4, CPU)
    for radius, length in (([1.0, 0.0, 2.0, 0.0], 3.0), ([1.0, 1.0, 0.0, 0.0], 1.0)):
        gradient = torch.tensor([[length * r, 0.0] for r in radius])
        control.collect(ScreenStatistics(radius=torch.tensor(radius), mean_gradient=gradient))
    assert control.views.tolist() == [2.0, 1.0, 1.0, 0.0] and control.gradients.tolist() == [4.0, 1.0, 6.0, 0.0]


def acted(
    sizes: list[float], lengths: list[float], target: int, opacity: float = 2.0
) -> tuple[Gaussians, dict[str, int]]:
    """What the density control makes of Gaussians on a line, 10 apart, seen once."""
    n = len(sizes)
    start = gaussians([[10.0 * i, 0, 0] for i in range(n)], opacity, torch.tensor(sizes).log()[:, None])
    optimizer, control = Adam(start), DensityControl(n, CPU)
    gradient = torch.tensor([[v, 0.0] for v in lengths])
    control.collect(ScreenStatistics(radius=torch.ones(n), mean_gradient=gradient))
    control.act(optimizer, target, np.random.default_rng(0))
    assert len(control.gradients) == len(control.views) == len(optimizer.gaussians) and not control.views.any()
    return optimizer.gaussians.detached(), control.counts


def test_who_is_cloned_who_is_split_and_how_many() -> None:
    sizes, lengths = [0.1 + 0.01 * i for i in range(10)], [0.0, 5.0, 0.0, 0.0, 0.0, 0.0, 4.0, 3.0, 2.0, 1.0]
    made, counts = acted(sizes, lengths, 1000)
    assert counts == {"pruned": 0, "cloned": 1, "split": 2}, "ceil(0.3 * 10) of those that ask most"
    places = (made.means[:, 0] / 10).round().long()
    assert torch.bincount(places, minlength=10).tolist() == [1, 2, 1, 1, 1, 1, 2, 2, 1, 1]
    split = made.log_scales[places == 6][:, 0].exp()
    assert split.tolist() == pytest.approx([sizes[6] / DENSITY.split_shrink] * 2), "both halves are smaller"
    cloned = made.log_scales[places == 1][:, 0].exp()
    assert cloned.tolist() == pytest.approx([sizes[1]] * 2)
    assert acted(sizes, lengths, 11)[1] == {"pruned": 0, "cloned": 1, "split": 0}
    assert acted(sizes, lengths, 10)[1] == acted(sizes, lengths, 3)[1] == {"pruned": 0, "cloned": 0, "split": 0}
    assert acted(sizes, [0.0] * 10, 1000)[1] == {"pruned": 0, "cloned": 0, "split": 0}
    limit = math.log(DENSITY.minimum_opacity / (1 - DENSITY.minimum_opacity))
    assert acted(sizes, lengths, 1000, limit + 1e-3)[1]["pruned"] == 0
    assert acted(sizes, lengths, 1000, limit - 1e-3)[1]["pruned"] in (0, 5), "all alike: none is the lesser half"


def test_scales_that_the_projection_clamps_are_counted() -> None:
    twin = gaussians([[0.0] * 3] * 4, log_scales=0.0)
    assert out_of_range(twin) == 0
    twin.log_scales[0, 1], twin.log_scales[2, 2] = LOG_SCALE_LIMIT, -LOG_SCALE_LIMIT
    twin.log_scales[3, 0] = LOG_SCALE_LIMIT - 0.01
    assert out_of_range(twin) == 2
    assert out_of_range(gaussians(torch.zeros(0, 3).tolist() or np.zeros((0, 3)))) == 0
    assert non_finite_rows(twin) == {}
    twin.sh[1, 0, 2] = math.nan
    assert {name: rows.tolist() for name, rows in non_finite_rows(twin).items()} == {"sh": [False, True, False, False]}


# --- prices and losses -------------------------------------------------------------------------------------------


def test_the_price_of_a_ramp_is_its_slope() -> None:
    """Every px has the difference g: sum of k log(1 + g / k), without the last row's and column's."""
    ramp = (0.1 * torch.arange(9.0))[None, None].expand(3, 7, 9).contiguous()
    found = variation_gradient(ramp, math.inf)
    size = math.sqrt(3 * 0.01 + SMOOTH**2)
    np.testing.assert_allclose(found[:, :, 0], -0.1 / size, rtol=1e-4)
    np.testing.assert_allclose(found[:, :, 8], 0.1 / size, rtol=1e-4)
    np.testing.assert_allclose(found[:, :, 1:8], 0.0, atol=1e-5)
    knee = 0.05
    np.testing.assert_allclose(variation_gradient(ramp, knee)[:, :, 8], 0.1 / size / (1 + size / knee), rtol=1e-4)


def test_the_price_of_one_bright_px() -> None:
    """Its structure tensor by hand: fields of two differences, spread by (1 2 1) x (1 2 1) / 16."""
    h = 0.5
    image = torch.zeros(1, 9, 9, dtype=torch.float64)
    image[0, 4, 4] = h
    a, b, c = (np.zeros((10, 10)) for _ in range(3))
    a[4, 3] = a[4, 4] = h * h  # to the right: from the left neighbour, and from the px itself
    b[3, 4] = b[4, 4] = h * h
    c[4, 4] = h * h
    taps = np.outer([1, 2, 1], [1, 2, 1]) / 16
    mean = lambda v: sum(taps[i, j] * np.roll(v, (i - 1, j - 1), (0, 1)) for i in range(3) for j in range(3))  # noqa: E731
    a, b, c = mean(a), mean(b), mean(c)
    low = (a + b) / 2 - np.sqrt(((a - b) / 2) ** 2 + c**2 + SMOOTH**4)
    inner = np.sqrt(np.maximum(low, 0) + SMOOTH**2).sum() - 100 * SMOOTH
    flat = float(speck_price(torch.zeros_like(image)))
    assert float(speck_price(image)) - flat == pytest.approx(inner, rel=1e-6)


def test_which_px_of_a_photo_count() -> None:
    photo = torch.tensor([[[0.0, 0.5, 1.0, math.nan, math.inf]]])
    assert valid_pixels(photo)[0, 0].tolist() == [True, True, True, False, False]
    assert valid_pixels(photo, saturation=1.0)[0, 0].tolist() == [True, True, False, False, False]
    mask = torch.tensor([[1, 0, 2, 1, 1]])
    assert valid_pixels(photo, mask)[0, 0].tolist() == [True, False, True, False, False]


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
def test_a_loss_of_photos_that_agree_is_nothing_and_of_grey_ones_its_formula(weight: float) -> None:
    """Flat images, far from the border: SSIM is (2 m n + C1) / (m^2 + n^2 + C1)."""
    photo = torch.rand((3, 40, 45), generator=torch.Generator().manual_seed(0))
    value, gradient = PhotometricLoss(photo, ssim_weight=weight).value_and_gradient(photo)
    assert value == pytest.approx(0.0, abs=1e-5) and gradient.shape == photo.shape
    flat, other = torch.full((1, 60, 64), 0.5), torch.full((1, 60, 64), 0.3)
    inner = torch.zeros(60, 64)
    inner[20:40, 20:44] = 1.0
    # (px that do not count are grey in both: around them the windows differ, inside they are flat)
    value, gradient = PhotometricLoss(flat, ssim_weight=0.0).value_and_gradient(other)
    assert value == pytest.approx(0.2, rel=1e-5)
    np.testing.assert_allclose(gradient, -1 / flat.numel(), rtol=1e-5)
    masked, gradient = PhotometricLoss(flat, inner, 0.0).value_and_gradient(other)
    assert masked == pytest.approx(0.2, rel=1e-5)
    np.testing.assert_allclose(gradient[0], -inner / inner.sum(), rtol=1e-5)
    assert FILL == 0.5
    nothing = PhotometricLoss(flat, torch.zeros(60, 64)).value_and_gradient(other)
    assert nothing[0] == 0.0 and not nothing[1].any()
    for wrong in (-0.1, 1.1):
        with pytest.raises(ValueError, match="w in"):
            PhotometricLoss(flat, ssim_weight=wrong)
    with pytest.raises(ValueError, match="float32"):
        PhotometricLoss(flat).value_and_gradient(other.double())
    with pytest.raises(ValueError, match="float32"):
        PhotometricLoss(flat).value_and_gradient(other[:, 1:])


def test_contrast_of_a_ramp() -> None:
    """Each px differs from its neighbour by 0.02 in three colours."""
    photo = np.round(np.broadcast_to(0.02 * np.arange(40)[None, :, None], (30, 40, 3)) * 65535).astype(np.uint16)
    view = GridView(View(straight(), photo), straight(), 1, None, "srgb")
    assert scene_contrast([view]) == pytest.approx(0.02 * math.sqrt(3), rel=1e-3)
    assert scene_contrast([]) == MINIMUM_CONTRAST


# --- the trainer -------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def trainer() -> Trainer:
    scene = blurred_scene(5)
    return Trainer(scene.views[1:], scene.views[:1], scene.points, scene.medium, replace(SHORT, max_gaussians=300))


def test_step_sizes_of_places_fall_by_a_power(trainer: Trainer) -> None:
    r = trainer.settings.rates
    assert trainer.rates(0.0)["means"] == r.means
    assert trainer.rates(0.5)["means"] == pytest.approx(math.sqrt(r.means * r.means_end))
    assert trainer.rates(0.7)["log_scales"] == r.log_scales


def test_a_run_comes_to_rest(trainer: Trainer) -> None:
    """All step sizes fall in its last part, by a power of the share: half of that part, the root of the whole fall."""
    r, begin, end = trainer.settings.rates, CALM_END.begin, CALM_END.end
    assert trainer.rates(begin)["sh"] == r.sh and trainer.rates(begin + 0.01)["sh"] < r.sh
    assert trainer.rates((1 + begin) / 2)["sh_rest"] == pytest.approx(math.sqrt(end) * r.sh_rest)
    assert trainer.rates(1.0) == trainer.rates(2.0)
    for name, rate in trainer.rates(1.0).items():
        assert rate == pytest.approx(end * (r.means_end if name == "means" else getattr(r, name))), name


def test_step_sizes_of_long_runs_fall_with_the_root_of_the_steps(
    trainer: Trainer, monkeypatch: pytest.MonkeyPatch
) -> None:
    par = LONG_RUN.steps_at_par
    assert rates_of_long_runs(1) == rates_of_long_runs(par) == 1.0
    assert rates_of_long_runs(4 * par) == pytest.approx(0.5)
    short = trainer.rates(0.3)
    monkeypatch.setattr(trainer, "settings", replace(trainer.settings, steps=4 * par))
    assert trainer.rates(0.3) == pytest.approx({name: 0.5 * rate for name, rate in short.items()})


def test_every_photo_is_asked_once_a_round(trainer: Trainer) -> None:
    level = trainer.levels[-1]
    rounds = [[trainer.view_at(level, 4 * k + i).name for i in range(4)] for k in range(6)]
    names = {view.name for view in level.views}
    assert len(names) == 4 and all(set(one) == names for one in rounds) and len({tuple(one) for one in rounds}) > 1


def test_what_is_behind_the_twin_is_shaken_evenly_about_the_photos_mean(trainer: Trainer) -> None:
    colours = []
    for step in range(200):
        trainer.step = step
        colours.append(trainer.backdrop().numpy())
    trainer.step = 0
    off = np.stack(colours) - trainer.background.numpy()
    assert np.abs(off).max() <= trainer.settings.backdrop and np.abs(off).max() > 0.95 * trainer.settings.backdrop
    assert np.abs(off.mean(axis=0)).max() < 0.15 * trainer.settings.backdrop


def test_what_was_repaired_is_counted_by_name(trainer: Trainer) -> None:
    trainer.optimizer.refused = {"means": 2, "sh": 3}
    trainer.culled = {"behind": 7}
    counters = counts_of(trainer)
    assert counters["refused, non-finite gradients"] == 5 and counters["refused, non-finite gradient of sh"] == 3
    assert counters["culled, behind the camera (Gaussian-views)"] == 7
    assert counters["dropped, non-finite Gaussians"] == 0
    trainer.optimizer.refused, trainer.culled = {}, {}


def test_gaussians_that_are_not_finite_are_left_out_of_the_twin(trainer: Trainer) -> None:
    with torch.no_grad():
        before = trainer.optimizer.gaussians.sh[3, 0, 1].clone()
        trainer.optimizer.gaussians.sh[3, 0, 1] = math.nan
        found = trainer.result()
        trainer.optimizer.gaussians.sh[3, 0, 1] = before
    assert len(found) == len(trainer.optimizer.gaussians) - 1
    assert counts_of(trainer)["left out of the twin, non-finite"] == 1
    trainer.repairs.clear()


def test_a_camera_of_the_tiny_scene_is_where_it_is_said() -> None:
    assert np.allclose(camera_at(0.3, -0.2, "x").centre, [0.3, -0.2, -3.0])


def test_smoothness_follows_the_blurs_width() -> None:
    """A blur of five px and more leaves the settings alone; many sharp photos get little smoothing, few all of it."""
    base = TrainingSettings(low_pass=2.0, variation_weight=0.6)
    assert smoothed_for(base, 5.0, 40) is base and smoothed_for(base, 9.0, 3) is base
    sharp = smoothed_for(base, 0.0, 30)
    assert sharp.low_pass == 0.3 and sharp.variation_weight == pytest.approx(0.6 / 4)
    assert smoothed_for(base, 0.0, 10).variation_weight == 0.6
    between = smoothed_for(base, 2.5, 30)
    assert between.low_pass == pytest.approx(0.3 + 1.7 / 4)
    assert between.variation_weight == pytest.approx(0.6 * (0.25 + 0.75 / 4))


def test_the_blurs_mean_width_counts_photos_and_directions_alike() -> None:
    wide = PointSpread(sigma_x=3.0, sigma_y=4.0)
    medium = Medium(wide, per_view={"sharp": None})
    assert medium.mean_sigma(["a"]) == pytest.approx(12.5**0.5)
    assert medium.mean_sigma(["a", "sharp"]) == pytest.approx(6.25**0.5)
    assert Medium(None).mean_sigma(["a"]) == 0.0


def test_of_many_points_every_so_manieth_says_the_unit() -> None:
    """Twice as many as are asked for are all asked; one more, and it is every second one."""
    most = SCALE.points
    positions = np.zeros((2 * most + 1, 3))
    positions[:, 2] = 1.0
    positions[1::2, 2] = 3.0
    colours = np.zeros((len(positions), 3), np.uint8)
    assert scene_scale([straight(0.0)], SparsePoints(positions, colours)).size == 1.0
    assert scene_scale([straight(0.0)], SparsePoints(positions[:-1], colours)).size == 2.0


def test_moments_are_forgotten_of_the_rows_that_are_named() -> None:
    optimizer = Adam(gaussians([[0.0, 0.0, 1.0]] * 3))
    for moments in (optimizer.first, optimizer.second):
        for tensor in moments.values():
            tensor += 2.0
    optimizer.forget("means", torch.tensor([True, False, True]))
    for moments in (optimizer.first, optimizer.second):
        assert moments["means"].tolist() == [[0.0] * 3, [2.0] * 3, [0.0] * 3]
        assert all(float(tensor.min()) == 2.0 for name, tensor in moments.items() if name != "means")


def test_depth_is_interpolated_in_sixteen_photos_spread_over_all() -> None:
    x, y = (plane.ravel() for plane in np.meshgrid(np.linspace(-4, 4, 12), np.linspace(-4, 4, 12)))
    points = SparsePoints(np.stack([x, y, np.full(144, 5.0)], axis=1), np.full((144, 3), 10, np.uint8))
    asked: list[int] = []

    def planes(index: int) -> np.ndarray:
        asked.append(index)
        return np.full((3, 30, 40), 0.5, np.float32)

    made = first_gaussians([straight()] * 31, planes, points, 4000, 0, np.random.default_rng(0))
    assert asked == list(range(0, 31, 2)) and 2600 < len(made) <= 3200
    assert float((made.sh * SH_C0).abs().max()) < 1e-6, "no sparse point's own colour is among them"


def test_photos_that_show_too_few_points_leave_the_points_themselves() -> None:
    points = SparsePoints(np.array([[0.1 * i, 0.0, 5.0] for i in range(7)]), np.full((7, 3), 51, np.uint8))
    made = first_gaussians([straight()], lambda i: np.zeros((3, 30, 40)), points, 100, 0, np.random.default_rng(0))
    assert sorted(made.means[:, 0].tolist()) == pytest.approx([0.1 * i for i in range(7)])
    assert made.sh[:, 0].numpy() * SH_C0 + 0.5 == pytest.approx(0.2, abs=1e-6)
    few = first_gaussians([straight()], lambda i: np.zeros((3, 30, 40)), points, 5, 0, np.random.default_rng(0))
    assert len(few) == 4, "four fifths of the budget"


def test_the_mean_colour_of_photos() -> None:
    """Of the px that count, of either depth; of a photo without any, of all px; of many photos every so manieth."""
    eight, sixteen = np.full((4, 6, 3), 51, np.uint8), np.full((4, 6, 3), 65535, np.uint16)
    eight[:, :3] = 255
    mask = np.zeros((4, 6), bool)
    camera = replace(straight(), width=6, height=4)
    assert mean_colour([View(camera, eight)]).tolist() == pytest.approx([0.6] * 3)
    assert mean_colour([View(camera, eight, mask)]).tolist() == pytest.approx([0.6] * 3)
    half = mask.copy()
    half[:, 3:] = True
    assert mean_colour([View(camera, eight, half)]).tolist() == pytest.approx([0.2] * 3)
    assert mean_colour([View(camera, eight), View(camera, sixteen)]).tolist() == pytest.approx([0.8] * 3)
    black = View(camera, eight * 0)
    assert mean_colour([View(camera, sixteen), black] * 12).tolist() == [1.0] * 3, "24: every second one"
    assert mean_colour(([View(camera, sixteen), black] * 12)[:23]).tolist() == pytest.approx([12 / 23] * 3)


def test_what_is_not_said_of_a_training() -> None:
    said = TrainingSettings()
    assert (said.seed, said.threads, said.min_steps, said.deconvolved_sigma) == (0, 0, 0, 0.0)
    assert (said.grid_step, said.time_limit, said.until, said.noise_gain) == (None, None, None, None)
    assert (said.device, said.blur_evaluation, said.loss) == ("auto", "auto", "dgs")
    assert not PlannedTraining(said).enough and PlannedTraining(said).plan is None
    draft, fine = TrainingSettings.preset("draft"), TrainingSettings.preset("fine")
    assert draft.steps < said.steps < fine.steps and draft.max_gaussians < said.max_gaussians < fine.max_gaussians
    assert TrainingSettings.preset("balanced") == said


def test_a_checkpoint_belongs_to_its_settings_but_not_to_its_machine(trainer: Trainer) -> None:
    kept = fingerprint_of(trainer)
    free = {"threads", "time_limit", "device", "steps", "until", "min_steps"}
    assert not free & kept["settings"].keys() and kept["settings"]["seed"] == trainer.settings.seed
    assert kept["photos"] == [view.name for view in trainer.views] and kept["blur space"] == "srgb"
    psf = trainer.medium.psf
    assert psf is not None and sum(kept["point spread"]) == pytest.approx(1.0, abs=1e-7)
    np.testing.assert_allclose(kept["point spread"], psf.kernel().sum(axis=0), atol=1e-7)
    assert not {"own point spreads", "background", "effects"} & kept.keys()


def test_phases_of_a_run_begin_at_their_shares(trainer: Trainer, monkeypatch: pytest.MonkeyPatch) -> None:
    """Photos without their blur until the start's share, the photos themselves from there on; coarse likewise."""
    asked: list[str] = []
    level = replace(trainer.levels[-1], objectives={})

    class Asks:
        inverse = object()
        medium = trainer.objective(trainer.levels[-1], trainer.levels[-1].views[0]).medium

        def __getattr__(self, name: str) -> object:
            asked.append(name)
            return lambda image, photo, valid: LossAndGradient(0.5, torch.zeros_like(image))

    monkeypatch.setattr(trainer, "objective", lambda level, view: asked.append(f"step {level.step}") or Asks())
    monkeypatch.setattr(trainer, "levels", [replace(level, step=2), replace(level, step=1)])
    monkeypatch.setattr(trainer, "settings", replace(trainer.settings, coarse_share=0.25, start_share=0.5))
    for share in (0.0, 0.24, 0.25, 0.49, 0.5, 0.9):
        assert trainer.advance(share) == 0.5
    assert [name for name in asked if name.endswith("loss")] == ["start_loss"] * 4 + ["loss"] * 2
    steps = [name for name in asked if name.startswith("step")]
    assert steps[: len(steps) // 3] == ["step 2"] * (len(steps) // 3)
    assert set(steps[len(steps) // 3 :]) == {"step 1"}


# --- the objective, written out ----------------------------------------------------------------------------------


@pytest.mark.parametrize("space", ["srgb", "linear"])
@pytest.mark.parametrize("width", [0.25, 0.0])
@pytest.mark.parametrize("base", [0.3, 0.0])
def test_the_gradient_is_the_sum_of_what_is_written(space: str, width: float, base: float) -> None:
    """base * (MAE and SSIM) through the blur + variation + specks - what the inverse says is missing, pseudo-Huber."""
    random = torch.Generator().manual_seed(1)
    psf, m, (height, wide) = PointSpread("gaussian", 1.5, 1.5), 3, (20, 26)
    image = torch.rand((3, height + 2 * m, wide + 2 * m), generator=random) * 0.8 + 0.1
    photo = torch.rand((3, height, wide), generator=random)
    valid = torch.rand((height, wide), generator=random) > 0.2
    photo[1, 4, 5] = math.nan
    ratio = NoiseToSignal(np.full(BINS, 1e-3), np.full(BINS, 1e-2), 0.001)
    s = TrainingSettings(base_weight=base, inverse_width=width)
    made = Objective(psf, Frame(height, wide, m), space, s, CPU, ratio, 0.4)  # type: ignore[arg-type]
    found = made.loss(image, photo, valid)

    light = srgb_to_linear(image) if space == "linear" else image
    blurred = BlurOperator(psf, height, wide, m, CPU).apply(light)
    shown = linear_to_srgb(blurred) if space == "linear" else blurred
    loss, upstream = PhotometricLoss(photo, valid, s.ssim_weight).value_and_gradient(shown)
    n = photo.numel()
    wanted = base * made.medium.gradient(upstream, image) if base else torch.zeros_like(image)
    wanted = wanted + s.variation_weight / n * variation_gradient(image, s.variation_knee * 0.4)
    wanted = wanted + s.speck_weight / n * speck_gradient(image)
    rest = (srgb_to_linear(photo) if space == "linear" else photo) - blurred
    rest = torch.where(rest.isfinite() & valid, rest, 0.0)
    filters = [FourierFilter(psf, (height + 2 * m, wide + 2 * m), r, "wiener") for r in (1e-3, 1e-2)]
    padded = torch.nn.functional.pad(rest, (m, m, m, m))
    grey = padded.mean(dim=0, keepdim=True).expand(3, -1, -1)
    missing = filters[0].apply(grey) + filters[1].apply(padded - grey)
    if space == "linear":
        missing = missing / decoding_derivative(image, light).clamp(min=0.1)
    d = missing[:, m:-m, m:-m]
    d = d / (d**2 + (width * 0.4) ** 2).sqrt() if width else d.sign()
    wanted[:, m:-m, m:-m] -= s.inverse_weight / n * d * valid
    far = (d.abs() > 1e-3) if not width else torch.ones_like(d, dtype=torch.bool)
    torch.testing.assert_close(found.gradient[:, m:-m, m:-m][far], wanted[:, m:-m, m:-m][far], atol=2e-7, rtol=2e-3)
    assert found.loss == pytest.approx(loss if base else float(rest.abs().mean()), rel=1e-4)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_the_start_is_drawn_to_the_sharpened_photo(space: str) -> None:
    random = torch.Generator().manual_seed(2)
    psf, m, (height, wide) = PointSpread("gaussian", 1.5, 1.5), 3, (20, 26)
    image = torch.rand((3, height + 2 * m, wide + 2 * m), generator=random) * 0.8 + 0.1
    photo = torch.rand((3, height, wide), generator=random)
    valid = torch.rand((height, wide), generator=random) > 0.2
    ratio = NoiseToSignal(np.full(BINS, 1e-3), np.full(BINS, 1e-3), 0.001)
    s = TrainingSettings()
    made = Objective(psf, Frame(height, wide, m), space, s, CPU, ratio, 0.4)  # type: ignore[arg-type]
    found = made.start_loss(image, photo, valid)
    light = srgb_to_linear(photo) if space == "linear" else photo
    light = torch.where(valid, light, light[:, valid].mean(dim=1)[:, None, None])
    wide_light = torch.nn.functional.pad(light[None], (m, m, m, m), mode="replicate")[0]
    rest = torch.nn.functional.pad(light - BlurOperator(psf, height, wide, m, CPU).apply(wide_light), (m, m, m, m))
    inverse = FourierFilter(psf, (height + 2 * m, wide + 2 * m), 1e-3, "wiener")
    sharp = light + inverse.apply(rest)[:, m:-m, m:-m]
    sharp = linear_to_srgb(sharp.clamp(min=0.0)) if space == "linear" else sharp
    loss, inner = PhotometricLoss(sharp, valid, s.ssim_weight).value_and_gradient(image[:, m:-m, m:-m].contiguous())
    wanted = s.variation_weight / photo.numel() * variation_gradient(image, s.variation_knee * 0.4)
    wanted[:, m:-m, m:-m] += inner
    assert found.loss == pytest.approx(loss, rel=1e-4)
    torch.testing.assert_close(found.gradient, wanted, atol=2e-6, rtol=2e-3)
