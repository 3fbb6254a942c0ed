"""A photo by a lens out of focus: of the twin's layers where nothing else happens to the light, else of one picture."""

from dataclasses import dataclass

import numpy as np
import torch
from dgs.core.camera import Camera
from dgs.core.effects.haze import Haze
from dgs.core.forward import ForwardModel
from dgs.core.forward.medium import medium_of
from dgs.core.frames import Frame
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import RasterSettings, render

DEPTH = RasterSettings(depth=True)
CAMERA = Camera("photo", 96, 64, 80.0, 80.0, 48.0, 32.0, np.eye(3), np.zeros(3))
DIAGONAL = float(np.hypot(96, 64))


@dataclass(frozen=True)
class Photo:
    """What the forward model asks of one."""

    name: str = "photo"
    camera: Camera = CAMERA
    psf: PointSpread | None = None


def twig_before_a_wall() -> Gaussians:
    """A wall of speckles at 4, and an upright dark twig, a px or two wide, at 2."""
    random = torch.Generator().manual_seed(1)
    y, x = torch.meshgrid(torch.linspace(-2.2, 2.2, 40), torch.linspace(-3.2, 3.2, 60), indexing="ij")
    wall = torch.stack([x.ravel(), y.ravel(), torch.full((2400,), 4.0)], dim=1)
    twig = torch.tensor([[0.1, 0.0, 2.0]])
    scales = torch.cat([torch.full((2400, 3), -2.6), torch.tensor([[-4.2, 0.5, -4.2]])])
    colours = torch.cat([0.4 * torch.randn(2400, 1, 3, generator=random), torch.full((1, 1, 3), -1.6)])
    turns = torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(2401, 1)
    return Gaussians(torch.cat([wall, twig]), scales, turns, torch.full((2401,), 4.0), colours)


def lens(px: float) -> LensFocus:
    """Focused on the wall; the twig has a standard deviation of so many px."""
    return LensFocus(["photo"], torch.tensor([px / DIAGONAL / 0.25]), torch.tensor([0.25]))


def model(*effects: object) -> ForwardModel:
    frame = Frame(64, 96, 6)
    return ForwardModel(DEPTH, lambda _: medium_of(None, frame), 6, Formation(effects))  # type: ignore[arg-type]


def test_a_twig_out_of_focus_spreads_and_the_wall_shows_through() -> None:
    twin = twig_before_a_wall()
    sharp = render(twin, CAMERA, settings=DEPTH).image
    wall = render(Gaussians(*(tensor[:-1] for _, tensor in twin.named())), CAMERA, settings=DEPTH).image
    with torch.no_grad():
        exposed = model(lens(2.0)).expose(twin, Photo())
    assert exposed.layers is not None
    found, column = exposed.degraded, 52  # (where the twig stands)
    whole = float((wall - sharp)[:, 16:48, column].mean())
    left = float((wall - found)[:, 16:48, column].mean())
    beside = float((wall - found)[:, 16:48, column + 3].mean())
    assert whole > 0.2 and 0.1 * whole < left < 0.6 * whole and beside > 0.05 * whole
    torch.testing.assert_close(found[:, 16:48, 70:85], wall[:, 16:48, 70:85], atol=0.01, rtol=0)


def test_what_is_all_in_focus_or_not_yet_known_is_the_plain_picture() -> None:
    twin = twig_before_a_wall()
    plain = model().expose(twin, Photo()).reached
    for effect in (lens(0.1), LensFocus.unknown(["photo"])):
        exposed = model(effect).expose(twin, Photo())
        assert exposed.layers is None
        torch.testing.assert_close(exposed.reached, plain, atol=1e-6, rtol=1e-5)


def test_beside_other_effects_before_the_blur_it_is_one_picture() -> None:
    twin, haze = twig_before_a_wall(), Haze(torch.full((3,), 0.1), torch.full((3,), 0.7))
    assert model(haze, lens(2.0)).expose(twin, Photo()).layers is None


def test_gradients_are_those_of_differences_in_the_sharp_view_too() -> None:
    twin = twig_before_a_wall().requires_grad_()
    weights = torch.rand(2, 3, 76, 108, generator=torch.Generator().manual_seed(2))

    def loss(gaussians: Gaussians) -> float:
        with torch.no_grad():
            exposed = model(lens(2.0)).expose(gaussians, Photo())
        assert exposed.layers is not None
        return float((exposed.reached.double() * weights[0] + exposed.layers.view.image.double() * weights[1]).sum())

    model(lens(2.0)).expose(twin, Photo()).backward(weights[0], weights[1])
    for name, change in (("opacity_logits", 0.05), ("sh", 0.02), ("means", 2e-3)):
        tensor = getattr(twin, name)
        found = float(tensor.grad[-1].sum())
        ends = []
        for sign in (1, -1):
            moved = twin.detached()
            getattr(moved, name)[-1] += sign * change
            ends.append(loss(moved))
        assert abs(found - (ends[0] - ends[1]) / (2 * change)) < 0.05 * abs(found) + 0.05, name
