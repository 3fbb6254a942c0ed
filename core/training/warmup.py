"""Compiles the numba kernels, or loads them from the disk cache, before the clock of training runs."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import torch

from ..camera import Camera
from ..constants import SH_COEFFICIENTS
from ..forward import ForwardModel, medium_of
from ..frames import Frame
from ..gaussians import Gaussians
from ..imaging.psf import PointSpread
from ..rasterizer import RasterSettings
from .loss.photometric import PhotometricLoss
from .loss.specks import speck_gradient
from .loss.variation import variation_gradient
from .optimizer import Adam
from .settings import Rates


class _View(NamedTuple):
    name: str
    camera: Camera
    psf: PointSpread | None


def compile_kernels(sh_degree: int = 1) -> None:
    """One tiny iteration through every kernel that training uses on the CPU."""
    side = 48
    camera = Camera("warm-up", side, side, side, side, side / 2, side / 2, np.eye(3), np.zeros(3))
    gaussians = Gaussians(
        means=torch.tensor([[0.0, 0.0, 2.0], [0.1, 0.0, 2.0]]),
        log_scales=torch.full((2, 3), -2.0),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]] * 2),
        opacity_logits=torch.zeros(2),
        sh=torch.zeros(2, SH_COEFFICIENTS[sh_degree], 3),
    )
    optimizer = Adam(gaussians)
    psf = PointSpread("gaussian", 1.0, 1.0)
    medium = medium_of(psf, Frame(side, side, 0), evaluation="separable")
    exposed = ForwardModel(RasterSettings(), lambda _: medium).expose(
        optimizer.gaussians, _View("warm-up", camera, psf)
    )
    sharp = exposed.reached
    _, upstream = PhotometricLoss(torch.zeros(3, side, side)).value_and_gradient(exposed.degraded)
    exposed.backward(medium.gradient(upstream, sharp) + variation_gradient(sharp) + speck_gradient(sharp))
    rates = Rates()
    optimizer.step(
        {
            name: getattr(rates, name)
            for name in ("means", "log_scales", "quaternions", "opacity_logits", "sh", "sh_rest")
        }
    )
