"""The photo with another effect in the place of one, at the px that a step looks at."""

from __future__ import annotations

from types import SimpleNamespace

import pytest
import torch
from dgs.core.colour import linear_to_srgb
from dgs.core.forward.medium import medium_of
from dgs.core.frames import Frame
from dgs.core.imaging.formation.chain import Passage
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.focus import Focus, LensFocus
from dgs.core.imaging.psf import PointSpread
from dgs.core.training.optics.gauss_newton import LookedAt, shown_with

HEIGHT, WIDTH, MARGIN = 96, 131, 6


def exposed(psf: PointSpread | None, space: str, weights: tuple[float, ...]):
    """Light of frames with depths from 0.6 to 1.8, through a lens and then a medium."""
    torch.manual_seed(2)
    size = HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN
    effect = LensFocus(["a"], torch.tensor([0.02]), torch.tensor([1.0]))
    passages = []
    for weight in weights:
        shot = Shot("a", HEIGHT, WIDTH, MARGIN, depth=torch.rand(size) * 1.2 + 0.6)
        light = torch.rand(3, *size)
        behind = effect.forward(light, shot)
        frame = linear_to_srgb(light)
        passages.append((Passage(frame, shot, [effect], [light, behind], linear_to_srgb(behind)), weight))
    medium = medium_of(psf, Frame(HEIGHT, WIDTH, MARGIN), space)
    return SimpleNamespace(passages=passages, medium=medium, shot=passages[0][0].shot), effect


@pytest.mark.parametrize("space", ["srgb", "linear"])
@pytest.mark.parametrize("sigma", [None, 1.2])
@pytest.mark.parametrize("weights", [(1.0,), (0.3, 0.7)])
@pytest.mark.parametrize("looked_at", [20_000, 1_500])
def test_px_that_are_looked_at_are_those_of_the_whole_photo(space, sigma, weights, looked_at) -> None:
    psf = None if sigma is None else PointSpread(sigma_x=sigma, sigma_y=sigma)
    given, effect = exposed(psf, space, weights)
    at = LookedAt.of(HEIGHT, WIDTH, SimpleNamespace(looked_at=looked_at))
    for focus in (Focus(0.024, 1.0), Focus(0.02, 1.1), Focus(0.0, 1.0)):
        other = effect.alone("a", focus)
        with torch.no_grad():
            light = sum(other.forward(p.stages[0], p.shot) * weight for p, weight in given.passages)
            whole = given.medium.degraded(linear_to_srgb(light))
            some = shown_with(given, effect, other, at)
        assert some.shape == at.of_planes(whole).shape
        torch.testing.assert_close(some, at.of_planes(whole), rtol=0, atol=2e-6)
