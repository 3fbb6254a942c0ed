"""First Gaussians, grids, footprints, and the variation's gradient."""

import math

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.constants import SH_C0
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.density.footprint import widened
from dgs.core.training.density.initial import INITIAL, first_gaussians
from dgs.core.training.grid import averaged, coarse_camera, grid_step
from dgs.core.training.loss.specks import speck_gradient, speck_price
from dgs.core.training.loss.variation import SMOOTH, variation_gradient
from dgs.core.views import SparsePoints
from dgs.tests.core.training.training_scenes import HEIGHT, WIDTH, camera_at, coloured_plane


def project(camera, points):
    p = points @ camera.rotation.T + camera.translation
    return p[:, :2] / p[:, 2:] * (camera.fx, camera.fy) + (camera.cx, camera.cy)


@pytest.mark.parametrize("step", [2, 3, 5])
def test_a_point_lands_at_the_same_place_of_a_coarse_grid(step):
    camera = camera_at(0.4, -0.2, "a")
    points = np.random.default_rng(0).normal(size=(50, 3))
    assert np.allclose(project(coarse_camera(camera, step), points), project(camera, points) / step, atol=1e-9)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_averaged(space):
    planes = np.random.default_rng(0).random((3, 7, 8)).astype(np.float32)
    out = averaged(planes, 2, space)
    assert out.shape == (3, 3, 4)
    block = planes[1, 2:4, 4:6].astype(np.float64)
    if space == "linear":
        expected = linear_to_srgb(np.asarray(srgb_to_linear(block)).mean(keepdims=True)[0])
    else:
        expected = block.mean()
    assert out[1, 1, 2] == pytest.approx(float(np.ravel(expected)[0]), abs=1e-6)
    assert averaged(planes, 1, space) is planes


def test_grid_follows_the_narrowest_blur_and_keeps_small_frames():
    medium = Medium(PointSpread("gaussian", 5.0, 5.0))
    assert grid_step(medium, 800, 533) == 2
    assert grid_step(medium, 150, 120) == 1
    assert grid_step(Medium(None), 800, 533) == 1
    mixed = Medium(PointSpread("gaussian", 5.0, 5.0), per_view={"sharp.png": None})
    assert grid_step(mixed, 800, 533) == 1


def start(positions, budget=400):
    cameras = [camera_at(x, 0.0, f"{x}") for x in (-0.5, 0.0, 0.5)]
    image = np.random.default_rng(1).random((3, HEIGHT, WIDTH)).astype(np.float32)
    colours = np.full((len(positions), 3), 90, np.uint8)
    points = SparsePoints(positions, colours)
    return first_gaussians(cameras, lambda i: image, points, budget, 1, np.random.default_rng(0), 4.0)


@pytest.mark.parametrize("count", [1, 2, 7, 8, 60, 3000])
def test_first_gaussians_stay_within_the_budget(count):
    positions = np.random.default_rng(2).normal(size=(count, 3)) * [0.8, 0.6, 0.1]
    gaussians = start(positions)
    assert 1 <= len(gaussians) <= 400
    assert all(bool(torch.isfinite(tensor).all()) for _, tensor in gaussians.named())
    if count >= 60:
        assert len(gaussians) >= 200, "where depth is known, the frames are filled"


@pytest.mark.parametrize("spread", [[1.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
def test_first_gaussians_of_points_on_a_line_or_at_one_place(spread):
    positions = np.linspace(-0.8, 0.8, 40)[:, None] * np.array(spread)
    gaussians = start(positions)
    assert 1 <= len(gaussians) <= 400
    assert all(bool(torch.isfinite(tensor).all()) for _, tensor in gaussians.named())


def test_first_gaussians_lie_on_the_surface_between_the_points():
    random = np.random.default_rng(3)
    positions = np.concatenate([random.uniform(-2.5, 2.5, (300, 2)), np.zeros((300, 1))], axis=1)
    gaussians = start(positions)
    depth = gaussians.means[:, 2].abs().numpy()
    # beyond the outermost points of a frame the nearest depth stands in
    assert float(np.median(depth)) < 1e-6 and float(np.quantile(depth, 0.9)) < 0.05


@pytest.mark.parametrize("low_pass", [0.3, 1.0, 3.0])
def test_widened_twin_looks_in_viewers_as_it_did_in_training(low_pass):
    truth, camera = coloured_plane(), camera_at(0.1, 0.0, "a")
    trained = render(truth, camera, settings=RasterSettings(low_pass=low_pass)).image
    seen = render(widened(truth, [camera], low_pass), camera, settings=RasterSettings(low_pass=0.3)).image
    error = float((seen - trained).square().mean().sqrt())
    # one size of pixel per Gaussian stands for a pixel's size along both axes of a tilted, bumpy plane
    assert error < 0.01
    if low_pass > 0.3:
        unchanged = render(truth, camera, settings=RasterSettings(low_pass=0.3)).image
        assert error < 0.25 * float((unchanged - trained).square().mean().sqrt())


@pytest.mark.parametrize("knee", [math.inf, 0.1])
@pytest.mark.parametrize("size", [(2, 2), (9, 7), (40, 60)])
def test_variation_gradient_is_that_of_its_formula(size, knee):
    image = torch.rand(3, *size, generator=torch.Generator().manual_seed(0))
    image[:, : size[0] // 2] = 0.5  # flat parts, where the root is smoothed
    leaf = image.double().requires_grad_()
    right = leaf[:, :, 1:] - leaf[:, :, :-1]
    down = torch.nn.functional.pad(leaf[:, 1:, :-1] - leaf[:, :-1, :-1], (0, 0, 0, 1))
    each = (right.square().sum(0) + down.square().sum(0) + SMOOTH**2).sqrt()
    total = (each if math.isinf(knee) else knee * torch.log1p(each / knee)).sum()
    (expected,) = torch.autograd.grad(total, leaf)
    found = variation_gradient(image, knee)
    assert found.shape == image.shape and float(found.abs().max()) <= 4
    torch.testing.assert_close(found.double(), expected, rtol=1e-4, atol=1e-4)


@pytest.mark.parametrize("size", [(2, 2), (9, 7), (40, 60)])
def test_speck_gradient_is_that_of_its_formula(size):
    image = torch.rand(3, *size, generator=torch.Generator().manual_seed(0))
    image[:, : size[0] // 2] = 0.5
    leaf = image.double().requires_grad_()
    (expected,) = torch.autograd.grad(speck_price(leaf), leaf)
    for _ in range(2):  # the passes' memory is kept: nothing of the first call may be left in the second
        torch.testing.assert_close(speck_gradient(image).double(), expected, rtol=1e-3, atol=1e-4)


def test_specks_cost_and_lines_do_not():
    def price(marked: torch.Tensor) -> float:
        return float(speck_price(marked) - speck_price(torch.full((3, 24, 24), 0.5)))

    speck, line, edge = (torch.full((3, 24, 24), 0.5, dtype=torch.float64) for _ in range(3))
    speck[:, 10:12, 10:12] = 0.9
    line[:, :, 10:12] = 0.9
    edge[:, 12:] = 0.9
    assert price(speck) > 1.0
    assert abs(price(line)) < 1e-6 and abs(price(edge)) < 1e-6


def test_dense_samples_are_first_gaussians_themselves():
    """No px is lifted: Gaussians stand where the samples are, the surer the more opaque, in the samples' colours."""
    random = np.random.default_rng(3)
    positions = random.uniform(-1, 1, (50, 3))
    colours = random.integers(0, 256, (50, 3), dtype=np.uint8)
    sure = np.linspace(0.02, 1.0, 50).astype(np.float32)
    points = SparsePoints(positions, colours, sure)

    def unasked(_):
        raise AssertionError("photos are not asked")

    found = first_gaussians([], unasked, points, 100, 0, random)
    assert np.allclose(found.means.numpy(), positions, atol=1e-6)
    assert np.allclose(found.sh[:, 0].numpy() * SH_C0 + 0.5, colours / 255.0, atol=1e-6)
    opacity = torch.sigmoid(found.opacity_logits).numpy()
    assert (np.diff(opacity) > 0).all() and abs(opacity[-1] - INITIAL.opacity) < 1e-6 and opacity[0] < 0.07


def test_more_samples_than_the_budget_holds_are_thinned():
    random = np.random.default_rng(3)
    points = SparsePoints(random.uniform(-1, 1, (500, 3)), np.zeros((500, 3), np.uint8), np.ones(500, np.float32))
    found = first_gaussians([], lambda _: np.zeros((3, 1, 1), np.float32), points, 100, 0, random)
    assert len(found) == int(100 * INITIAL.budget_share)
