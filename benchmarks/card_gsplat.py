"""A step of training as gsplat's users take it, to stand beside ours (`benchmarks.card`); needs CUDA and gsplat."""

from __future__ import annotations

import time
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

Row = dict[str, Any]


def available() -> bool:
    """Whether it can be measured here."""
    import torch

    return torch.cuda.is_available() and find_spec("gsplat") is not None


def measure(case: Row, photos: Path, angles: list[float], warm: int, steps: int) -> Row:
    """The step of gsplat's users: its rasterizer, L1 and SSIM by torch's convolutions, torch's fused Adam."""
    import gsplat
    import torch
    from torch.nn.functional import conv2d

    from . import scene

    width, height = case["size"]
    cameras = [scene.camera(width, height, degrees) for degrees in angles]
    wanted = [torch.from_numpy(p).cuda().permute(2, 0, 1).float() / 255 for p in np.load(photos)]
    gaussians = scene.gaussians(case["gaussians"], case["sh_degree"]).to(device="cuda").requires_grad_()
    optimizer = torch.optim.Adam([tensor for _, tensor in gaussians.named()], lr=1e-5, eps=1e-15, fused=True)
    taps = torch.exp(-((torch.arange(11.0, device="cuda") - 5) ** 2) / 4.5)
    taps = (taps / taps.sum()).reshape(1, 1, 1, 11)

    def blurred(stack: Any) -> Any:
        planes = stack.reshape(-1, 1, height, width)
        return conv2d(conv2d(planes, taps, padding=(0, 5)), taps.transpose(2, 3), padding=(5, 0)).view_as(stack)

    def dissimilarity(x: Any, y: Any) -> Any:
        m, n, xx, yy, xy = blurred(torch.stack([x, y, x * x, y * y, x * y]))
        top = (2 * m * n + 1e-4) * (2 * (xy - m * n) + 9e-4)
        return 1 - (top / ((m * m + n * n + 1e-4) * (xx - m * m + yy - n * n + 9e-4))).mean()

    def rendered(camera: Any) -> Any:
        pose = torch.eye(4, device="cuda")
        pose[:3, :3], pose[:3, 3] = torch.from_numpy(camera.rotation), torch.from_numpy(camera.translation)
        lens = torch.tensor([[camera.fx, 0.0, camera.cx], [0.0, camera.fy, camera.cy], [0.0, 0.0, 1.0]], device="cuda")
        shape = gaussians.means, gaussians.quaternions, gaussians.log_scales.exp(), gaussians.opacity_logits.sigmoid()
        frame = pose[None], lens[None], width, height
        return gsplat.rasterization(*shape, gaussians.sh, *frame, sh_degree=case["sh_degree"], packed=False)[0][0]

    def step(number: int) -> None:
        image = rendered(cameras[number % len(angles)]).permute(2, 0, 1)
        photo = wanted[number % len(angles)]
        (0.8 * (image - photo).abs().mean() + 0.2 * dissimilarity(image, photo)).backward()
        optimizer.step()
        optimizer.zero_grad(set_to_none=True)

    for number in range(warm):
        step(number)
    torch.cuda.synchronize()
    begun = time.perf_counter()
    for number in range(steps):
        step(number)
    torch.cuda.synchronize()
    spent = round(1e3 * (time.perf_counter() - begun) / steps, 3)
    return {**case, "device": "gsplat", "step_ms": spent, "mean_step_ms": spent}
