"""Learned kernels: what they find, what the twin gains, and what is kept of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.errors import CheckpointError
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.kernel_convolution import convolved, kernel_of, seen_through_tents
from dgs.core.imaging.formation.kernels import KERNELS, PhotoKernels
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.optics.kernels import best_weights
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import HEIGHT, SHORT, WIDTH, blurred_scene

DIAGONAL = float(np.hypot(WIDTH, HEIGHT))
#: Px between tents of a photo as large as the scene's.
PITCH = KERNELS.pitch * DIAGONAL
MIDDLE = KERNELS.side // 2


def double_image(seed: int) -> np.ndarray:
    """[1 + side^2] a point seen twice, in a direction of its own: no camera's path and no lens does that."""
    angle = np.random.default_rng(seed).uniform(0, np.pi)
    squares = np.zeros((KERNELS.side, KERNELS.side))
    for way in (-3.4, 3.4):
        x, y = way * np.cos(angle) + MIDDLE, way * np.sin(angle) + MIDDLE
        for row in (int(y), int(y) + 1):
            for column in (int(x), int(x) + 1):
                squares[row, column] += (1 - abs(x - column)) * (1 - abs(y - row)) / 2
    return np.concatenate([[0.0], squares.ravel()])


def variance_along(weights: np.ndarray) -> np.ndarray:
    """[2, 2] covariance of a kernel, in squared distances between tents."""
    line = np.arange(KERNELS.side) - MIDDLE
    at = np.stack([column.ravel() for column in np.meshgrid(line, line)], axis=1)
    return (at * weights[1:, None]).T @ at


@pytest.fixture(scope="module")
def scene():
    """All but the last two photos show everything twice."""
    flat = blurred_scene(sigma=0.0)
    views = []
    for i, view in enumerate(flat.views):
        if i < len(flat.views) - 2:
            light = srgb_to_linear(torch.from_numpy(view.planes()))
            kernel = kernel_of(torch.from_numpy(double_image(i)).float(), KERNELS.side, PITCH)
            radius = len(kernel) // 2
            wide = torch.nn.functional.pad(light[None], (radius,) * 4, mode="replicate")[0]
            seen = convolved(wide, kernel)[:, radius:-radius, radius:-radius]
            photo = np.round(linear_to_srgb(seen).clamp(0, 1).numpy() * 255).astype(np.uint8).transpose(1, 2, 0)
            view = replace(view, photo=np.ascontiguousarray(photo))
        views.append(view)
    return replace(flat, views=views)


def start(views):
    return Formation([PhotoKernels.sharp([view.name for view in views])])


def test_the_best_kernel_of_a_photo_is_found_from_what_it_shows():
    """Light through tents, mixed by known weights: the least squares are those weights again."""
    random = torch.Generator().manual_seed(0)
    light = torch.rand(3, 70, 70, generator=random, dtype=torch.float64)
    true = double_image(3)
    seen = seen_through_tents(light, 10, KERNELS.side, 1.5, 1).transpose(0, 1).reshape(len(true), -1).numpy()
    trust = 1e6 / seen.shape[1]
    found = best_weights(trust * seen @ seen.T, trust * seen @ (true @ seen))
    assert np.abs(found - true).max() < 1e-3
    assert (found >= 0).all() and found.sum() == pytest.approx(1.0)


def test_nothing_is_made_of_a_photo_without_detail():
    """A grey wall shows no kernel: the price of width leaves it sharp."""
    seen = np.full((1 + KERNELS.side**2, 100), 0.3)
    found = best_weights(seen @ seen.T, seen @ np.full(100, 0.3))
    assert found is not None and found[0] + found[1 + KERNELS.side * MIDDLE + MIDDLE] == pytest.approx(1.0, abs=1e-3)


def test_the_middle_of_a_kernel_stays():
    """What only a camera elsewhere would explain is left to the cameras."""
    random = torch.Generator().manual_seed(1)
    light = torch.rand(3, 70, 70, generator=random, dtype=torch.float64)
    seen = seen_through_tents(light, 10, KERNELS.side, 1.5, 1).transpose(0, 1).reshape(82, -1).numpy()
    beside = np.zeros(82)
    beside[1 + KERNELS.side * MIDDLE + MIDDLE + 2] = 1.0
    found = best_weights(seen @ seen.T, seen @ (beside @ seen))
    line = np.arange(KERNELS.side) - MIDDLE
    assert abs(found[1:].reshape(KERNELS.side, KERNELS.side).sum(axis=0) @ line) < 0.05


def test_kernels_are_found_and_the_twin_is_sharper_for_it(scene):
    fitted, held = scene.views[:-2], scene.views[-2:]
    settings, errors = replace(SHORT, steps=180, coarse_share=0.0), []
    for chain in (Formation(), start(scene.views)):
        twin = train(TrainingJob(fitted, held, scene.points, Medium(), settings, chain), Silent())
        with torch.no_grad():
            shown = [
                render(twin.gaussians, v.camera, background=None, settings=RasterSettings(low_pass=twin.low_pass)).image
                for v in held
            ]
        photos = [torch.from_numpy(view.planes()) for view in held]
        errors.append(np.mean([float((s - photo).square().mean()) for s, photo in zip(shown, photos, strict=True)]))
    gain = 10 * np.log10(errors[0] / errors[1])
    assert gain > 1.0, errors
    found = twin.formation.kernels
    for i, view in enumerate(fitted):
        weights = found.parameters["weights"][found.row_of(view.name)].numpy().astype(float)
        true, own = variance_along(double_image(i)), variance_along(weights)
        direction = np.linalg.eigh(true)[1][:, -1]
        assert abs(np.linalg.eigh(own)[1][:, -1] @ direction) > 0.9, view.name
        assert (weights >= 0).all() and weights.sum() == pytest.approx(1.0, abs=1e-4)
    widths = found.widths()
    assert max(widths[v.name] for v in held) < 0.5 * np.median([widths[v.name] for v in fitted])
    described = found.described()
    for part in ("photos", "errors", "widths"):
        assert set(described[part]) == {v.name for v in scene.views}
    for name, (width, least, most) in described["widths"].items():
        assert least <= width <= most and width == pytest.approx(widths[name], abs=2e-5)
        assert most > least, "no width is known exactly"


def test_a_run_that_is_resumed_goes_on_to_the_bit(scene):
    def trainer():
        return Trainer(scene.views[:-2], [], scene.points, Medium(), SHORT, start(scene.views[:-2]))

    whole, first, again = trainer(), trainer(), trainer()
    for step in range(16):
        whole.advance(step / 40)
        if step < 8:
            first.advance(step / 40)
    restore(again, checkpoint_of(first, 0.0, []))
    for step in range(8, 16):
        again.advance(step / 40)
    a, b = (t.learned.kernels.effect.parameters["weights"] for t in (whole, again))
    assert float(a[:, 0].min()) < 1.0 and torch.equal(a, b)
    assert torch.equal(whole.optimizer.gaussians.means, again.optimizer.gaussians.means)
    state = checkpoint_of(first, 0.0, [])
    del state.arrays["kernels"]
    with pytest.raises(CheckpointError, match="kernels"):
        restore(trainer(), state)
