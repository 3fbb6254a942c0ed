"""What the first steps on a card would wait for, done before: wgpu reads C's declarations anew for each kind of value,
and the driver compiles each shader when it is first ordered."""

from __future__ import annotations

import numpy as np
import torch

from ...camera import Camera
from ...gaussians import Gaussians
from ...rasterizer import with_gradient
from ...rendering import RasterSettings
from .card import Card
from .losses import photometric_on_card
from .rasterizer import render_gpu
from .tensors import from_host

#: Shaders of every training besides those of `_a_step`. One that is missing here is compiled when it is needed.
_OTHERS = (
    "adam",
    "blur",
    "collect",
    "compare",
    "correlate",
    "draw",
    "elementwise",
    "filter_colours",
    "guard",
    "pad",
    "reduce",
    "residual",
    "rows",
    "seen",
    "specks",
    "variation",
)
#: px of each side of the picture that is drawn.
_SIDE = 32


def make_ready(card: Card) -> None:
    """Compiles what trainings use, and draws a small picture.

    Raises:
        DeviceError: the card does not work.
    """
    _a_step()
    for kernel in _OTHERS:
        card.compile(kernel)
    card.wait()


def _a_step() -> None:
    """One Gaussian, rendered, compared with a grey picture, and its gradients brought back."""
    camera = Camera("", _SIDE, _SIDE, _SIDE, _SIDE, _SIDE / 2, _SIDE / 2, np.eye(3), np.array([0.0, 0.0, 2.0]))
    one = Gaussians(*(torch.zeros(1, *shape) for shape in ((3,), (3,), (4,), (), (4, 3))))
    one.quaternions[:, 0] = 1.0
    one = Gaussians(*(from_host(tensor) for _, tensor in one.named())).requires_grad_()
    image = render_gpu(one, camera, None, None, RasterSettings()).image
    _, gradient = photometric_on_card(image.detach(), torch.full((3, _SIDE, _SIDE), 0.5), None, 0.2)
    with_gradient(image, gradient).backward()  # type: ignore[no-untyped-call]
    assert one.means.grad is not None
    one.means.grad.cpu()
