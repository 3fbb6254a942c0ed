"""Which back end is taken, and what is said when it is not there."""

from __future__ import annotations

import pytest
import torch
from dgs.core.errors import DeviceError
from dgs.core.rasterizer import render
from dgs.tests.core.rasterizer.rasterizer_scenes import make_camera, random_scene


def test_auto_takes_the_reference_for_float64_and_cpu_for_float32() -> None:
    camera = make_camera()
    scene = random_scene(20)
    assert render(scene.to(dtype=torch.float64), camera).image.dtype == torch.float64
    automatic, chosen = render(scene, camera), render(scene, camera, backend="cpu")
    assert torch.equal(automatic.image, chosen.image)


def test_unknown_back_end() -> None:
    with pytest.raises(DeviceError, match="reference, cpu, gpu"):
        render(random_scene(1), make_camera(), backend="vulkan")  # type: ignore[arg-type]


def test_float64_is_refused_by_cpu() -> None:
    with pytest.raises(DeviceError, match="reference"):
        render(random_scene(1, dtype=torch.float64), make_camera(), backend="cpu")
