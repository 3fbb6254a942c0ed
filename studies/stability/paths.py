"""Paths of the camera in an exposure: none at all, and one that is longer than the photo."""

from __future__ import annotations

import math

import torch

from ...core.camera import Camera
from ...core.forward import Exposed, ForwardModel, medium_of
from ...core.frames import Frame
from ...core.gaussians import Gaussians
from ...core.imaging.formation.chain import Formation
from ...core.imaging.formation.motion import CameraMotion, straight_paths
from ...core.imaging.psf import PointSpread
from ...core.rasterizer import RasterSettings, render, render_path
from .case import OWN_BACKENDS, Site, case
from .scenes import make_camera, random_scene


class _Photo:
    """What the forward model asks of a photo."""

    psf: PointSpread | None = None

    def __init__(self, camera: Camera) -> None:
        self.name, self.camera = camera.name, camera


def _exposed(twin: Gaussians, camera: Camera, motion: CameraMotion | None) -> Exposed:
    frame = Frame(camera.height, camera.width, 0)
    chain = Formation() if motion is None else Formation([motion])
    return ForwardModel(RasterSettings(), lambda _: medium_of(None, frame), 0, chain).expose(twin, _Photo(camera))


@case("poses", "a path of no length", "the photo is that of a camera that stood still", 1e-5, "rounding of the pose")
def no_path(site: Site) -> float:
    """Directions and spacings of frames are divided by a length of 0."""
    camera, twin = make_camera(), random_scene(40, 1)
    motion = straight_paths({camera.name: (0.0, 0.0)}, 4)
    moved, still = (_exposed(twin, camera, m).degraded for m in (motion, None))
    return float((moved - still).abs().max())


@case(
    "poses",
    "a path longer than the photo",
    "frames of the back end are those of one render each; light and gradients are finite",
    0.05,
    "display values; shapes are shared over a turn of a third",
    OWN_BACKENDS,
)
def endless_path(site: Site) -> float:
    """What one frame shows is far beside the others; tiles and centres leave the frame."""
    camera, twin = make_camera(), site.put(random_scene(40, 1)).detached().requires_grad_()
    motion = straight_paths({camera.name: (1.5 * camera.width / camera.fx, 0.0)}, 4)
    poses = motion.poses(camera.name, camera)
    assert poses is not None
    found = render_path(twin, camera, poses, backend=site.backend).images
    alone = torch.stack([render(twin, camera, pose=pose, backend=site.backend).image for pose in poses])
    found.sum().backward()  # type: ignore[no-untyped-call]
    finite = all(tensor.grad is not None and bool(tensor.grad.isfinite().all()) for _, tensor in twin.named())
    return float((found - alone).detach().abs().mean()) if finite else math.inf
