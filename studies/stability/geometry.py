"""Where a Gaussian is and what shape it has: poison, giants, needles, the camera's plane and its centre."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import torch

from ...core.constants import FAR_PLANE, HARMONICS_LIMIT, NEAR_PLANE
from ...core.gaussians import Gaussians
from ...core.rasterizer import RasterSettings
from .case import ALL, Site, case, worst
from .photographed import small_set, trained_steps
from .scenes import against_float64, drawn, joined, make_camera, random_scene, rows, single

POISON = (math.nan, math.inf, -math.inf, 3.4e38, -3.4e38, 1e-45, 0.0)
TURN = (0.9, 0.1, 0.3, 0.2)
SHAPES = {
    "needle": [3.0, 1e-12, 1e-12],
    "disc": [0.5, 0.5, 1e-12],
    "edge-on disc": [1e-12, 0.5, 0.5],
    "giant": [1e3, 1e3, 1e3],
    "needle of a thousand frames": [1e3, 1e-3, 1e-3],
    "dust": [1e-12, 1e-12, 1e-12],
    "giant disc": [1e6, 1e6, 1e-6],
}


@case(
    "geometry",
    "poison in every slot",
    "finite, or culled and counted; the others undisturbed",
    0.0,
    "a count of violations",
    ALL,
)
def poison_in_every_slot(site: Site) -> float:
    """NaN, infinities, the largest and the smallest float and 0 in every parameter of one of twelve. Elsewhere:
    NaN radii, reads out of bounds."""
    clean, camera = random_scene(12, 1, seed=1), make_camera()
    rest = drawn(rows(clean, torch.arange(1, 12)), camera, site.backend).image
    violations = 0
    for poison in POISON:
        for name, tensor in clean.named():
            for slot in range(min(tensor[0].numel(), 4)):
                scene = clean.detached()
                getattr(scene, name)[0].view(-1)[slot] = poison
                if name == "quaternions" and poison == 0.0:
                    scene.quaternions[0] = 0.0
                found = drawn(scene, camera, site.backend)
                violations += not found.finite
                counted = sum(found.view.screen.culled.values()) + int((found.view.screen.radius > 0).sum())
                violations += counted != 12
                if not math.isfinite(poison):
                    violations += found.view.screen.culled.get("non_finite", 0) != 1
                    violations += float(found.view.screen.radius[0]) != 0.0
                    violations += worst(found.image, rest) > 1e-6
    return float(violations)


@case("geometry", "all parameters poisoned", "image is the background, gradients 0", 0.0, "a count of violations", ALL)
def nothing_is_left(site: Site) -> float:
    """Every Gaussian is NaN: an empty view, not a crash."""
    scene = random_scene(5, 0)
    scene.means[:] = math.nan
    behind = torch.tensor([0.2, 0.4, 0.6])
    found = drawn(scene, make_camera(), site.backend, background=behind)
    wrong = worst(found.image, behind[:, None, None].expand_as(found.image)) > 1e-6
    return float(wrong) + sum(float(g.abs().sum() > 0) for g in found.gradients.values())


@case("geometry", "what must be culled", "culled, and counted under its reason", 0.0, "a count of violations", ALL)
def must_cull(site: Site) -> float:
    """Behind, too near, beyond the far plane, beside the frame, transparent, without direction, too bright."""
    wanted = {
        "behind": single((0.0, 0.0, -3.0), 0.1),
        "outside": single((9.0, 0.0, 3.0), 0.05),
        "transparent": single((0.0, 0.0, 3.0), 0.1, -8.0),
        "degenerate": single((0.0, 0.0, 3.0), 0.1, turn=(0.0, 0.0, 0.0, 0.0)),
        "non_finite": single((math.nan, 0.0, 3.0), 0.1),
    }
    far, bright = single((0.0, 0.0, 2 * FAR_PLANE), 1e12), single((0.0, 0.0, 3.0), 0.1)
    bright.sh *= 10 * HARMONICS_LIMIT
    scenes = [*wanted.items(), ("degenerate", far), ("degenerate", bright)]
    violations = 0
    for reason, scene in scenes:
        found = drawn(scene, make_camera(), site.backend)
        violations += found.view.screen.culled.get(reason, 0) != 1 or float(found.alpha.max()) != 0.0
    return float(violations)


@case(
    "geometry",
    "giants must not be culled",
    "alpha is 0.5 everywhere",
    1e-3,
    "the Gaussian itself falls by 5e-4 over the frame at a scale of 1e3 / 30",
    ALL,
)
def giants_cover_the_frame(site: Site) -> float:
    """Scales of 1e3 to 1e12: huge but valid, and elsewhere they vanish."""
    errors = []
    for scale in (1e3, 1e6, 1e12):
        found = drawn(single((0.0, 0.0, 3.0), scale, 0.0), make_camera(), site.backend)
        errors.append(worst(found.alpha, torch.full_like(found.alpha, 0.5)) if found.finite else math.inf)
    return max(errors)


@case("geometry", "specks must not be culled", "alpha stays above 0.3", 0.0, "a count of violations", ALL)
def specks_are_drawn(site: Site) -> float:
    """A Gaussian of 1e-12 in the middle of a pixel is as wide as the low-pass, and visible."""
    camera = replace(make_camera(), rotation=np.eye(3), translation=np.zeros(3), cx=30.5, cy=22.5)
    found = drawn(single((0.0, 0.0, 3.0), 1e-12, 4.0), camera, site.backend)
    return float(not found.finite or not float(found.alpha.max()) > 0.3)


@case(
    "geometry",
    "scales from 1e-12 to 1e12: image",
    "float32 equals float64",
    1e-4,
    "the reference rounds covariances to float32 (4e-5); cpu computes them in double (3e-6)",
    ALL,
)
def extreme_shapes_image(site: Site) -> float:
    """Needles, discs seen flat and edge on, giants, dust: determinants of 0."""
    return max(
        against_float64(single((0.05, 0.02, 3.0), scale, 1.0, TURN), make_camera(), site)[0]
        for scale in SHAPES.values()
    )


@case(
    "geometry",
    "scales from 1e-12 to 1e12: gradients",
    "float32 equals float64, relative",
    1e-3,
    "the target; the parameters themselves are rounded to 6e-8",
    ALL,
)
def extreme_shapes_gradients(site: Site) -> float:
    """The same shapes, backward: the inverse of a covariance of rank 1."""
    return max(
        against_float64(single((0.05, 0.02, 3.0), scale, 1.0, TURN), make_camera(), site)[1]
        for scale in SHAPES.values()
    )


@case("geometry", "needle end on, antialiased", "finite", 0.0, "a count of violations", ALL)
def needle_end_on(site: Site) -> float:
    """The antialiasing's square root has no slope at 0."""
    camera = replace(make_camera(), rotation=np.eye(3), translation=np.zeros(3))
    scene = joined(
        single((0.0, 0.0, 3.0), [1e-12, 1e-12, 1.0]),
        single((0.3, 0.0, 3.0), [1e-6, 0.3, 1e-30]),
        single((0.0, 0.2, 3.0), [0.0, 0.0, 0.0]),
    )
    return float(not drawn(scene, camera, site.backend, RasterSettings(antialias=True)).finite)


@case("geometry", "quaternions of any length", "same image as of unit length", 2e-6, "rounding of one division", ALL)
def quaternion_lengths(site: Site) -> float:
    """Lengths of 1e-11 to 1e30: their squares leave float32."""
    scene, camera = random_scene(30, 0, seed=8), make_camera()
    scene.quaternions /= scene.quaternions.norm(dim=1, keepdim=True)
    truth = drawn(scene, camera, site.backend).image
    errors = []
    for length in (1e-11, 1e-6, 1e15, 1e30):
        other = scene.detached()
        other.quaternions *= length
        found = drawn(other, camera, site.backend)
        errors.append(worst(found.image, truth) if found.finite else math.inf)
    return max(errors)


def _at(point: tuple[float, float, float], scale: float) -> Gaussians:
    """A Gaussian at a place in the test camera's own axes."""
    camera = make_camera()
    scene = single((0.0, 0.0, 0.0), scale)
    world = camera.rotation.T @ (np.array(point) - camera.translation)
    scene.means[:] = torch.from_numpy(world).float()
    return scene


@case(
    "geometry",
    "sweep through the camera's plane",
    "finite; behind the near plane culled",
    0.0,
    "a count of violations",
    ALL,
)
def sweep_through_the_camera(site: Site) -> float:
    """At, behind and beside the camera, out to ten times the viewing direction: the Jacobian explodes."""
    violations = 0
    for z in (-1.0, -1e-6, 0.0, 1e-30, NEAR_PLANE * 0.5, NEAR_PLANE * 1.5, 0.1, 1.0):
        for ratio in (0.0, 1.0, 3.0, 10.0):
            found = drawn(_at((z * ratio, -0.5 * z * ratio, z), 0.05), make_camera(), site.backend)
            violations += not found.finite
            violations += z < NEAR_PLANE and found.view.screen.culled.get("behind", 0) != 1
    return float(violations)


@case(
    "geometry", "grazing and beside the frame: gradients", "float32 equals float64, relative", 1e-3, "the target", ALL
)
def grazing_gradients(site: Site) -> float:
    """Large Gaussians centred far beside the frame: the Jacobian's direction is clamped, its gradient ends."""
    places = [(0.6, 0.1, 0.9), (-2.0, 0.3, 1.0), (0.2, 4.0, 1.0), (10.0, -5.0, 1.0)]
    return max(against_float64(_at(p, 0.35 * abs(p[0]) + 0.2), make_camera(), site)[1] for p in places)


@case(
    "geometry",
    "clamped branch has no slope",
    "gradient equals finite differences",
    1e-3,
    "of central differences with a step of 1e-5 in float64",
    ALL,
)
def clamped_branch(site: Site) -> float:
    """Beyond the frame's margin the Jacobian is constant; a gradient that still follows x/z is wrong."""
    camera, scene = make_camera(), _at((-2.0, 0.3, 1.0), 0.9)
    settings = RasterSettings(alpha_minimum=0.0)
    found = drawn(scene, camera, site.backend, settings)
    weights = torch.Generator().manual_seed(5)
    image_weight = torch.randn(found.image.shape, generator=weights).double()
    alpha_weight = torch.randn(found.alpha.shape, generator=weights).double()

    def value(shift: torch.Tensor) -> float:
        other = scene.to(dtype=torch.float64)
        other.means = other.means + shift
        view = drawn(other, camera, "reference", settings)
        return float((view.image * image_weight).sum() + (view.alpha * alpha_weight).sum())

    slopes = []
    for axis in range(3):
        step = torch.zeros(1, 3, dtype=torch.float64)
        step[0, axis] = 1e-5
        slopes.append((value(step) - value(-step)) / 2e-5)
    truth = torch.tensor(slopes, dtype=torch.float64)
    return float((found.gradients["means"][0].double() - truth).norm() / truth.norm())


@case("geometry", "Gaussian at the camera's centre", "finite, culled as behind", 0.0, "a count of violations", ALL)
def at_the_camera_centre(site: Site) -> float:
    """No direction to look along: the harmonics' argument is 0 / 0."""
    camera = make_camera()
    scene = single((0.0, 0.0, 0.0), 0.2)
    scene.means[:] = torch.from_numpy(camera.centre).float()
    found = drawn(joined(scene, random_scene(5, 0)), camera, site.backend)
    return float(not found.finite) + float(found.view.screen.culled.get("behind", 0) < 1)


@case("geometry", "initial points at the camera centres", "200 steps, all finite", 0.0, "a count of violations")
def points_at_the_cameras(site: Site) -> float:
    """Structure from motion leaves points on cameras; elsewhere NaN after a few hundred steps."""
    views, points, medium = small_set()
    centres = np.stack([view.camera.centre for view in views])
    points = replace(
        points,
        positions=np.concatenate([points.positions, centres, centres + 1e-9]),
        colours=np.concatenate([points.colours, np.full((2 * len(centres), 3), 200, np.uint8)]),
    )
    trainer = trained_steps(views, points, medium, 200)
    return float(sum(int((~t.isfinite()).sum()) for _, t in trainer.optimizer.gaussians.named()))
