"""Poses: gauges, rails, turns of half a circle, and how far a pose may be off and still be found."""

from __future__ import annotations

import math

import numpy as np
import torch

from ...core.camera import Camera
from ...core.conventions import from_opengl, quaternion_from_rotation, rotation_from_quaternion, to_opengl
from ...core.errors import CameraError
from ...core.evaluation.poses import align_similarity, pose_errors
from ...core.rasterizer import RasterSettings, render
from ...core.rasterizer.projection import camera_pose
from ...core.rigid_motion import moved_pose, se3_exponential
from .case import ALL, Site, case, explained
from .photographed import arc, looking
from .scenes import drawn, make_camera, random_scene

#: Perturbations from which a pose is to be found again, in px at the scene's depth.
BASIN_PX = (0.5, 2.0, 8.0)
STEPS = 30


def _rotation(seed: int) -> np.ndarray:
    random = np.random.default_rng(seed)
    return rotation_from_quaternion(random.standard_normal(4))


def _set(centres: list[np.ndarray]) -> dict[str, Camera]:
    return {f"{i}.png": looking(c, np.array([0.1, 0.2, 0.3]), f"{i}.png") for i, c in enumerate(centres)}


def _elsewhere(cameras: dict[str, Camera], size: float, offset: float, seed: int = 1) -> dict[str, Camera]:
    """The same cameras in another world."""
    turn, shift = _rotation(seed), offset * np.array([1.0, -0.5, 0.25])
    out = {}
    for name, camera in cameras.items():
        rotation = camera.rotation @ turn.T
        out[name] = camera.moved(rotation, -rotation @ (size * turn @ camera.centre + shift))
    return out


@case("poses", "gauge: any similarity", "no pose error after alignment, in units of the scene", 1e-9, "float64")
def gauge(site: Site) -> float:
    """Photos show neither where the world's origin lies nor how long a unit is; scores without alignment punish it."""
    truth, errors = _set(arc(7)), []
    for size, offset in ((1e-3, 0.0), (1e3, 0.0), (1.0, 10.0), (1e3, 1e3)):
        found = pose_errors(_elsewhere(truth, size, offset), truth)
        errors += [float(found.centre.max()), math.radians(float(found.angle.max()))]
    return max(errors)


@case(
    "poses",
    "gauge at UTM coordinates",
    "no pose error after alignment",
    1e-7,
    "float64 keeps 1e-10 of 1e6, the scene is 3 units",
)
def gauge_utm(site: Site) -> float:
    """The estimate stands a thousand kilometres from the truth."""
    found = pose_errors(_elsewhere(_set(arc(7)), 1.0, 1e6), _set(arc(7)))
    return max(float(found.centre.max()), math.radians(float(found.angle.max())))


@case(
    "poses", "rail: collinear cameras", "roll about the rail is found; the reported rank is 1", 1e-6, "radians; float64"
)
def rail(site: Site) -> float:
    """Aligning by centres alone leaves the roll about the rail free."""
    centres = [np.array([x, 0.0, -3.0]) for x in np.linspace(-1.0, 1.0, 9)]
    truth = _set(centres)
    found = pose_errors(_elsewhere(truth, 2.5, 4.0, seed=3), truth)
    if found.alignment.rank != 1:
        return math.inf
    return max(float(found.centre.max()), math.radians(float(found.angle.max())))


@case(
    "poses",
    "ranks of camera sets",
    "0 in one site, 1 on a rail, 2 in a plane, 3 in space",
    0.0,
    "a count of violations",
)
def ranks(site: Site) -> float:
    """All photos from one place fix no scale: no division by zero."""
    flat = [np.array([x, y, -3.0]) for x in (-1.0, 0.0, 1.0) for y in (-0.7, 0.6)]
    space = [*flat, np.array([0.3, 0.2, -4.0])]
    rail_ = [np.array([x, 0.0, -3.0]) for x in (-1.0, 0.5, 1.0)]
    sets = ([np.array([0.0, 0.0, -3.0])] * 5, rail_, flat, space)
    violations = 0
    for rank, centres in enumerate(sets):
        cameras = _set(list(centres))
        found = align_similarity(_elsewhere(cameras, 2.0, 1.0), cameras)
        violations += found.rank != rank
        violations += not np.isfinite(found.rotation).all() or not math.isfinite(found.scale)
    with explained(CameraError):
        align_similarity({"a": make_camera()}, {"b": make_camera()})
    return float(violations)


@case("poses", "turns of half a circle", "rotation -> quaternion -> rotation", 1e-12, "float64")
def half_turns(site: Site) -> float:
    """The trace's formula divides by 0 at 180 degrees."""
    errors = []
    axes = [np.array(a, float) for a in ([1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 0], [1, -1, 1], [0, 1e-9, 1])]
    for axis in axes:
        axis = axis / np.linalg.norm(axis)
        for angle in (0.0, 1e-9, 1e-4, math.pi - 1e-9, math.pi, 3.0):
            quaternion = np.concatenate([[math.cos(angle / 2)], math.sin(angle / 2) * axis])
            rotation = rotation_from_quaternion(quaternion)
            again = rotation_from_quaternion(quaternion_from_rotation(rotation))
            errors.append(float(np.abs(again - rotation).max()))
            there = from_opengl(to_opengl(rotation, axis))
            errors.append(float(max(np.abs(there[0] - rotation).max(), np.abs(there[1] - axis).max())))
    return max(errors)


@case("poses", "a step of 0", "the exponential's value and slope at 0", 1e-7, "of central differences in float64")
def zero_twist(site: Site) -> float:
    """sin(t) / t at t = 0."""
    weights = torch.randn(3, 4, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    errors = []
    for size in (0.0, 1e-12, 1e-6, 0.3):
        twist = (size * torch.tensor([0.3, -0.2, 0.5, 0.4, -0.8, 0.2], dtype=torch.float64)).requires_grad_()
        (slope,) = torch.autograd.grad((se3_exponential(twist) * weights).sum(), twist)
        for k in range(6):
            step = torch.zeros(6, dtype=torch.float64)
            step[k] = 1e-6
            with torch.no_grad():
                ends = [(se3_exponential(twist + s * step) * weights).sum() for s in (1, -1)]
            errors.append(abs(float(slope[k]) - float(ends[0] - ends[1]) / 2e-6))
        turn = se3_exponential(twist.detach())[:, :3]
        errors.append(float((turn @ turn.T - torch.eye(3)).abs().max()))
    return max(errors)


@case("poses", "gradient of the pose", "float32 equals float64, relative", 1e-3, "the target", ALL)
def pose_gradient(site: Site) -> float:
    """Sums over all Gaussians and pixels of terms of both signs."""
    errors = []
    for seed in range(4):
        scene = random_scene(150, 1, seed=20 + seed)
        truth = drawn(scene.to(dtype=torch.float64), make_camera(), "reference").gradients["twist"]
        found = drawn(scene, make_camera(), site.backend).gradients["twist"]
        errors.append(float((found.double() - truth).norm() / truth.norm()))
    return max(errors)


def recovered_px(off: float, seed: int) -> float:
    """How far (px at the scene's depth) a pose is off after a refinement that began `off` px away."""
    scene, camera = random_scene(80, 0, seed=4, size=-1.3), make_camera()
    pose = camera_pose(camera, scene.means)
    # A turn by an angle moves everything by focal * angle px, a shift by focal * shift / depth.
    px = torch.tensor([3.5] * 3 + [1.0] * 3) / 60.0
    kick = torch.randn(6, generator=torch.Generator().manual_seed(seed))
    twist = (off * kick / kick.norm()).requires_grad_()
    settings = RasterSettings(low_pass=1.0, alpha_minimum=0.0)
    with torch.no_grad():
        wanted = render(scene, camera, pose=pose, settings=settings, backend="cpu").image

    def misfit() -> torch.Tensor:
        twist.grad = None
        moved = moved_pose(twist * px, pose)
        loss = (render(scene, camera, pose=moved, settings=settings, backend="cpu").image - wanted).square().sum()
        loss.backward()  # type: ignore[no-untyped-call]
        return loss

    for _ in range(2):  # a line search may give up once
        optimizer = torch.optim.LBFGS([twist], max_iter=STEPS, line_search_fn="strong_wolfe", tolerance_change=0.0)
        optimizer.step(misfit)  # type: ignore[arg-type]
    points = scene.means.double()

    def at(correction: torch.Tensor) -> torch.Tensor:
        moved = moved_pose(correction.double(), pose.double())
        p = points @ moved[:, :3].T + moved[:, 3]
        return p[:, :2] / p[:, 2:] * 60.0

    with torch.no_grad():
        return float((at(twist.detach() * px) - at(torch.zeros(6))).norm(dim=1).median())


@case(
    "poses",
    "perturbed by 0.5 to 8 px",
    "the pose is found again, to a twentieth of a px",
    0.05,
    "of the median Gaussian; the noise of photos leaves more open",
    ("cpu",),
)
def basin(site: Site) -> float:
    """The basin from which gradients lead back to the pose: refined poses must score better, not only look better."""
    return max(recovered_px(off, seed) for off in BASIN_PX for seed in (6, 7, 8))
