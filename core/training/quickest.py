"""How quick a device is at a training: it renders what the training begins with, or takes some of its first steps."""

from __future__ import annotations

import statistics
import time
from dataclasses import replace

import numpy as np
import torch

from ..devices import BackendName, backend_named, tensors_on
from ..forward import sharp_view
from ..rasterizer import RasterSettings, with_gradient
from .density.initial import first_gaussians
from .grid import coarse_camera, grid_step
from .job import TrainingJob
from .scale import scene_scale
from .trainer import Trainer

#: Passes or steps before time counts, in which shaders and kernels are compiled, and those whose median counts.
_WARM, _TIMED = 3, 5
#: Photos of a training whose steps are timed: as many as it takes of each kind of step, one after the other.
_PHOTOS = _WARM + _TIMED
#: Share of the run whose steps are timed: photos are on their finest grid by then.
_LATER = 0.6


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


def seconds_of_a_step(job: TrainingJob, device: BackendName) -> float:
    """Median seconds of a whole step of the training, with all that it learns; of a few of its photos, and thrown away.

    Raises:
        DeviceError: the device does not work.
    """
    backend, settings = backend_named(device), replace(job.settings, device=device)
    trainer = Trainer(job.views[:_PHOTOS], [], job.points, job.medium, settings, job.formation)
    seconds = []
    for _ in range(_WARM + _TIMED):
        begun = time.perf_counter()
        trainer.advance(_LATER)
        backend.synchronize()
        seconds.append(time.perf_counter() - begun)
    return statistics.median(seconds[_WARM:])
