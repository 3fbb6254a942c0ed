"""Paths of the camera in an exposure: none at all, one longer than the photo, and shutters that roll."""

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
from .case import ALL, Site, case
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
    ALL,
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


@case(
    "poses",
    "a rolling shutter that reads all rows at once",
    "the photo is that of a shutter that does not roll",
    1e-5,
    "rounding of the rows' weights",
)
def no_readout(site: Site) -> float:
    """Rows' weights with a readout of nearly 0 are those of equal frames."""
    camera, twin = make_camera(), random_scene(40, 1)
    plain = straight_paths({camera.name: (6.0 / camera.fx, 0.0)}, 4)
    shown, still = (_exposed(twin, camera, m).degraded for m in (plain.rolling(1e-9), plain))
    return float((shown - still).abs().max())


@case(
    "poses",
    "a readout of a hundred exposures",
    "all rows have all their light; a gradient in the photo is finite in the Gaussians",
    1e-4,
    "rounding of the shares",
)
def endless_readout(site: Site) -> float:
    """A row's exposure is shorter than the time between two frames."""
    camera, twin = make_camera(), random_scene(40, 1).detached().requires_grad_()
    motion = straight_paths({camera.name: (6.0 / camera.fx, 0.0)}, 4).rolling(100.0)
    exposed = _exposed(twin, camera, motion)
    weights = motion.row_weights(len(exposed.frames), camera.height, camera.width)
    assert weights is not None
    exposed.backward(torch.ones_like(exposed.reached))
    finite = all(tensor.grad is not None and bool(tensor.grad.isfinite().all()) for _, tensor in twin.named())
    wrong = float((weights.sum(dim=0) - 1.0).abs().max()) + float((-weights).clamp(min=0.0).max())
    return wrong if finite and bool(exposed.degraded.isfinite().all()) else math.inf
