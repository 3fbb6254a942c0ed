"""Compiled kernels (numba) on the CPU's cores."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from ..camera import Camera
from ..compiled import Task, run, run_all
from ..devices import AdamStep, Tent
from ..frames import Evaluation, Frame
from ..gaussians import Gaussians
from ..imaging.compiled_blurs import Direct, Runs, Separable, reads_by_runs
from ..imaging.formation.layered_kernels import gathered, returned, returned_through, weighed
from ..imaging.run_kernels import BLOCK
from ..numbers import number
from ..rasterizer.cpu import render_cpu
from ..rasterizer.layers_cpu import render_layers_cpu
from ..rasterizer.path_cpu import render_path_cpu
from ..rendering import RasterSettings, Rendered, RenderedLayers, RenderedPath
from ..training.adam_kernels import ROWS, RUN, adam_step
from ..training.loss.photometric import PhotometricLoss
from ..training.loss.speck_kernels import binomial, derivatives, differences, structure
from ..training.loss.variation import SMOOTH
from ..training.loss.variation_kernels import edge_directions, negative_divergence
from .reference import ReferenceBackend


@dataclass(frozen=True)
class CpuSettings:
    """Numbers of the CPU's kernels; they change how long it takes, and nothing else but last bits."""

    direct_taps: int = number(
        31 * 31, "count", "a kernel with more is not evaluated tap by tap: Fourier transforms are faster by far"
    )
    reads: float = number(
        0.75,
        "share of a kernel's taps",
        "that reads by runs may be at most: with more, as of a disk of 11 px and less, single taps take as long",
        "disks of 3 to 55 px, random frames of 812 x 552 px",
    )
    rows: int = number(16, "rows of one channel", "that are worth a call to a thread")
    rows_of_all: int = number(48, "rows of all three channels", "that are worth a call to a thread")


CPU = CpuSettings()


class CpuBackend(ReferenceBackend):
    """See `core.devices.Backend`."""

    one_width = "separable"

    def render(
        self,
        gaussians: Gaussians,
        camera: Camera,
        background: Tensor | None,
        pose: Tensor | None,
        settings: RasterSettings,
    ) -> Rendered:
        """See `Backend`."""
        return render_cpu(gaussians, camera, background, pose, settings)

    def render_path(
        self, gaussians: Gaussians, camera: Camera, background: Tensor | None, poses: Tensor, settings: RasterSettings
    ) -> RenderedPath:
        """See `Backend`."""
        return render_path_cpu(gaussians, camera, background, poses, settings)

    def render_layers(
        self, gaussians: Gaussians, camera: Camera, place: Tensor, background: Tensor | None, settings: RasterSettings
    ) -> RenderedLayers:
        """See `Backend`."""
        return render_layers_cpu(gaussians, camera, place, background, settings)

    def blurs(
        self, kernel: NDArray, taps: tuple[NDArray, NDArray] | None, frame: Frame, dtype: torch.dtype
    ) -> dict[str, Evaluation]:
        """See `Backend`."""
        found: dict[str, Evaluation] = {}
        if kernel.size <= CPU.direct_taps:
            found["direct"] = Direct(kernel, frame, dtype)
        if taps is not None:
            found["separable"] = Separable(*taps, frame, dtype)
        elif dtype == torch.float32 and frame.width >= BLOCK and reads_by_runs(kernel) <= CPU.reads:
            found["runs"] = Runs(kernel, frame)
        return found

    def photometric(
        self, image: Tensor, photo: Tensor, valid: Tensor | None, ssim_weight: float
    ) -> tuple[float, Tensor]:
        """See `Backend`."""
        return PhotometricLoss(photo, valid, ssim_weight).value_and_gradient(image)

    def variation_gradient(self, image: Tensor, knee: float) -> Tensor:
        """See `Backend`."""
        source = image.detach().contiguous().numpy()
        horizontal, vertical, out = (np.empty_like(source) for _ in range(3))
        limits = np.float32(SMOOTH**2), np.float32(knee)
        run(edge_directions, source.shape[1], source, *limits, horizontal, vertical, grain=CPU.rows)
        rows = source.shape[0] * source.shape[1]
        run(negative_divergence, rows, horizontal, vertical, out, grain=CPU.rows_of_all)
        return torch.from_numpy(out)

    def speck_gradient(self, image: Tensor) -> Tensor:
        """See `Backend`."""
        source = image.detach().contiguous().numpy()
        _, height, width = source.shape
        fields, means, slants, horizontal, vertical = _workspace(height, width)
        out = np.empty_like(source)
        run(structure, height - 1, source, fields, grain=CPU.rows)
        run(binomial, 3 * height, fields, means, grain=CPU.rows_of_all)
        run(derivatives, height, means, np.float32(SMOOTH**2), grain=CPU.rows)
        run(binomial, 3 * height, means, slants, grain=CPU.rows_of_all)
        run(differences, 3 * (height - 1), source, slants, horizontal, vertical, grain=CPU.rows_of_all)
        run(negative_divergence, 3 * height, horizontal, vertical, out, grain=CPU.rows_of_all)
        return torch.from_numpy(out)

    def adam(self, steps: Sequence[AdamStep]) -> None:
        """See `Backend`."""
        tasks = [_adam_task(step) for step in steps]
        run_all(tasks)
        for step, (_, _, arguments) in zip(steps, tasks, strict=True):
            step.refused.add_(int(arguments[-1].sum()))

    def layer_weighed(self, light: Tensor, variance: Tensor, tent: Tent) -> Tensor:
        """See `Backend`."""
        out = torch.empty((len(light) + 1, *light.shape[1:]))
        arrays = light.contiguous().numpy(), variance.numpy()
        run(weighed, light.shape[1], *arrays, *np.asarray(tent, np.float32), out.numpy(), grain=CPU.rows)
        return out

    def layer_gathered(
        self, back: Tensor, light: Tensor, variance: Tensor, tent: Tent, gradients: tuple[Tensor, Tensor]
    ) -> None:
        """See `Backend`."""
        arrays = back.contiguous().numpy(), light.contiguous().numpy(), variance.numpy()
        outputs = [gradient.numpy() for gradient in gradients]
        run(gathered, light.shape[1], *arrays, *np.asarray(tent, np.float32), *outputs, grain=CPU.rows)

    def layer_returned(
        self, together: Tensor, seen: Tensor | None, behind: tuple[Tensor, Tensor] | None, hides: Tensor
    ) -> Tensor:
        """See `Backend`."""
        came = torch.empty_like(together)
        everything = torch.ones_like(hides) if seen is None else seen.reshape(hides.shape)
        if behind is None:
            run(returned, len(hides), together.numpy(), everything.numpy(), came.numpy(), grain=CPU.rows)
            return came
        planes, part = behind[0], behind[1].reshape(hides.shape)
        arrays = (tensor.numpy() for tensor in (together, everything, planes, part, hides, came))
        run(returned_through, len(hides), *arrays, grain=CPU.rows)
        return came


def _adam_task(step: AdamStep) -> Task:
    """The step as a kernel's call; its last argument will hold the refused gradients of each item."""
    count = step.values.shape[0]
    period = max(1, step.values.numel() // max(1, count))
    blocks = -(-count // ROWS)
    rates_of_one = np.full(period, step.tail, np.float32)
    rates_of_one[: step.leading or period] = step.rate
    flat = [t.detach().reshape(-1).numpy() for t in (step.values, step.gradient.contiguous())]
    moments = [t.detach().reshape(-1).numpy() for t in (step.first, step.second)]
    numbers = (np.float32(x) for x in (*step.betas, step.correction, step.epsilon))
    rates = np.tile(rates_of_one, RUN)
    return adam_step, blocks, (*flat, *moments, rates, period, *numbers, np.zeros(blocks, np.int64))


@lru_cache(maxsize=2)
def _workspace(height: int, width: int) -> tuple[NDArray[np.float32], ...]:
    """Memory for the passes: fresh memory would cost as much as they do.

    What a pass leaves out (borders, the last row and column) stays zero, so each array belongs to one pass. Not for
    several trainings in threads of one process: each training is a process of its own.
    """
    wide, frame = (3, height + 2, width + 2), (3, height, width)
    return tuple(np.zeros(shape, np.float32) for shape in (wide, wide, wide, frame, frame))


BACKEND = CpuBackend()
