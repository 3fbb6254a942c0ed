"""Why a Gaussian is left out: each limit by itself, on both sides of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.constants import ALPHA_MINIMUM, FAR_PLANE, HARMONICS_LIMIT
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render

from .rasterizer_scenes import make_camera, single

CAMERA = make_camera()


def reasons(gaussians: Gaussians, backend: str, settings: RasterSettings = RasterSettings()) -> dict[str, int]:
    culled = render(gaussians, CAMERA, settings=settings, backend=backend).screen.culled
    return {reason: count for reason, count in culled.items() if count}


def before(distance: float, **changes: float) -> Gaussians:
    """A Gaussian on the axis of the camera."""
    at = CAMERA.centre + CAMERA.rotation[2] * distance
    return single(tuple(float(v) for v in at), changes.get("scale", 0.1), changes.get("logit", 2.0))


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize(("factor", "seen"), [(0.5, True), (2.0, False)])
def test_what_lies_behind_the_far_plane(backend: str, factor: float, seen: bool) -> None:
    distance = FAR_PLANE * factor
    assert reasons(before(distance, scale=0.05 * distance), backend) == ({} if seen else {"degenerate": 1})


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize(("factor", "seen"), [(0.9, True), (1.1, False)])
def test_colours_beyond_their_limit(backend: str, factor: float, seen: bool) -> None:
    one = before(4.0)
    sh = torch.full((1, 1, 3), HARMONICS_LIMIT * factor / 3**0.5)
    assert reasons(replace(one, sh=sh), backend) == ({} if seen else {"degenerate": 1})


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize(("factor", "seen"), [(2.0, True), (0.2, False)])
def test_covariances_that_cannot_be_inverted(backend: str, factor: float, seen: bool) -> None:
    """Without a low-pass; round, so that the determinant is the fourth power of the spread in px: 1e-10 of 0.0032."""
    spread = 1e-10**0.25 * factor**0.25
    one = before(4.0, scale=spread * 4.0 / float(np.mean([CAMERA.fx, CAMERA.fy])), logit=4.0)
    found = reasons(one, backend, RasterSettings(low_pass=0.0))
    assert found.get("degenerate", 0) == (0 if seen else 1)


@pytest.mark.parametrize("backend", ["reference", "cpu"])
@pytest.mark.parametrize("factor", [0.95, 0.7, 0.1])
def test_who_is_too_faint_is_transparent_and_nothing_else(backend: str, factor: float) -> None:
    opacity = ALPHA_MINIMUM * factor
    assert reasons(before(4.0, logit=float(np.log(opacity / (1 - opacity)))), backend) == {"transparent": 1}
