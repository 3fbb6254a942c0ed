"""Effects of lens and sensor on transparent photos: the white that is put behind them has never been through a lens."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from dgs.core.background import Background
from dgs.core.camera import Camera
from dgs.core.colour import linear_to_srgb, srgb_to_linear
from dgs.core.compositing import blended, under
from dgs.core.effects.registry import effect_named
from dgs.core.effects.vignetting import Vignetting
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Shot
from dgs.core.pipeline.effects.corrected import corrected, over_filed
from dgs.core.pipeline.effects.matched import matched_psnr
from dgs.core.views import View

HEIGHT, WIDTH = 60, 80
CAMERA = Camera("a", WIDTH, HEIGHT, 90.0, 90.0, WIDTH / 2, HEIGHT / 2, np.eye(3), np.zeros(3))
SHOT = Shot("a", HEIGHT, WIDTH, middle=(CAMERA.cx, CAMERA.cy))
DARKENED = Formation([Vignetting(torch.tensor([0.5] * 3))])


def straight_and_alpha() -> tuple[np.ndarray, np.ndarray]:
    """Colours [3, H, W] and alpha [H, W] of a disc that reaches into a corner, half transparent at its rim."""
    y, x = np.mgrid[:HEIGHT, :WIDTH].astype(np.float32)
    alpha = np.clip((34 - np.hypot(x - 22, y - 20)) / 6, 0, 1).astype(np.float32)
    return np.stack([0.3 + 0.3 * np.sin(x / 9), 0.5 + 0.2 * np.cos(y / 7), np.full_like(x, 0.4)]), alpha


def filed_view(colours: np.ndarray, alpha: np.ndarray, background: Background) -> View:
    """A file's 16 bits of what the lens made of the colours."""
    filed = DARKENED.filed(torch.from_numpy(colours), SHOT).numpy()
    sixteen = np.round(filed * 65535).astype(np.uint16).transpose(1, 2, 0)
    share = np.round(alpha * 65535).astype(np.uint16)
    return View(CAMERA, under(background, sixteen, share), alpha=share, background=background)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_vignetting_is_undone_on_the_object_and_not_on_its_background(space) -> None:
    (colours, alpha), background = straight_and_alpha(), Background(space=space)
    (fixed,) = corrected([filed_view(colours, alpha, background)], DARKENED)
    truth = blended(background, colours, 1 - alpha)
    assert fixed.mask is None and np.abs(fixed.planes() - truth).max() < 2e-3
    assert np.abs(fixed.transparency() - (1 - alpha)).max() < 2e-5


def test_a_filed_photo_over_its_filed_background_is_the_filed_render() -> None:
    (colours, alpha), background = straight_and_alpha(), Background(space="linear")
    view = filed_view(colours, alpha, background)
    render = blended(background, colours, 1 - alpha)
    seen = over_filed(view.planes(), view.transparency(), background, DARKENED, SHOT)
    assert np.abs(seen - DARKENED.filed(torch.from_numpy(render), SHOT).numpy()).max() < 1e-3
    assert over_filed(view.planes(), None, None, DARKENED, SHOT) is not None


def test_a_photos_own_gain_is_not_that_of_its_background() -> None:
    (colours, alpha), background = straight_and_alpha(), Background()
    photo = blended(background, colours, 1 - alpha)
    brighter = np.asarray(linear_to_srgb(1.3 * srgb_to_linear(colours)), np.float32)
    render = blended(background, brighter, 1 - alpha)
    behind = alpha < 0.5
    assert matched_psnr(render, photo, None, behind) > matched_psnr(render, photo) + 10
    assert matched_psnr(render, photo, None, np.zeros_like(behind)) == matched_psnr(render, photo)


def test_the_background_is_no_clipped_highlight() -> None:
    (colours, alpha), background = straight_and_alpha(), Background()
    colours[:, 20:24, 20:24] = 1.0  # a highlight
    sixteen = np.round(colours * 65535).astype(np.uint16).transpose(1, 2, 0)
    share = np.round(alpha * 65535).astype(np.uint16)
    view = View(CAMERA, under(background, sixteen, share), alpha=share, background=background)
    spec = effect_named("saturation")
    assert spec is not None and spec.switch is not None
    (masked,) = corrected([view], Formation(), [spec.switch])
    assert masked.mask is not None and not masked.mask[20:24, 20:24].any() and masked.mask.sum() == alpha.size - 16
