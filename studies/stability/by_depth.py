"""Blur that follows from the depth, where a formula divides by next to nothing: infinity, the lens, a glass."""

from __future__ import annotations

import math

import torch
from torch import Tensor

from ...core.imaging.formation.by_depth import DepthBlur
from ...core.imaging.formation.effect import Shot
from ...core.imaging.formation.focus import LensFocus
from ...core.imaging.formation.glass import FrostedGlass, GlassScene
from ...core.imaging.operator import BlurOperator
from ...core.imaging.psf import PointSpread
from .case import Site, case

_HEIGHT, _WIDTH = 40, 56
_DIAGONAL = math.hypot(_HEIGHT, _WIDTH)


def _light() -> Tensor:
    """[3, h, w] in [0, 1]."""
    return torch.rand(3, _HEIGHT, _WIDTH, generator=torch.Generator().manual_seed(4))


def _hard_depths() -> Tensor:
    """[h, w] median depths: a quarter each at one, at zero, next to it, and as far as float32 goes."""
    depth = torch.ones(_HEIGHT, _WIDTH)
    half, middle = _HEIGHT // 2, _WIDTH // 2
    depth[:half, :middle], depth[half:, :middle], depth[half:, middle:] = 0.0, 1e-30, 3e38
    return depth


def _lens(strength: float, focus: float) -> LensFocus:
    return LensFocus(["a"], torch.tensor([strength]), torch.tensor([focus]))


def _glass(spread: float, distance: float) -> FrostedGlass:
    scene = GlassScene(50.0, _DIAGONAL)  # (a long lens: no angle off the axis)
    return FrostedGlass(torch.tensor(spread), torch.tensor(distance), scene)


def _tilted_glass(right: float, down: float) -> FrostedGlass:
    """At half of the depth on the axis, through a wide lens: its corners are seen 45 degrees off the axis."""
    scene = GlassScene(0.5, _DIAGONAL)
    return FrostedGlass(torch.tensor(0.05), torch.tensor(0.5), scene, tilt=torch.tensor([right, down]))


def _passed(effect: DepthBlur, depth: Tensor) -> tuple[Tensor, bool]:
    """The light behind an effect, and whether it, its gradient and those of depth and parameters are finite."""
    light, shot = _light(), Shot("a", _HEIGHT, _WIDTH, depth=depth)
    found = effect.forward(light, shot)
    gradients = [effect.gradient(torch.ones_like(light), light, shot), *effect.gradients.values()]
    if effect.depth_gradient is not None:
        gradients.append(effect.depth_gradient)
    return found, all(bool(tensor.isfinite().all()) for tensor in (found, *gradients))


@case("psf", "focus at infinity", "the sky is sharp, all gradients are finite", 0.0, "a count of violations")
def focus_at_infinity(site: Site) -> float:
    """1 / depth at depths of 0 and of 3e38: infinite circles, or NaN where one infinity is taken from another."""
    found, finite = _passed(_lens(0.02, 0.0), _hard_depths())
    sky = slice(_HEIGHT // 2 + 12, None), slice(_WIDTH // 2 + 12, None)  # (nearer ones' circles end before it)
    nearer = _hard_depths()
    nearer[: _HEIGHT // 2] = nearer[:, : _WIDTH // 2] = 50.0
    same = torch.equal(_passed(_lens(0.02, 0.0), nearer)[0][:, *sky], _light()[:, *sky])
    return float(not finite) + float(not same) + float(bool((found < 0).any()))


@case("psf", "an aperture of zero", "the very same light, and no gradient", 0.0, "a count of violations")
def no_aperture(site: Site) -> float:
    """A width of 0 everywhere: a kernel of no px, a weight of 0 / 0."""
    found, finite = _passed(_lens(0.0, 1.0), _hard_depths())
    return float(not torch.equal(found, _light())) + float(not finite)


@case("psf", "a focus before the lens", "finite, as wide as the frame allows at most", 0.0, "a count of violations")
def focus_at_the_lens(site: Site) -> float:
    """Everything is thousands of px out of focus: kernels larger than the photo."""
    found, finite = _passed(_lens(5.0, 1e4), torch.ones(_HEIGHT, _WIDTH))
    within = bool((found >= -1e-6).all()) and bool((found <= 1 + 1e-6).all())
    return float(not finite) + float(not within)


@case("psf", "a glass behind the object", "the very same light, and no gradient", 0.0, "a count of violations")
def glass_behind(site: Site) -> float:
    """1 - distance / depth is negative: a width below 0 would blur by its square."""
    found, finite = _passed(_glass(0.05, 7.0), torch.ones(_HEIGHT, _WIDTH))
    return float(not torch.equal(found, _light())) + float(not finite)


@case("psf", "an object that touches the glass", "finite, and sharp where it touches", 0.0, "a count of violations")
def glass_touched(site: Site) -> float:
    """Widths go through 0, and the depths of stray px to 0 and beyond all bounds."""
    found, finite = _passed(_glass(0.05, 1.0), _hard_depths())
    touching = _passed(_glass(0.05, 1.0), torch.ones(_HEIGHT, _WIDTH))[0]
    return float(not finite) + float(not torch.equal(touching, _light())) + float(bool((found < 0).any()))


@case("psf", "a glass that rays run along", "finite, no light below zero", 0.0, "a count of violations")
def glass_on_edge(site: Site) -> float:
    """1 + a x goes through zero within the frame: the glass is infinitely far, then behind the camera."""
    found, finite = _passed(_tilted_glass(3.0, -2.0), _hard_depths())
    return float(not finite) + float(bool((found < 0).any()))


@case(
    "psf",
    "a glass at the camera",
    "one point spread at every depth but zero",
    1.0 / 255,
    "one step of 8 bits: kernels of the ladder are mixed",
)
def glass_at_the_camera(site: Site) -> float:
    """The distance is 0: at a depth of 0 that is 0 / 0."""
    depth = _hard_depths()
    depth[depth < 1e-6] = 0.3
    found, finite = _passed(_glass(2.0 / _DIAGONAL, 0.0), depth)
    even = BlurOperator(PointSpread(sigma_x=2.0, sigma_y=2.0), _HEIGHT, _WIDTH, 0, "cpu", torch.float32)
    zero_is_finite = _passed(_glass(2.0 / _DIAGONAL, 0.0), _hard_depths())[1]
    difference = float((found - even.apply(_light())).square().mean().sqrt())
    return difference if finite and zero_is_finite else math.inf
