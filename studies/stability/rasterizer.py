"""Blending: opaque stacks, the alpha cutoff, ties, brightness, sizes, and laws that any image has to obey."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from ...core import compiled
from ...core.camera import Camera
from ...core.constants import ALPHA_MAXIMUM, ALPHA_MINIMUM, NEAR_PLANE
from ...core.gaussians import Gaussians
from ...core.rasterizer import RasterSettings
from ...core.training.density.control import DENSITY
from .case import ALL, Site, case, worst
from .photographed import small_set, trained_steps
from .scenes import against_float64, drawn, joined, make_camera, pixels_apart, random_scene, rows, single

SIZES = ((1, 1), (1, 40), (40, 1), (16, 16), (17, 15), (15, 65), (33, 130), (100, 7))
SMOOTH = RasterSettings(alpha_minimum=0.0)


def opaque_stack(logit: float) -> Gaussians:
    """64 Gaussians one behind the other, of any turn and colour."""
    layers = [single((0.002 * i, 0.0, 2.0 + 0.05 * i), [0.4 + 0.01 * i, 0.3, 0.2], logit) for i in range(64)]
    scene, random = joined(*layers), torch.Generator().manual_seed(0)
    scene.sh += 0.3 * torch.randn(scene.sh.shape, generator=random)
    scene.quaternions += 0.3 * torch.randn(scene.quaternions.shape, generator=random)
    return scene


@case(
    "rasterizer",
    "64 opaque splats in a stack: image",
    "float32 equals float64",
    2e-4,
    "rounding decides at the transmittance stop whether one more counts, which adds 1e-4",
    ALL,
)
def stack_image(site: Site) -> float:
    """Transmittance runs out after a few layers."""
    return max(against_float64(opaque_stack(logit), make_camera(), site)[0] for logit in (3.0, 12.0))


@case(
    "rasterizer", "64 opaque splats in a stack: gradients", "float32 equals float64, relative", 1e-3, "the target", ALL
)
def stack_gradients(site: Site) -> float:
    """Where forward and backward clamp alpha differently, the recovered transmittance is off by up to 10 times."""
    return max(against_float64(opaque_stack(logit), make_camera(), site)[1] for logit in (3.0, 12.0))


@case(
    "rasterizer",
    "alpha at its cap",
    "slope 0 above the cap, and that of float64 below",
    1e-4,
    "ten times float32's error; slopes above the cap would be 9e-4",
    ALL,
)
def alpha_cap(site: Site) -> float:
    """Opacities just below and just above the largest alpha: forward and backward share one constant."""
    errors = []
    for opacity in (ALPHA_MAXIMUM - 2e-3, ALPHA_MAXIMUM + 2e-3, 0.998):
        scene = joined(
            single((0.0, 0.0, 3.0), 0.4, math.log(opacity / (1 - opacity))), single((0.1, 0.0, 3.5), 0.5, 1.0)
        )
        errors.append(against_float64(scene, make_camera(), site)[1])
    return max(errors)


@case(
    "rasterizer",
    "alpha cutoff at 1/255",
    "smooth and cut image differ by at most 2/255",
    2 / 255,
    "what is cut off is below 1/255 each; the colours here are below 1",
    ALL,
)
def alpha_cutoff(site: Site) -> float:
    """The cutoff is a step: gradient checks fail on it. So there are two modes, and their difference is bounded."""
    scene = random_scene(60, 0, seed=6)
    images = [drawn(scene, make_camera(), site.backend, s).image for s in (RasterSettings(), SMOOTH)]
    return worst(images[0], images[1])


@case(
    "rasterizer",
    "smooth mode is differentiable",
    "gradient equals finite differences",
    1e-3,
    "of central differences along 6 random directions in float64",
    ALL,
)
def smooth_mode(site: Site) -> float:
    """Without the cutoff the image is smooth in every parameter."""
    scene, camera = random_scene(20, 1, seed=7), make_camera()
    found = drawn(scene, camera, site.backend, SMOOTH)
    random, errors = torch.Generator().manual_seed(3), []
    weights = torch.Generator().manual_seed(5)
    by_image = torch.randn(found.image.shape, generator=weights).double()
    by_alpha = torch.randn(found.alpha.shape, generator=weights).double()
    exact = scene.to(dtype=torch.float64)
    for _ in range(6):
        along = {name: torch.randn(t.shape, generator=random, dtype=torch.float64) for name, t in exact.named()}

        def value(step: float, along: dict[str, torch.Tensor] = along) -> float:
            moved = Gaussians(**{name: t + step * along[name] for name, t in exact.named()})
            view = drawn(moved, camera, "reference", SMOOTH)
            return float((view.image * by_image).sum() + (view.alpha * by_alpha).sum())

        truth = (value(1e-6) - value(-1e-6)) / 2e-6
        slope = sum(float((found.gradients[name].double() * along[name]).sum()) for name in along)
        size = sum(float(found.gradients[name].norm() * along[name].norm()) for name in along)
        errors.append(abs(slope - truth) / max(abs(truth), 1e-2 * size))
    return max(errors)


@case(
    "rasterizer",
    "no splat is dead for good",
    "density control acts, and leaves none below the cutoff",
    0.0,
    "a count of violations",
)
def no_splat_is_dead_for_good(site: Site) -> float:
    """Opacity resets elsewhere never happen, or zero gradients for ever. Here is none: what fell below the cutoff,
    and with it lost its gradient, is taken out at the next density control instead."""
    trainer = trained_steps(*small_set(), 20, density_every=10)
    with torch.no_grad():
        trainer.optimizer.gaussians.opacity_logits[::3] = math.log(0.5 * ALPHA_MINIMUM)
    before = trainer.density.counts["pruned"]
    for step in range(20, 30):
        trainer.advance(step / 100)
    faded = int((torch.sigmoid(trainer.optimizer.gaussians.opacity_logits) < ALPHA_MINIMUM).sum())
    acted = trainer.density.counts["pruned"] > before
    return float(faded) + float(not acted) + float(not DENSITY.minimum_opacity > ALPHA_MINIMUM)


@case(
    "rasterizer",
    "ties in depth",
    "any order of the input gives the same image",
    1e-6,
    "0 on cpu; torch rounds the ends of long vectors in another way",
    ALL,
)
def depth_ties(site: Site) -> float:
    """A wall that faces the camera, with forty Gaussians at one and the same place."""
    scene, camera = random_scene(200, 0, seed=3), make_camera()
    forward = torch.from_numpy(camera.rotation[2]).float()
    scene.means -= (scene.means @ forward)[:, None] * forward
    scene.means += 3.0 * forward
    scene.means[:40] = scene.means[0]
    first = drawn(scene, camera, site.backend).image
    orders = [torch.randperm(200, generator=torch.Generator().manual_seed(seed)) for seed in range(3)]
    return max(worst(drawn(rows(scene, order), camera, site.backend).image, first) for order in orders)


@case("rasterizer", "HDR colours of 1e4: image", "float32 equals float64, per 1e4", 2e-5, "rounding", ALL)
def hdr_image(site: Site) -> float:
    """Colours far above white overflow elsewhere."""
    scene = random_scene(40, 2, seed=2)
    scene.sh *= 1e4
    truth = drawn(scene.to(dtype=torch.float64), make_camera(), "reference")
    found = drawn(scene, make_camera(), site.backend)
    return pixels_apart(found.image / 1e4, truth.image / 1e4) if float(truth.image.max()) > 1e3 else math.inf


@case("rasterizer", "HDR colours of 1e4: gradients", "float32 equals float64, relative", 1e-3, "the target", ALL)
def hdr_gradients(site: Site) -> float:
    """The same, backward."""
    scene = random_scene(40, 2, seed=2)
    scene.sh *= 1e4
    return against_float64(scene, make_camera(), site)[1]


@case("rasterizer", "sizes that fit no tile: image", "float32 equals float64", 2e-5, "rounding", ALL)
def odd_sizes(site: Site) -> float:
    """1 x 1 px, one row, one column, one px more or less than a tile; 0, 1 and 80 Gaussians."""
    errors = []
    for width, height in SIZES:
        camera = make_camera(width, height)
        for count in (0, 1, 80):
            scene = random_scene(count, seed=3)
            truth = drawn(scene.to(dtype=torch.float64), camera, "reference")
            found = drawn(scene, camera, site.backend)
            errors.append(pixels_apart(found.image, truth.image) if found.finite else math.inf)
    return max(errors)


@case(
    "rasterizer",
    "a view that sees nothing",
    "background, and gradients of exactly 0",
    0.0,
    "a count of violations",
    ALL,
)
def empty_view(site: Site) -> float:
    """All Gaussians beside the frame, or none at all."""
    violations = 0
    for scene in (random_scene(0), single((50.0, 0.0, 1.0), 0.1), single((0.0, 0.0, -5.0), 0.1)):
        found = drawn(scene, make_camera(), site.backend, background=torch.tensor([0.1, 0.2, 0.3]))
        violations += not found.finite or float(found.alpha.max()) != 0.0
        violations += any(float(g.abs().sum()) != 0.0 for g in found.gradients.values())
    return float(violations)


@case("rasterizer", "any number of threads", "the same bits", 0.0, "a count of values that differ", ("cpu",))
def thread_counts(site: Site) -> float:
    """Sums that depend on who comes first make runs irreproducible."""
    scene, camera, before = random_scene(800, 1, seed=1), make_camera(150, 110, 120.0), compiled.threads()
    found = []
    try:
        for threads in (1, 2, 3):
            compiled.set_threads(threads)
            found.append(drawn(scene, camera, "cpu"))
    finally:
        compiled.set_threads(before)
    differing = 0
    for other in found[1:]:
        differing += int((other.image != found[0].image).sum())
        differing += sum(int((other.gradients[n] != found[0].gradients[n]).sum()) for n in other.gradients)
    return float(differing)


@case("rasterizer", "law: permutation", "same image, gradients permuted", 1e-5, "sums in another order, relative", ALL)
def law_permutation(site: Site) -> float:
    """The order in which Gaussians are stored means nothing."""
    scene, camera = random_scene(120, 1, seed=11), make_camera()
    order = torch.randperm(120, generator=torch.Generator().manual_seed(1))
    one, other = (drawn(s, camera, site.backend) for s in (scene, rows(scene, order)))
    slopes = [
        worst(other.gradients[n], g[order]) / float(g.abs().max()) for n, g in one.gradients.items() if n != "twist"
    ]
    return max(worst(other.image, one.image), *slopes)


def _turned(scene: Gaussians, camera: Camera) -> tuple[Gaussians, Camera]:
    """Scene and camera after the world was turned and shifted."""
    angle, axis = 1.1, np.array([0.36, 0.48, 0.8])
    cross = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]])
    turn = np.eye(3) + np.sin(angle) * cross + (1 - np.cos(angle)) * cross @ cross
    shift = np.array([0.7, -1.3, 0.4])
    out = scene.detached()
    out.means = (scene.means.double() @ torch.from_numpy(turn).T + torch.from_numpy(shift)).to(scene.means.dtype)
    w, (x, y, z) = math.cos(angle / 2), math.sin(angle / 2) * axis
    qw, qx, qy, qz = scene.quaternions.unbind(1)
    out.quaternions = torch.stack(
        [
            w * qw - x * qx - y * qy - z * qz,
            w * qx + x * qw + y * qz - z * qy,
            w * qy - x * qz + y * qw + z * qx,
            w * qz + x * qy - y * qx + z * qw,
        ],
        dim=1,
    ).to(scene.quaternions)
    rotation = camera.rotation @ turn.T
    return out, camera.moved(rotation, camera.translation - rotation @ shift)


@case(
    "rasterizer",
    "law: turned and shifted world",
    "same image",
    5e-5,
    "centres of float32, 1e-7 of 5 units at 20 px/unit",
    ALL,
)
def law_rigid_world(site: Site) -> float:
    """World and camera move together."""
    scene, camera = random_scene(100, 0, seed=12), make_camera()
    one = drawn(scene, camera, site.backend)
    other = drawn(*_turned(scene, camera), site.backend)
    return pixels_apart(other.image, one.image)


@case("rasterizer", "law: scaled world", "same image for units of 1e-3 to 1e3", 5e-5, "as above", ALL)
def law_scaled_world(site: Site) -> float:
    """Scene, camera and near plane in other units."""
    scene, camera = random_scene(100, 0, seed=13), make_camera()
    one, errors = drawn(scene, camera, site.backend), []
    for unit in (1e-3, 0.1, 1e3):
        other = scene.detached()
        other.means *= unit
        other.log_scales += math.log(unit)
        moved = camera.moved(camera.rotation, camera.translation * unit)
        errors.append(
            pixels_apart(drawn(other, moved, site.backend, RasterSettings(near=NEAR_PLANE * unit)).image, one.image)
        )
    return max(errors)


@case("rasterizer", "law: twice the resolution", "every second px is the same", 2e-5, "rounding", ALL)
def law_resolution(site: Site) -> float:
    """Twice as many px along each side, four times the low-pass, the lens shifted by half a px: every second px looks
    along the same ray."""
    scene, camera = random_scene(100, 1, seed=14, size=-1.8), make_camera()
    scene.means[:, :2] *= 0.5
    fine = replace(
        camera,
        width=2 * camera.width,
        height=2 * camera.height,
        fx=2 * camera.fx,
        fy=2 * camera.fy,
        cx=2 * camera.cx - 0.5,
        cy=2 * camera.cy - 0.5,
    )
    one = drawn(scene, camera, site.backend).image
    other = drawn(scene, fine, site.backend, RasterSettings(low_pass=1.2)).image[:, ::2, ::2]
    return pixels_apart(other, one)


@case(
    "rasterizer",
    "law: a splat in two halves",
    "difference at most opacity^2 / 4",
    1.01,
    "two of half the opacity cover o - o^2/4; in units of o^2/4",
    ALL,
)
def law_two_halves(site: Site) -> float:
    """Splitting a faint splat in two at the same place changes the image by the square of its opacity only."""
    opacity = 0.05
    scene, camera = random_scene(1, 0, seed=15), make_camera()
    scene.means[:] = torch.tensor([[0.0, 0.0, 3.0]])
    scene.sh[:] = 1.7
    scene.opacity_logits[:] = math.log(opacity / (1 - opacity))
    half = scene.detached()
    half.opacity_logits[:] = math.log(0.5 * opacity / (1 - 0.5 * opacity))
    whole = drawn(scene, camera, site.backend, SMOOTH).alpha
    return worst(drawn(joined(half, half), camera, site.backend, SMOOTH).alpha, whole) / (opacity**2 / 4)
