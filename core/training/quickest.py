"""How quick a device is at a training: it renders what the training begins with, forwards and backwards."""

from __future__ import annotations

import statistics
import time

import numpy as np
import torch

from ..devices import BackendName, backend_named, tensors_on
from ..forward import sharp_view
from ..rasterizer import RasterSettings, with_gradient
from .grid import coarse_camera, grid_step
from .initial import first_gaussians
from .job import TrainingJob
from .scale import scene_scale

#: Passes before time counts, in which shaders and kernels are compiled, and passes whose median counts.
_WARM, _TIMED = 3, 5


def seconds_of_a_pass(job: TrainingJob, device: BackendName) -> float:
    """Median seconds of a render and its backward pass, at the training's size, budget and harmonics.

    Raises:
        DeviceError: the device does not work.
    """
    backend, settings = backend_named(device), job.settings
    backend.check()
    scale, camera = scene_scale([view.camera for view in job.views], job.points), job.views[0].camera
    step = settings.grid_step or grid_step(job.medium, camera.width, camera.height)
    cameras = [coarse_camera(scale.camera_to_unit(view.camera), step) for view in job.views]
    grey = np.full((3, cameras[0].height, cameras[0].width), 0.5, np.float32)
    points, drawn = scale.sparse_to_unit(job.points), np.random.default_rng(0)
    gaussians = first_gaussians(cameras, lambda _: grey, points, settings.max_gaussians, settings.sh_degree, drawn)
    gaussians = gaussians.to(tensors_on(device)).requires_grad_()
    upstream = torch.full(grey.shape, 1e-3).to(gaussians.means.device)
    seconds = []
    for number in range(_WARM + _TIMED):
        begun = time.perf_counter()
        image = sharp_view(gaussians, cameras[number % len(cameras)], RasterSettings()).image
        with_gradient(image, upstream).backward()  # type: ignore[no-untyped-call]
        backend.synchronize()
        seconds.append(time.perf_counter() - begun)
        for _, tensor in gaussians.named():
            tensor.grad = None
    return statistics.median(seconds[_WARM:])
