"""Transparent photos on the grid, and twins that are empty where their photos are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.background import WHITE, Background
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.compositing import unblended, under
from dgs.core.constants import SH_C0
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.exposure import Exposure
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings, Rendered, render
from dgs.core.training.grid import GridView, coarse_view
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import fingerprint_of
from dgs.core.training.run import Trained, train
from dgs.core.training.trainer import Trainer
from dgs.core.views import SparsePoints, View
from dgs.tests.core.training.training_scenes import SHORT, Scene, camera_at, coloured_plane, psnr

CAMERA = Camera("a", 48, 48, 60.0, 60.0, 24.0, 24.0, np.eye(3), np.zeros(3))
BLACK = (0.0, 0.0, 0.0)


def red_disc(dtype: type) -> View:
    """A red disc over white, sharp to the px, black under its alpha of 0 in the file."""
    top = int(np.iinfo(dtype).max)
    y, x = np.mgrid[:48, :48]
    disc = (x - 23.3) ** 2 + (y - 24.1) ** 2 < 15**2
    straight, alpha = np.zeros((48, 48, 3), dtype), np.where(disc, top, 0).astype(dtype)
    straight[disc] = [top, 0, 0]
    background = Background()
    return View(CAMERA, under(background, straight, alpha), alpha=alpha, background=background)


def test_empty_px_are_lifted_into_no_gaussian() -> None:
    """Where alpha is 0, and where a plain background shows; the others are drawn more densely."""
    x, y = (plane.ravel() for plane in np.meshgrid(np.linspace(-2, 2, 12), np.linspace(-2, 2, 12)))
    points = SparsePoints(np.stack([x, y, np.full(144, 4.0)], axis=1), np.full((144, 3), 255, np.uint8))
    transparent = red_disc(np.uint8)
    plain = replace(transparent, alpha=None, background=Background(WHITE, tolerance=4.0 / 255))
    for view in (transparent, plain):
        made = Trainer([view], [], points, Medium(), replace(SHORT, max_gaussians=400)).result()
        p = made.means.double().numpy()
        column, row = (p[:, :2] / p[:, 2:] * 60.0 + 24.0).T
        assert 150 < len(made) <= 400
        assert ((column - 23.8) ** 2 + (row - 24.6) ** 2 < 16.5**2).all()
    opaque = Trainer(
        [replace(plain, background=None)], [], points, Medium(), replace(SHORT, max_gaussians=400)
    ).result()
    far = opaque.means[:, :2].abs().max(dim=1).values > 1.2
    assert int(far.sum()) > 50, "of an opaque photo every px is"


@pytest.mark.parametrize("dtype", [np.uint8, np.uint16])
@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_no_rim_in_the_average(dtype: type, space: str) -> None:
    view = red_disc(dtype)
    view = replace(view, background=Background(WHITE, space))
    for grid in (GridView(view, CAMERA, 3, None, space), GridView(coarse_view(view, 3, space), CAMERA, 1, None, space)):
        over_white, over_red, over_black = (grid.over(c) for c in (WHITE, (1.0, 0.0, 0.0), BLACK))
        np.testing.assert_allclose(over_white, grid.planes(), atol=1e-4)
        assert over_white[0].min() > 0.999  # red over white is red or white: no px has less red
        assert np.abs(over_red - np.array([1.0, 0.0, 0.0])[:, None, None]).max() < 3e-4 * (
            13 if space == "linear" else 1
        )
        assert np.abs(over_black[1:]).max() < 3e-4 * (13 if space == "linear" else 1)
        assert 0.3 < over_black[0].mean() < 0.4  # the disc's share


def test_an_opaque_photo_is_the_same_over_any_colour() -> None:
    view = replace(red_disc(np.uint8), alpha=None)
    grid = GridView(view, CAMERA, 2, None, "srgb")
    np.testing.assert_array_equal(grid.over(BLACK), grid.planes())


#: With fewer, what was lifted into free space is not gone yet.
SETTINGS = replace(SHORT, steps=400)
COUNT = 8


def disc_scene(sigma: float) -> Scene:
    """RGBA photos (8 bit, alpha as files have it) of a round piece of the plane, before nothing."""
    plane = coloured_plane()
    near = torch.linalg.vector_norm(plane.means[:, :2], dim=1) < 0.8
    truth = Gaussians(**{name: tensor[near] for name, tensor in plane.named()})
    psf = PointSpread("gaussian", sigma, sigma) if sigma else None
    views = []
    for index in range(COUNT):
        angle = 2 * np.pi * index / COUNT
        camera = camera_at(0.6 * np.cos(angle), 0.4 * np.sin(angle), f"view{index:02d}.png")
        premultiplied, alpha = through(truth, camera, psf, (0.0, 0.0, 0.0))
        straight = np.where(alpha > 0, premultiplied / np.maximum(alpha, 1e-6), 0.0).clip(0, 1)
        eight = np.round(straight * 255).astype(np.uint8).transpose(1, 2, 0).copy()
        filed = np.round(alpha * 255).astype(np.uint8)
        background = Background()
        views.append(View(camera, under(background, eight, filed), alpha=filed, background=background))
    chosen = np.random.default_rng(0).permutation(len(truth))[:200]
    points = truth.means.numpy()[chosen].astype(np.float64)
    colours = np.clip((truth.sh[chosen, 0].numpy() * SH_C0 + 0.5) * 255, 0, 255).astype(np.uint8)
    return Scene(truth, views, {}, SparsePoints(points, colours), Medium(psf))


def through(
    truth: Gaussians, camera: Camera, psf: PointSpread | None, colour: tuple[float, float, float]
) -> tuple[np.ndarray, np.ndarray]:
    """[3, H, W] what the camera takes over a colour, and its alpha [H, W]; both through the same blur."""
    margin = 0 if psf is None else max(psf.radius)
    with torch.no_grad():
        seen = render(truth, camera.with_margin(margin), background=torch.tensor(colour), backend="cpu")
        blur = BlurOperator(psf, camera.height, camera.width, margin, seen.image.device)
        alpha = blur.apply(seen.alpha.expand(3, -1, -1).contiguous())[0]
        return blur.apply(seen.image).numpy(), alpha.numpy().clip(0, 1)


def trained_on(scene: Scene, views: list[View]) -> Trained:
    return train(TrainingJob(views[1:], views[:1], scene.points, scene.medium, SETTINGS), Silent())


def sharp(trained: Trained, camera: Camera, colour: tuple[float, float, float]) -> Rendered:
    with torch.no_grad():
        settings = RasterSettings(low_pass=trained.low_pass)
        return render(trained.gaussians, camera, background=torch.tensor(colour), settings=settings, backend="cpu")


def test_a_twin_of_transparent_photos_is_empty_where_they_are() -> None:
    """Blurred ones: as good over white as the twin of the same photos put over white, and as good over black."""
    scene = disc_scene(2.0)
    as_pictures = [replace(view, alpha=None) for view in scene.views]
    transparent, plain = trained_on(scene, scene.views), trained_on(scene, as_pictures)
    assert transparent.background == plain.background == WHITE
    camera = scene.views[0].camera  # held out
    over_white, over_black = (through(scene.truth, camera, None, colour)[0] for colour in (WHITE, BLACK))
    found = psnr(sharp(transparent, camera, WHITE).image.numpy(), over_white)
    # (single trainings of either scatter by 0.3 dB)
    assert found > psnr(sharp(plain, camera, WHITE).image.numpy(), over_white) - 0.5
    assert psnr(sharp(transparent, camera, BLACK).image.numpy(), over_black) > found - 3.0
    _, alpha = through(scene.truth, camera, None, BLACK)
    assert np.abs(sharp(transparent, camera, BLACK).alpha.numpy() - alpha).mean() < 0.03


def test_the_backdrop_of_opaque_photos_is_as_it_was() -> None:
    scene = disc_scene(0.0)
    opaque = [replace(view, alpha=None, background=None) for view in scene.views]
    made = Trainer(opaque, [], scene.points, scene.medium, SETTINGS)
    shake = SETTINGS.backdrop * np.random.default_rng([SETTINGS.seed, 3, 0]).uniform(-1, 1, 3)
    np.testing.assert_array_equal(made.backdrop(), made.background + torch.from_numpy(shake).float())
    assert "background" not in fingerprint_of(made)
    other = Trainer(scene.views, [], scene.points, scene.medium, SETTINGS)
    assert fingerprint_of(other)["background"] == [1.0, 1.0, 1.0, "srgb"]
    drawn = torch.stack([other.backdrop() for other.step in range(60)])
    assert float(drawn.min()) < 0.05 and float(drawn.max()) > 0.95 and float(drawn.min()) >= 0.0


def test_exposures_are_those_of_the_object_and_not_of_what_is_behind_it() -> None:
    scene = disc_scene(0.0)
    gains = np.random.default_rng(2).uniform(-0.5, 0.5, COUNT)
    gains -= gains.mean()
    views = []
    for view, gain in zip(scene.views, gains, strict=True):
        straight = unblended(Background(), view.planes(), view.transparency())
        filed = linear_to_srgb(srgb_to_linear(straight.astype(np.float64)) * np.exp(gain)).clip(0, 1)
        eight = np.round(filed * 255).astype(np.uint8).transpose(1, 2, 0).copy()
        views.append(replace(view, photo=under(Background(), eight, view.alpha)))
    start = Exposure([view.name for view in views], torch.zeros(COUNT, 3))
    trainer = Trainer(views, [], scene.points, scene.medium, replace(SHORT, steps=160), Formation([start]))
    for step in range(160):
        trainer.advance(step / 160)
    (learned,) = trainer.learned.chain().effects
    assert np.std(learned.parameters["log_gains"].numpy() - gains[:, None]) < 0.06 < 0.2 < np.std(gains)
    with torch.no_grad():
        drawn = render(trainer.optimizer.gaussians, trainer.levels[-1].views[0].camera, backend="cpu")
    assert float(drawn.alpha[..., :10, :10].mean()) < 0.2  # the corner is still empty
