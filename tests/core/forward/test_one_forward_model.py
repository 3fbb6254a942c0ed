"""Nothing in the engine but the forward model renders, blurs or compares; its parts fit each other's gradients."""

from __future__ import annotations

import ast
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.effects.vignetting import Vignetting
from dgs.core.forward import FixedMedium, ForwardModel, SubFrame, low_pass_on_grid, margin_for, medium_of, sharp_view
from dgs.core.forward.compare import mean_square, psnr_of
from dgs.core.frames import Frame
from dgs.core.gaussians import Gaussians
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.psf import PointSpread
from dgs.core.rasterizer import RasterSettings

CORE = Path(__file__).resolve().parents[3] / "core"
#: What renders and blurs, and who may import it besides the module that defines it: the ladders of an effect whose blur
#: varies over the frame, without and with what is near hiding what is behind it, are made of it.
PARTS = {
    "render": ("forward/",),
    "BlurOperator": ("forward/", "imaging/formation/layered.py", "imaging/formation/occluding.py"),
    "shared_operator": ("forward/",),
}
WIDTH, HEIGHT, MARGIN = 40, 32, 5
PSF = PointSpread(sigma_x=1.5, sigma_y=1.5)


def imported(source: str) -> set[tuple[str, str]]:
    """(module, name) of everything that is imported from somewhere, wherever in the file it stands."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ImportFrom)]
    return {(node.module or "", alias.name) for node in nodes for alias in node.names}


def test_only_the_forward_model_renders_and_blurs() -> None:
    wrong = []
    for file in sorted(CORE.rglob("*.py")):
        place = file.relative_to(CORE).as_posix()
        for module, name in imported(file.read_text("utf-8")):
            of_the_parts = "rasterizer" in module or "operator" in module or module in ("interface", "render")
            if name in PARTS and of_the_parts and not place.startswith((*PARTS[name], "rasterizer/__init__")):
                wrong.append(f"{place}: {name}")
    assert wrong == []


def test_the_reader_finds_who_renders() -> None:
    assert ("rasterizer", "render") in imported("def f():\n    from ..rasterizer import render\n")


def test_the_rule_of_the_low_pass_stands_once() -> None:
    sources = {file: file.read_text("utf-8") for file in CORE.rglob("*.py") if "forward" not in file.parts}
    assert [file for file, text in sources.items() if "max(0.1, 0.3" in text or "max(0.1, low_pass" in text] == []
    assert low_pass_on_grid(1) == 0.3 and low_pass_on_grid(3) == 0.1 and low_pass_on_grid(2, 2.0) == 0.5


def test_the_rule_of_the_margin() -> None:
    assert margin_for(0.0) == 0 and margin_for(5.0) == 15 and margin_for(5.0, 2) == 8


@dataclass(frozen=True)
class View:
    camera: Camera
    psf: PointSpread | None = PSF
    name: str = "a.png"


def camera(x: float = 0.0) -> Camera:
    return Camera("a.png", WIDTH, HEIGHT, 40.0, 40.0, WIDTH / 2, HEIGHT / 2, np.eye(3), np.array([-x, 0.0, 0.0]))


def gaussians(count: int = 60) -> Gaussians:
    random = torch.Generator().manual_seed(0)
    drawn = lambda *shape: torch.rand(shape, generator=random)  # noqa: E731
    return Gaussians(
        torch.cat([2.0 * drawn(count, 2) - 1.0, 2.0 + drawn(count, 1)], dim=1),
        torch.full((count, 3), -2.5),
        torch.tensor([[1.0, 0.0, 0.0, 0.0]]).repeat(count, 1),
        drawn(count) * 2,
        drawn(count, 1, 3) - 0.3,
    ).requires_grad_()


def medium(space: str = "srgb") -> FixedMedium:
    return medium_of(PSF, Frame(HEIGHT, WIDTH, MARGIN), space)  # type: ignore[arg-type]


def model(space: str = "srgb", formation: Formation = Formation()) -> ForwardModel:
    return ForwardModel(RasterSettings(), lambda _: medium(space), MARGIN, formation)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_stages_follow_each_other(space: str) -> None:
    vignetting = Formation([Vignetting(torch.tensor([0.3] * 3))])
    exposed = model(space, vignetting).expose(gaussians(), View(camera()))
    assert exposed.reached.shape == (3, HEIGHT + 2 * MARGIN, WIDTH + 2 * MARGIN)
    assert exposed.degraded.shape == exposed.photo.shape == (3, HEIGHT, WIDTH)
    assert torch.equal(exposed.degraded, medium(space).degraded(exposed.renders[0].image.detach()))
    assert float(exposed.photo[:, 0, 0].sum()) < float(exposed.degraded[:, 0, 0].sum())
    photo = torch.zeros(3, HEIGHT, WIDTH)
    assert torch.equal(exposed.residual(photo), -exposed.degraded)


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_the_gradient_of_the_whole_chain(space: str) -> None:
    """Directional derivative of a sum over the photo: by the chain's gradient and by a difference."""
    twin, weight = gaussians(), torch.randn(3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    exposed = model(space).expose(twin, View(camera()))
    exposed.backward(exposed.medium.gradient(weight, exposed.reached))
    assert twin.sh.grad is not None
    step = torch.randn(twin.sh.shape, generator=torch.Generator().manual_seed(2))
    found = []
    for sign in (1.0, -1.0):
        moved = twin.detached()
        moved.sh = moved.sh + sign * 1e-3 * step
        found.append(float((model(space).expose(moved, View(camera())).degraded * weight).double().sum()))
    expected = (found[0] - found[1]) / 2e-3
    assert float((twin.sh.grad * step).sum()) == pytest.approx(expected, rel=0.02, abs=0.02)


class TwoMoments(FixedMedium):
    """A toy of a medium to come: half of the light came before the camera had moved."""

    moved = 0.05

    def sub_frames(self, camera: Camera) -> list[SubFrame]:
        pose = torch.from_numpy(np.concatenate([camera.rotation, camera.translation[:, None]], axis=1))
        self.pose = pose.float().requires_grad_()
        with torch.no_grad():
            self.pose[0, 3] += self.moved
        return [SubFrame(camera, weight=0.5), SubFrame(camera, self.pose, 0.5)]


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_a_medium_may_ask_for_several_renders_and_learn_poses(space: str) -> None:
    twin = gaussians()
    two = TwoMoments(medium(space).blur, space)  # type: ignore[arg-type]
    whole = ForwardModel(RasterSettings(), lambda _: two, MARGIN)
    exposed = whole.expose(twin, View(camera()))
    assert len(exposed.frames) == 2
    alone = [rendered.image.detach() for rendered in exposed.renders]
    still = sharp_view(twin, camera().with_margin(MARGIN), RasterSettings()).image.detach()
    assert torch.equal(alone[0], still) and not torch.allclose(alone[1], still)
    if space == "srgb":
        torch.testing.assert_close(exposed.reached, (alone[0] + alone[1]) / 2)
    weight = torch.randn(3, HEIGHT, WIDTH, generator=torch.Generator().manual_seed(1))
    exposed.backward(exposed.medium.gradient(weight, exposed.reached))
    assert twin.sh.grad is not None and two.pose.grad is not None
    assert float(two.pose.grad.abs().max()) > 0.0
    step = torch.randn(twin.sh.shape, generator=torch.Generator().manual_seed(2))
    found = []
    for sign in (1.0, -1.0):
        moved = twin.detached()
        moved.sh = moved.sh + sign * 1e-3 * step
        found.append(float((whole.expose(moved, View(camera())).degraded * weight).double().sum()))
    expected = (found[0] - found[1]) / 2e-3
    assert float((twin.sh.grad * step).sum()) == pytest.approx(expected, rel=0.02, abs=0.02)


def test_comparing() -> None:
    residual = torch.full((3, 4, 5), 0.1)
    residual[:, 0] = 1.0
    valid = torch.ones(4, 5, dtype=torch.bool)
    valid[0] = False
    assert mean_square(residual, valid) == pytest.approx(0.01) and mean_square(residual) > 0.2
    assert mean_square(residual.numpy(), valid.numpy()) == pytest.approx(0.01)
    assert psnr_of([0.01]) == pytest.approx(20.0) and psnr_of([0.0]) == pytest.approx(100.0)
