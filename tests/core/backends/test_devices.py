"""The registry of devices: what it takes to add one, and what asking for one that does not exist says."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core import devices as registry
from dgs.core.backends.reference import ReferenceBackend
from dgs.core.camera import Camera
from dgs.core.devices import AdamStep, Entry, backend_named, backend_on, choose_device, devices
from dgs.core.errors import DeviceError
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import render
from dgs.core.training.loss.specks import speck_gradient
from dgs.core.training.loss.variation import variation_gradient
from dgs.core.training.optimizer import Adam
from dgs.core.training.trainer import Trainer

ROOT = Path(__file__).resolve().parents[3]


class ToyBackend(ReferenceBackend):
    """Counts what it is asked for."""

    def __init__(self) -> None:
        self.asked: list[str] = []

    def render(self, *arguments):
        self.asked.append("render")
        return super().render(*arguments)

    def variation_gradient(self, image, knee):
        self.asked.append("variation")
        return super().variation_gradient(image, knee)


def a_splat() -> Gaussians:
    return Gaussians(
        torch.tensor([[0.0, 0.0, 2.0]]),
        torch.full((1, 3), -1.5),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]),
        torch.tensor([2.0]),
        torch.ones(1, 1, 3),
    )


CAMERA = Camera("", 32, 24, 30.0, 30.0, 16.0, 12.0, np.eye(3), np.zeros(3))


def test_a_back_end_is_added_by_a_line(monkeypatch):
    toy = ToyBackend()
    monkeypatch.setattr(registry, "REGISTRY", {**registry.REGISTRY, "toy": Entry(lambda: toy, "cpu")})
    rendered = render(a_splat(), CAMERA, backend="toy")
    torch.testing.assert_close(rendered.image, render(a_splat(), CAMERA, backend="reference").image)
    assert "toy" in devices() and choose_device("toy") == "toy" and choose_device("auto") == "toy"
    # Tensors of a device go to its back end, whoever asks.
    monkeypatch.delitem(registry.REGISTRY, "cpu")
    assert backend_on("cpu") is toy
    render(a_splat(), CAMERA)
    variation_gradient(torch.rand(3, 8, 9))
    assert toy.asked == ["render", "render", "variation"]


def test_a_device_that_does_not_exist_is_refused_by_name():
    for ask in (choose_device, backend_named, backend_on):
        with pytest.raises(DeviceError, match="'npu'.*(cpu|reference)"):
            ask("npu")
    with pytest.raises(DeviceError, match="'quantum'"):
        render(a_splat(), CAMERA, backend="quantum")
    with pytest.raises(DeviceError, match="mps"):
        backend_on(torch.device("mps"))
    assert set(devices()) == {"cpu", "gpu"} and choose_device("cpu") == "cpu"


def test_a_training_on_such_a_device_ends_at_once():
    from dgs.core.imaging.medium import Medium
    from dgs.core.training.settings import TrainingSettings
    from dgs.core.views import SparsePoints, View

    view = View(CAMERA, np.zeros((24, 32, 3), np.uint8))
    points = SparsePoints(np.array([[0.0, 0.0, 2.0]]), np.zeros((1, 3), np.uint8))
    with pytest.raises(DeviceError, match="'npu'"):
        Trainer([view], [], points, Medium(), TrainingSettings(device="npu"))


def test_the_cpu_s_losses_are_the_reference_s():
    image = torch.rand(3, 21, 34, generator=torch.Generator().manual_seed(0))
    reference = backend_named("reference")
    torch.testing.assert_close(variation_gradient(image, 0.1), reference.variation_gradient(image, 0.1))
    torch.testing.assert_close(speck_gradient(image), reference.speck_gradient(image), rtol=1e-3, atol=1e-3)
    photo = torch.rand(3, 21, 34, generator=torch.Generator().manual_seed(1))
    ours, theirs = (backend_named(name).photometric(image, photo, None, 0.2) for name in ("cpu", "reference"))
    assert ours[0] == pytest.approx(theirs[0], rel=1e-5)
    torch.testing.assert_close(ours[1], theirs[1], rtol=1e-3, atol=1e-6)


@pytest.mark.parametrize("leading", [None, 3])
def test_the_cpu_s_step_of_adam_is_the_reference_s(leading):
    drawn = torch.randn(3, 50, 4, 3, generator=torch.Generator().manual_seed(0))
    found = []
    for name in ("cpu", "reference"):
        values, gradient, first = (t.clone() for t in drawn)
        gradient[7, 1, 2] = torch.nan
        numbers, refused = (0.1, 0.01, leading, 1.5, (0.9, 0.999), 1e-15), torch.ones(1, dtype=torch.int32)
        step = AdamStep(values, gradient, first, first.square(), *numbers, refused)
        backend_named(name).adam([step])
        assert int(step.refused) == 2  # (added to what was there)
        found.append((step.values, step.first, step.second))
    for ours, theirs in zip(*found, strict=True):
        torch.testing.assert_close(ours, theirs, rtol=1e-5, atol=1e-6)


def test_steps_of_the_optimizer_go_to_the_back_end(monkeypatch):
    toy = ToyBackend()
    monkeypatch.setitem(registry.REGISTRY, "cpu", Entry(lambda: toy, "cpu"))
    optimizer = Adam(a_splat())
    optimizer.gaussians.means.sum().backward()
    before = optimizer.gaussians.means.detach().clone()
    rates = dict.fromkeys(("means", "log_scales", "quaternions", "opacity_logits", "sh", "sh_rest"), 0.1)
    optimizer.step(rates)
    torch.testing.assert_close(optimizer.gaussians.means.detach(), before - 0.1)


def test_the_names_of_devices_load_no_torch():
    code = (
        "import run_dgs, sys; run_dgs.mount_package(); from dgs.core.devices import devices; devices();"
        " sys.exit('torch' in sys.modules or 'numba' in sys.modules)"
    )
    run = subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=False, capture_output=True, text=True)
    assert run.returncode == 0, run.stderr
