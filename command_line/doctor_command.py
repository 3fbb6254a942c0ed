"""`doctor`: versions, device, and a self-check of the engine on this machine."""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from importlib.util import find_spec

from ..core.devices import BackendName, choose_device, tensors_on
from ..core.errors import CameraError, DeviceError, DgsError
from .arguments import add_machine
from .progress_choice import Reporting


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Arguments of the command."""
    parser.description = "Versions, device, and a self-check of the engine."
    add_machine(parser)


def doctor_command(options: argparse.Namespace, progress: Reporting) -> int:
    """Prints a line per check; 2 if one fails, with the way out in its line."""
    from ..core.machine import machine, use_machine, versions  # late: slows --help

    facts: dict[str, object] = {**versions()}
    for name, value in facts.items():
        print(f"{name:>14}  {value}")
    threads = use_machine(options.threads)
    device = choose_device(options.device)
    for name, value in machine(threads, device).items():
        print(f"{name:>14}  {value}")
    checks: list[tuple[str, Callable[[], str]]] = [
        ("rasterizer", lambda: _rasterizer(device)),
        ("blur", _blur),
        ("cameras", _cameras),
        ("graphics card", _graphics_card),
        ("blender", _blender),
    ]
    failed = 0
    for name, check in checks:
        began = time.perf_counter()
        try:
            print(f"{name:>14}  ok: {check()} ({time.perf_counter() - began:.1f} s)", flush=True)
        except DgsError as error:
            failed += 1
            print(f"{name:>14}  FAILED: {error}", flush=True)
    return 2 if failed else 0


def _rasterizer(device: BackendName) -> str:
    """The device's back end agrees with the specification, gradient included."""
    import numpy as np  # heavy
    import torch  # heavy

    from ..core.camera import Camera  # heavy: numpy
    from ..core.gaussians import Gaussians  # heavy: torch
    from ..core.rasterizer import render  # heavy: torch

    random = torch.Generator().manual_seed(0)
    count = 200

    def values(*shape: int) -> torch.Tensor:
        return torch.randn(shape, generator=random)

    camera = Camera("", 80, 60, 70.0, 70.0, 40.0, 30.0, np.eye(3), np.array([0.0, 0.0, 4.0]))
    images, gradients = [], []
    shapes = (values(count, 3), values(count, 3) * 0.3 - 2.5, values(count, 4))
    parameters = (*shapes, values(count), values(count, 4, 3) * 0.3)
    for backend in ("reference", device):
        gaussians = Gaussians(*(p.clone().to(tensors_on(backend)) for p in parameters)).requires_grad_()
        image = render(gaussians, camera, backend=backend).image
        image.square().sum().backward()
        images.append(image.detach().cpu())
        assert gaussians.means.grad is not None
        gradients.append(gaussians.means.grad.cpu())
    apart = float((images[0] - images[1]).abs().max())
    steep = float((gradients[0] - gradients[1]).abs().max() / gradients[0].abs().max())
    if not (apart < 1e-3 and steep < 1e-3):
        raise DeviceError(
            f"The rasterizer of '{device}' differs from the reference (image {apart:.1e}, gradient {steep:.1e})",
            "Delete the folder of compiled code (~/.cache/dgs) and try again; then report it",
        )
    return f"'{device}' agrees with the reference to {apart:.0e}"


def _blur() -> str:
    """Blur and its adjoint are transposes of each other."""
    import torch  # heavy

    from ..core.imaging.operator import BlurOperator  # heavy: torch
    from ..core.imaging.psf_text import parse_psf  # heavy: torch

    operator = BlurOperator(parse_psf("gaussian:3"), 48, 64, 12)
    random = torch.Generator().manual_seed(0)
    x, y = torch.rand((3, 72, 88), generator=random), torch.rand((3, 48, 64), generator=random)
    forward, back = float((operator.apply(x) * y).sum()), float((x * operator.adjoint(y)).sum())
    if abs(forward - back) > 1e-4 * abs(forward):
        raise DeviceError(f"Blur and adjoint disagree ({forward:.6g}, {back:.6g})", "Report it with these lines")
    return f"{operator.evaluation} evaluation, adjoint exact"


def _cameras() -> str:
    """The library that finds cameras is there; it is not imported, because it may abort a Blender."""
    if find_spec("pycolmap") is None:
        raise CameraError("pycolmap is not installed", "Run: pip install pycolmap; or give --cameras")
    return "pycolmap is there"


def _graphics_card() -> str:
    """The card that `--device gpu` would take, or why there is none: most machines need none."""
    from ..core.backends.gpu.adapter import adapters, described, is_software  # heavy: numpy

    try:
        best = adapters()[0]
    except DeviceError as error:
        return f"none ({error})"
    slow = (
        "; it stands in for a card, slower than --device cpu"
        if is_software(best)
        else "; trainings go to it where it is quicker, --device gpu takes it for all"
    )
    return described(best) + slow


def _blender() -> str:
    if find_spec("bpy") is None:
        return "not here; only 'synthesize' and scenes need it"
    return "bpy is there"
