"""Which back end is taken, and what is said when it is not there."""

from __future__ import annotations

import pytest
import torch
from dgs.core.errors import DeviceError
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.rasterizer.cuda import available
from dgs.tests.core.rasterizer.rasterizer_scenes import make_camera, random_scene


def test_auto_takes_the_reference_for_float64_and_cpu_for_float32() -> None:
    camera = make_camera()
    scene = random_scene(20)
    assert render(scene.to(dtype=torch.float64), camera).image.dtype == torch.float64
    automatic, chosen = render(scene, camera), render(scene, camera, backend="cpu")
    assert torch.equal(automatic.image, chosen.image)


def test_unknown_back_end() -> None:
    with pytest.raises(DeviceError, match="reference, cpu, gpu, cuda"):
        render(random_scene(1), make_camera(), backend="vulkan")  # type: ignore[arg-type]


def test_float64_is_refused_by_cpu() -> None:
    with pytest.raises(DeviceError, match="reference"):
        render(random_scene(1, dtype=torch.float64), make_camera(), backend="cpu")


@pytest.mark.skipif(available(), reason="CUDA and gsplat are here; its absence cannot be tested")
def test_missing_cuda_names_the_way_out() -> None:
    with pytest.raises(DeviceError, match=r"pip install gsplat.*--device cpu"):
        render(random_scene(1), make_camera(), backend="cuda")


@pytest.mark.skipif(not available(), reason="no CUDA device with a working gsplat on this machine")
def test_cuda_refuses_what_gsplat_cannot_do() -> None:
    scene = random_scene(3).to(device="cuda")
    with pytest.raises(DeviceError, match="cutoff"):
        render(scene, make_camera(), settings=RasterSettings(alpha_minimum=0.0), backend="cuda")
    with pytest.raises(DeviceError, match="float32"):
        render(scene.to(dtype=torch.float64), make_camera(), backend="cuda")
