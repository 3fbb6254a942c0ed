"""Effects of image formation: gradients, inverses, gauges, and that off is free."""

import math

import pytest
import torch
from dgs.core.effects.defocus import Defocus
from dgs.core.effects.exposure import Exposure
from dgs.core.effects.field_blur import FieldBlur
from dgs.core.effects.haze import Haze
from dgs.core.effects.registry import switches
from dgs.core.effects.vignetting import Vignetting
from dgs.core.forward import FixedMedium
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Effect, Shot
from dgs.core.imaging.formation.glass import FrostedGlass, GlassScene
from dgs.core.imaging.formation.kernels import KERNELS, PhotoKernels
from dgs.core.imaging.formation.motion import CameraMotion
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf_text import parse_psf
from torch.utils._python_dispatch import TorchDispatchMode

H, W, M = 14, 18, 3


def shot(name: str = "b.png", dtype: torch.dtype = torch.float64) -> Shot:
    depth = torch.linspace(0.5, 2.5, (H + 2 * M) * (W + 2 * M), dtype=dtype).reshape(H + 2 * M, W + 2 * M)
    return Shot(name, H, W, M, depth=depth)


def photo_of(frame: torch.Tensor, medium: FixedMedium, formation: Formation, shot: Shot) -> torch.Tensor:
    """All that comes after rendering."""
    return formation.filed(medium.degraded(formation.passage(frame, shot).reached), shot)


def made(name: str) -> Effect:
    random = torch.Generator().manual_seed(1)

    def near(value: float, *size: int) -> torch.Tensor:
        return value + 0.1 * torch.randn(size, generator=random, dtype=torch.float64)

    if name == "exposure":
        return Exposure(("a.png", "b.png", "c.png"), near(0.1, 3, 3), near(0.0, 3, 3))
    if name == "defocus":
        return Defocus(near(0.08), near(1.0))
    if name == "glass":
        return FrostedGlass(near(0.05), near(0.3), GlassScene(1.0, math.hypot(W, H), 0.5, 2.5))
    if name == "field_blur":
        return FieldBlur(near(0.15))
    if name == "kernels":
        return PhotoKernels(("a.png", "b.png"), near(0.2, 2, 1 + KERNELS.side**2))
    if name == "motion":
        return CameraMotion(("a.png", "b.png"), near(0.0, 2, 3, 6))
    return {"vignetting": lambda: Vignetting(near(0.4, 3)), "haze": lambda: Haze(near(0.5, 3), near(0.6, 3))}[name]()


def picture(margin: int = 0) -> torch.Tensor:
    size = (3, H + 2 * margin, W + 2 * margin)
    return torch.rand(size, generator=torch.Generator().manual_seed(0), dtype=torch.float64) * 0.8 + 0.1


SIMULATED = {name: switch.simulation for name, switch in switches().items() if switch.simulation is not None}
LIGHT = [name for name, effect in SIMULATED.items() if effect.place != "camera"]


@pytest.mark.parametrize("name", LIGHT)
def test_gradients_are_those_of_the_forward_pass(name):
    effect = made(name)
    margin = M if effect.place == "light" else 0
    light = picture(margin).requires_grad_()
    for value in effect.parameters.values():
        value.requires_grad_()
    weight = torch.randn(light.shape, generator=torch.Generator().manual_seed(2), dtype=torch.float64)
    (effect.forward(light, shot()) * weight).sum().backward()
    with torch.no_grad():
        gradient = effect.gradient(weight, light.detach(), shot())
    assert torch.allclose(gradient, light.grad, rtol=1e-10, atol=1e-12)
    assert set(effect.gradients) == set(effect.parameters)
    for key, value in effect.parameters.items():
        assert torch.allclose(effect.gradients[key], value.grad, rtol=1e-10, atol=1e-10), key


@pytest.mark.parametrize("name", list(SIMULATED))
def test_every_effect_says_its_physics(name):
    effect = made(name)
    assert effect.name == name and effect.physics.endswith(".") and len(effect.physics) > 40
    assert effect.described()
    if effect.place == "sensor":
        light = picture()
        assert torch.allclose(effect.undone(effect.forward(light, shot()), shot()), light, atol=1e-12)


@pytest.mark.parametrize("name", list(SIMULATED))
def test_a_moving_camera_alone_blurs_without_spreading_light(name):
    """Steps are given by it: photos that their own motion blurs get as many as sharp ones."""
    found, spreading = Formation([made(name)]), ("defocus", "glass", "field_blur", "kernels")
    assert found.spreads == (name in spreading)
    assert found.blurs == (name in (*spreading, "motion"))


def test_haze_is_koschmieder_s_law():
    haze = Haze(torch.tensor([0.5] * 3), torch.tensor([0.8] * 3))
    dark = torch.full((3, 1, 1), 0.2)
    near, far = (haze.forward(dark, Shot("", 1, 1, depth=torch.full((1, 1), d))) for d in (0.0, 50.0))
    assert torch.allclose(near, torch.tensor(0.2)) and torch.allclose(far, torch.tensor(0.8))
    once = haze.forward(dark, Shot("", 1, 1, depth=torch.ones(1, 1)))
    assert float(once[0]) == pytest.approx(0.2 * math.exp(-0.5) + 0.8 * (1 - math.exp(-0.5)))


def test_vignetting_takes_from_the_corners_only():
    passed = Vignetting(torch.tensor([0.3] * 3)).forward(torch.ones(3, 101, 151), Shot("", 101, 151))
    assert float(passed[0, 50, 75]) == pytest.approx(1.0, abs=1e-3)
    assert float(passed[0, 0, 0]) == pytest.approx(0.7, abs=0.01)


def test_exposure_keeps_its_gauge_and_leaves_strangers_alone():
    exposure = made("exposure")
    exposure.settle()
    assert float(exposure.parameters["log_gains"].mean(dim=0).abs().max()) < 1e-12
    light = picture()
    assert exposure.forward(light, shot("unknown.png")) is light


@pytest.mark.parametrize("space", ["srgb", "linear"])
def test_the_chain_s_gradient(space):
    formation = Formation([made("haze"), made("vignetting"), made("exposure")])
    frame = picture(M).requires_grad_()
    weight = torch.randn(frame.shape, generator=torch.Generator().manual_seed(3), dtype=torch.float64)
    (formation.passage(frame, shot()).reached * weight).sum().backward()
    passage = formation.passage(frame.detach(), shot())
    gradient = passage.gradient(weight)
    assert torch.allclose(gradient, frame.grad, rtol=1e-9, atol=1e-12)
    blur = BlurOperator(parse_psf("gaussian:0.7"), H, W, M, dtype=torch.float64)
    medium = FixedMedium(blur, space)
    photo = photo_of(frame.detach(), medium, formation, shot())
    assert photo.shape == (3, H, W)
    inner = medium.degraded(passage.reached)
    unclipped = (photo > 0.001) & (photo < 0.999)
    assert unclipped.any() and torch.allclose(formation.unfiled(photo, shot())[unclipped], inner[unclipped], atol=1e-9)


def test_motion_leaves_light_and_the_rest_of_the_chain_alone():
    motion, light = made("motion"), picture()
    chain = Formation([made("haze"), motion])
    assert motion.forward(light, shot()) is light and motion.gradient(light, light, shot()) is light
    assert chain.motion is motion and chain.names == ("haze", "motion") and Formation().motion is None
    frame = picture(M)
    crop = FixedMedium(BlurOperator(None, H, W, M, dtype=torch.float64), "linear")
    haze = Formation([chain.effects[0]])
    assert haze.scaled(2.0) is haze
    assert torch.equal(photo_of(frame, crop, chain, shot()), photo_of(frame, crop, haze, shot()))


class Operations(TorchDispatchMode):
    def __init__(self):
        super().__init__()
        self.names = []

    def __torch_dispatch__(self, func, types, args=(), kwargs=None):
        self.names.append(str(func))
        return func(*args, **(kwargs or {}))


@pytest.mark.parametrize("space", ["srgb", "linear"])
@pytest.mark.parametrize("psf", ["none", "gaussian:1"])
def test_off_is_free(space, psf):
    frame, here = picture(M).float(), shot()
    medium = FixedMedium(BlurOperator(parse_psf(psf), H, W, M), space)
    with Operations() as plain:
        expected = medium.degraded(frame)
    with Operations() as off:
        found = photo_of(frame, medium, Formation(), here)
    assert torch.equal(found, expected) and off.names == plain.names
    with Operations() as nothing:
        passage = Formation().passage(frame, here)
        assert passage.reached is frame and Formation().unfiled(expected, here) is expected
        assert passage.gradient(frame) is frame
    assert nothing.names == [] and not Formation()
    with Operations() as on:
        photo_of(frame, medium, Formation([Vignetting(torch.tensor([0.2] * 3))]), here)
    assert len(on.names) > len(plain.names)  # the counter does count


def test_effects_are_taken_where_they_act():
    formation = Formation([made(name) for name in ("haze", "exposure", "vignetting")])
    assert [effect.name for effect in formation.sensor] == [made("exposure").name, made("vignetting").name]


def test_gradients_of_several_photos_add_up():
    effect = made("vignetting")
    for value in (2.0, 3.0, 0.5):
        effect._add("amount", torch.tensor([value, -value]))
    assert effect.gradients["amount"].tolist() == [5.5, -5.5]


@pytest.mark.parametrize("name", SIMULATED)
def test_what_spreads_light_is_called_a_blur(name: str) -> None:
    assert not Formation().blurs
    assert Formation([made(name)]).blurs == (name in ("defocus", "field_blur", "glass", "kernels", "motion"))
