"""Free kernels of photos: wider than the photo, of nothing, of photos that are not numbers, of lamps."""

from __future__ import annotations

import math

import numpy as np
import torch
from torch import Tensor

from ...core.forward import Exposed, ForwardModel, medium_of
from ...core.forward.sampling import margin_for
from ...core.frames import Frame
from ...core.imaging.formation.chain import Formation
from ...core.imaging.formation.kernel_convolution import convolved, gradients, kernel_of, places
from ...core.imaging.formation.kernels import KERNELS, PhotoKernels
from ...core.imaging.psf import PointSpread
from ...core.rasterizer import RasterSettings
from ...core.training.optics.kernels import LearnedKernels, best_weights
from .case import Site, case
from .scenes import make_camera, random_scene

#: Tents of a kernel, and the light as it is.
_WEIGHTS = 1 + KERNELS.side**2


class _Photo:
    """What the forward model asks of a photo."""

    psf: PointSpread | None = None

    def __init__(self) -> None:
        self.camera = make_camera()
        self.name = self.camera.name


def _random_weights(seed: int) -> Tensor:
    """[K] in double precision, none below 0, their sum 1."""
    weights = torch.rand(_WEIGHTS, generator=torch.Generator().manual_seed(seed), dtype=torch.float64)
    return weights / weights.sum()


def _learning() -> tuple[LearnedKernels, Exposed, _Photo]:
    """A kernel that is being learned, and what the forward model shows with it."""
    photo = _Photo()
    learned = LearnedKernels(PhotoKernels.sharp([photo.name]))
    chain = Formation([learned.effect])
    frame = Frame(
        photo.camera.height, photo.camera.width, margin_for(chain.reach(photo.camera.width, photo.camera.height))
    )
    model = ForwardModel(RasterSettings(), lambda _: medium_of(None, frame), frame.margin, chain)
    return learned, model.expose(random_scene(40, 1), photo), photo


@case(
    "psf", "a kernel wider than its photo", "even light stays as it is, gradients are finite", 1e-12, "double rounding"
)
def wider_than_the_photo(_: Site) -> float:
    """A photo of 6 x 4 px, tents 3 px apart: everything in it lies within one kernel."""
    kernel = kernel_of(_random_weights(1), KERNELS.side, 3.0)
    margin = len(kernel) // 2
    even = torch.full((3, 4 + 2 * margin, 6 + 2 * margin), 0.37, dtype=torch.float64)
    inside = (..., slice(margin, -margin), slice(margin, -margin))
    shown = convolved(even, kernel)[inside]
    upstream = torch.zeros_like(even)
    upstream[inside] = 1.0
    in_light, in_weights = gradients(upstream, even, kernel, KERNELS.side, 3.0)
    if not bool(in_light.isfinite().all() and in_weights.isfinite().all()):
        return math.inf
    return float((shown - 0.37).abs().max())


@case(
    "psf",
    "a kernel before a lamp",
    "light of 1e12 is seen as that of 1, 1e12 times",
    1e-12,
    "relative; double rounding",
)
def before_a_lamp(_: Site) -> float:
    """A convolution by Fourier transform spreads the rounding of the brightest px over all of them."""
    kernel = kernel_of(_random_weights(2), KERNELS.side, 1.3)
    light = torch.rand(3, 40, 30, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    plain, bright = convolved(light, kernel), convolved(1e12 * light, kernel) / 1e12
    return float(((bright - plain).abs() / plain.abs().clamp(min=1e-6)).max())


@case(
    "psf",
    "a photo without light teaches no kernel",
    "weights sum to 1 around the middle",
    1e-3,
    "of a distance of tents",
)
def without_light(_: Site) -> float:
    """A black photo says nothing of its kernel: the least squares are singular but for what holds sum and middle."""
    found = best_weights(np.zeros((_WEIGHTS, _WEIGHTS)), np.zeros(_WEIGHTS))
    if found is None or not np.isfinite(found).all() or (found < 0).any():
        return math.inf
    at = places(KERNELS.side, torch.zeros(1, dtype=torch.float64)).numpy()
    return float(max(abs(found.sum() - 1.0), np.abs(found[1:] @ at).max()))


@case("psf", "a kernel of a photo that is not finite", "the kernel stays as it was", 0.0, "nothing is computed")
def of_no_numbers(_: Site) -> float:
    """One px that is NaN is in every sum over the photo."""
    learned, exposed, photo = _learning()
    picture = torch.full((3, photo.camera.height, photo.camera.width), 0.5)
    picture[1, 5, 7] = math.nan
    before = learned.effect.parameters["weights"].clone()
    learned.learn(photo.name, exposed, picture)
    after = learned.effect.parameters["weights"]
    return float((after - before).abs().max()) if bool(after.isfinite().all()) else math.inf


@case("psf", "a kernel of a photo of one value", "the kernel is finite, not negative, and sums to 1", 1e-5, "rounding")
def of_one_value(_: Site) -> float:
    """White all over: every kernel explains it equally badly, and residuals have no spread to be judged by."""
    learned, exposed, photo = _learning()
    learned.learn(photo.name, exposed, torch.ones(3, photo.camera.height, photo.camera.width))
    weights = learned.effect.parameters["weights"]
    if not bool(weights.isfinite().all()) or bool((weights < 0).any()):
        return math.inf
    return float((weights.sum(dim=-1) - 1.0).abs().max())
