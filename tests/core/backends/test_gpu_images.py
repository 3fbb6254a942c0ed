"""What a training step does with images, on the graphics card: against the specification in float64, without a byte of
an image on the bus."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from dgs.core.colour import srgb_to_linear
from dgs.core.devices import LevelCurve, Missing, backend_named
from dgs.core.frames import Frame
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.imaging.spectrum import BINS, NoiseToSignal
from dgs.core.training.loss.objective import Inverse, Objective
from dgs.core.training.loss.specks import speck_price
from dgs.core.training.settings import TrainingSettings
from dgs.tests.back_ends import brought_up, or_skip

#: Of float64's largest value; single precision and other orders of sums.
CLOSE, CLOSE_GRADIENT = 1e-4, 1e-3
LOPSIDED = point_spread_from_samples(np.array([[0, 0, 1, 0], [0, 2, 5, 1], [0, 6, 9, 3], [0, 1, 5, 2], [0, 0, 1, 0.0]]))


@pytest.fixture
def card():
    or_skip("gpu")
    from dgs.core.backends.gpu.card import card

    return card()


@contextmanager
def nothing_crosses(card, bytes_down: int = 0) -> Iterator[None]:
    """Nothing is brought up inside, and no more than `bytes_down` come back."""
    card.traffic.up = card.traffic.down = 0
    yield
    assert card.traffic.up == 0 and card.traffic.down <= bytes_down, card.traffic


def drawn(*shape: int, seed: int = 0) -> torch.Tensor:
    return torch.rand(*shape, generator=torch.Generator().manual_seed(seed))


def agrees(found: torch.Tensor, wanted: torch.Tensor, limit: float = CLOSE) -> None:
    off = (found.cpu().double() - wanted.double()).abs().max() / wanted.abs().max()
    assert off < limit, float(off)


def spread(name: str) -> PointSpread:
    psf = LOPSIDED if name == "lopsided" else parse_psf(name)
    assert psf is not None
    return psf


@pytest.mark.parametrize(
    ("name", "margin", "evaluation"),
    [
        *((name, margin, "separable") for name in ("gaussian:4", "gaussian:1.2,3,0") for margin in (0, 3, 14)),
        *((name, margin, "direct") for name in ("gaussian:2,1,40", "lopsided") for margin in (0, 1, 9)),
        *((name, margin, "fourier") for name in ("gaussian:4", "lopsided") for margin in (0, 14)),
        ("gaussian:4", 5, "reduced"),
    ],
)
def test_blurs_are_the_reference_s(card, name, margin, evaluation):
    height, width = 37, 50
    frame, photo = drawn(3, height + 2 * margin, width + 2 * margin), drawn(3, height, width, seed=1)
    wanted = BlurOperator(spread(name), height, width, margin, dtype=torch.float64, evaluation=evaluation)
    ours = BlurOperator(spread(name), height, width, margin, device="gpu", evaluation=evaluation)
    on_card, of_photo = brought_up(frame), brought_up(photo)
    ours.apply(on_card), ours.adjoint(of_photo)  # (taps and transfer functions go up once)
    with nothing_crosses(card):
        found, back = ours.apply(on_card), ours.adjoint(of_photo)
    agrees(found, wanted.apply(frame.double()))
    agrees(back, wanted.adjoint(photo.double()))
    there, again = float((found.cpu().double() * photo).sum()), float((back.cpu().double() * frame).sum())
    assert there == pytest.approx(again, rel=1e-5)


@pytest.mark.parametrize(("height", "width"), [(1, 1), (1, 9), (9, 1), (2, 40)])
def test_the_separable_blur_of_narrow_frames(card, height, width):
    taps = np.array([0.05, 0.25, 0.4, 0.25, 0.05])
    for margin in (0, 1, 4):
        frame = Frame(height, width, margin)
        ours = backend_named("gpu").blurs(np.outer(taps, taps), (taps, taps), frame, torch.float32)["separable"]
        theirs = backend_named("cpu").blurs(np.outer(taps, taps), (taps, taps), frame, torch.float64)["separable"]
        x, y = drawn(2, *frame.rendered), drawn(2, height, width, seed=1)
        agrees(ours.apply(brought_up(x)), theirs.apply(x.double()))
        agrees(ours.adjoint(brought_up(y)), theirs.adjoint(y.double()))


#: Complex numbers that a group of the card's threads holds.
LINE_VALUES = 2048


@pytest.mark.parametrize(
    "size", [(1, 2), (4, 5), (15, 16), (48, 50), (27, 125), (6, 1458), (2048, 2), (2, 2500), (2187, 3), (1500, 1)]
)
def test_fourier_transforms(card, size):
    image = drawn(2, *size)
    on_card = brought_up(image)
    torch.fft.irfft2(torch.fft.rfft2(on_card), s=size)  # (tables of turns)
    card.traffic.orders = 0
    with nothing_crosses(card):
        spectrum = torch.fft.rfft2(on_card)
        back = torch.fft.irfft2(spectrum, s=size)
    assert card.traffic.orders == 4 or max(size) > LINE_VALUES, "an axis is an order, where a group holds a line"
    wanted = torch.fft.rfft2(image.double())
    assert (spectrum.cpu() - wanted).abs().max() < 1e-5 * wanted.abs().max()
    agrees(back, image, 1e-5)
    by_roots = torch.fft.irfft2(torch.fft.rfft2(on_card, norm="ortho"), s=size, norm="ortho")
    agrees(by_roots, image, 1e-5)


def test_lengths_with_large_factors_are_torch_s_own(card):
    image = drawn(2, 14, 22)
    spectrum = torch.fft.rfft2(brought_up(image))
    torch.testing.assert_close(torch.fft.irfft2(spectrum, s=(14, 22)).cpu(), image, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("masked", ["nothing", "a plane", "each value", "all", "not finite"])
def test_photos_with_masks(card, masked):
    """Value and gradient; what does not count has a gradient of exactly 0, whatever stands there."""
    image = drawn(3, 37, 50)
    photo = 0.7 * image + 0.3 * drawn(3, 37, 50, seed=1)
    keep = {"a plane": drawn(37, 50, seed=2) > 0.3, "each value": drawn(3, 37, 50, seed=2) > 0.3}.get(masked)
    if masked == "all":
        keep = torch.zeros(37, 50, dtype=torch.bool)
    if masked in ("each value", "not finite"):
        photo[1, 3:9, 4:30] = torch.nan
        photo[0, 20, 20] = torch.inf
    wanted, slope_wanted = backend_named("reference").photometric(image.double(), photo.double(), keep, 0.2)
    on_card, taken = brought_up(image), brought_up(photo)
    mask = None if keep is None else brought_up(keep)
    with nothing_crosses(card, bytes_down=16):
        value, slope = backend_named("gpu").photometric(on_card, taken, mask, 0.2)
    assert float(value) == pytest.approx(wanted, rel=CLOSE)
    if masked == "all":
        assert not slope.cpu().any()
        return
    agrees(slope, slope_wanted, CLOSE_GRADIENT)
    counts = torch.isfinite(photo) if keep is None else torch.isfinite(photo) & keep
    assert not slope.cpu()[~counts].any()


@pytest.mark.parametrize("size", [(1, 1), (3, 70), (8, 32), (9, 33), (40, 11), (261, 130)])
def test_photos_of_all_sizes(card, size):
    """Windows are summed up block by block: frames smaller than one, as large as one, a px larger, and many of them."""
    image, photo = drawn(3, *size), drawn(3, *size, seed=1)
    wanted, slope_wanted = backend_named("reference").photometric(image.double(), photo.double(), None, 0.2)
    of = brought_up(image), brought_up(photo), None, 0.2
    (value, slope), (again, slope_again) = (backend_named("gpu").photometric(*of) for _ in range(2))
    assert float(value) == pytest.approx(wanted, rel=CLOSE)
    agrees(slope, slope_wanted, CLOSE_GRADIENT)
    assert float(value) == float(again) and torch.equal(slope.cpu(), slope_again.cpu())


def test_the_price_of_specks(card):
    image = drawn(3, 37, 50)
    image[:, :12, :12] = 0.25  # flat
    image[:, 20:, 30:] = 0.8  # and an edge
    leaf = image.double().requires_grad_()
    (wanted,) = torch.autograd.grad(speck_price(leaf), leaf)
    on_card = brought_up(image)
    with nothing_crosses(card):
        found = backend_named("gpu").speck_gradient(on_card)
    agrees(found, wanted, CLOSE_GRADIENT)


@pytest.mark.parametrize("size", [(1, 1), (2, 9), (8, 32), (37, 50)])
@pytest.mark.parametrize("added", [False, True])
def test_smoothness_is_added_in_one_order(card, size, added):
    """Variation and specks with their weights, to what stands there or alone."""
    image, before = drawn(3, *size), drawn(3, *size, seed=1)
    ours, theirs = backend_named("gpu"), backend_named("reference")
    on_card = brought_up(image)
    for function, numbers in (("add_variation", (0.1, 0.3)), ("add_specks", (0.7,))):
        wanted = getattr(theirs, function)(before.double() if added else None, image.double(), *numbers)
        into = brought_up(before.clone()) if added else None
        card.traffic.orders = 0
        with nothing_crosses(card):
            found = getattr(ours, function)(into, on_card, *numbers)
        assert card.traffic.orders == 1 and (found is into or not added)
        torch.testing.assert_close(found.cpu().double(), wanted, rtol=CLOSE_GRADIENT, atol=1e-6)
        part = brought_up(before.repeat(2, 1, 1))[3:] if added else None  # (a part of a tensor is torch's to change)
        found = getattr(ours, function)(part, on_card, *numbers)
        torch.testing.assert_close(found.cpu().double(), wanted, rtol=CLOSE_GRADIENT, atol=1e-6)


@pytest.mark.parametrize("masked", ["nothing", "a plane", "each value"])
def test_residuals(card, masked):
    photo, blurred = drawn(3, 21, 34), drawn(3, 21, 34, seed=1)
    photo[1, 3:9, 4:30], blurred[2, 5] = torch.nan, torch.inf
    valid = {"a plane": drawn(21, 34, seed=2) > 0.3, "each value": drawn(3, 21, 34, seed=2) > 0.3}.get(masked)
    wanted = backend_named("reference").residual(photo, blurred, valid, 3, (40, 45))
    mask, taken = None if valid is None else brought_up(valid), (brought_up(photo), brought_up(blurred))
    with nothing_crosses(card):
        found = backend_named("gpu").residual(*taken, mask, 3, (40, 45))
    assert torch.equal(found.cpu(), wanted) and wanted.isfinite().all()


@pytest.mark.parametrize("kinds", [(False, False), (True, False), (False, True), (True, True)])
def test_colours_filtered_together(card, kinds):
    own, shared = (
        torch.complex(drawn(9, 7, seed=n), drawn(9, 7, seed=n + 2)) if kind else drawn(9, 7, seed=n)
        for n, kind in enumerate(kinds, 1)
    )
    spectrum = torch.complex(drawn(3, 9, 7, seed=5), drawn(3, 9, 7, seed=6))
    wanted = backend_named("reference").filter_colours(spectrum.clone(), own, shared)
    there, transfers = brought_up(spectrum.clone()), (brought_up(own), brought_up(shared))
    with nothing_crosses(card):
        found = backend_named("gpu").filter_colours(there, *transfers)
    assert found is there
    torch.testing.assert_close(found.cpu(), wanted, rtol=1e-5, atol=1e-5)
    as_conjugate = backend_named("gpu").filter_colours(brought_up(spectrum.clone()), brought_up(own).conj(), shared)
    wanted = backend_named("reference").filter_colours(spectrum.clone(), own.conj(), shared)
    torch.testing.assert_close(as_conjugate.cpu(), wanted, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("masked", ["nothing", "a plane", "each value"])
@pytest.mark.parametrize("linear", [False, True])
@pytest.mark.parametrize("width", [0.0, 0.2])
def test_what_is_missing_draws_the_gradient(card, masked, linear, width):
    values, gradient, image = drawn(3, 40, 45) - 0.5, drawn(3, 27, 40, seed=1), drawn(3, 27, 40, seed=2)
    image[:, :5] *= 0.03  # where the decoding curve is straight
    valid = {"a plane": drawn(21, 34, seed=3) > 0.3, "each value": drawn(3, 21, 34, seed=3) > 0.3}.get(masked)
    found = {}
    for name in ("reference", "gpu"):
        taken = brought_up if name == "gpu" else torch.Tensor.clone
        into, here, light = taken(gradient.clone()), taken(image), taken(srgb_to_linear(image))
        missing = Missing(
            taken(values)[:, :27, :40],
            3,
            None if valid is None else taken(valid),
            width,
            0.4,
            (here, light, 0.1) if linear else None,
        )
        with nothing_crosses(card):
            backend_named(name).draw(into, missing)
        found[name] = into.cpu()
    torch.testing.assert_close(found["gpu"], found["reference"], rtol=1e-5, atol=1e-6)
    assert not torch.equal(found["gpu"], gradient)


HEIGHT, WIDTH, MARGIN = 40, 54, 9


def ratio(colour: float = 3e-4) -> NoiseToSignal:
    return NoiseToSignal(np.full(BINS, 1e-4), np.full(BINS, colour), 0.001)


def test_the_inverted_residual_itself(card):
    psf, size = spread("gaussian:2"), (HEIGHT, WIDTH)
    residual = drawn(3, *size) - 0.5
    residual[:, -3:] = 0.0
    mine, theirs = (Inverse(psf, *size, ratio(), torch.device(device)) for device in ("gpu", "cpu"))
    for name in ("_colour", "_difference"):
        setattr(theirs, name, getattr(theirs, name).double())
    on_card = brought_up(residual)
    mine.apply(on_card)
    with nothing_crosses(card):
        found = mine.apply(on_card)
    agrees(found, theirs.apply(residual.double()))


@pytest.mark.parametrize("phase", ["loss", "start_loss"])
@pytest.mark.parametrize("space", ["srgb", "linear"])
@pytest.mark.parametrize("masked", [False, True])
def test_the_objective_of_blurred_photos(card, phase, space, masked):
    """All that drives a render: the photo (and its mask) goes up once, with its margin where it is sharpened; nothing
    comes down but the loss."""
    frame, psf = Frame(HEIGHT, WIDTH, MARGIN), spread("gaussian:2")
    image, photo = drawn(3, *frame.rendered), drawn(3, HEIGHT, WIDTH, seed=1)
    image = torch.nn.functional.avg_pool2d(image, 5, 1, 2)
    valid = None
    if masked:
        valid = torch.ones(HEIGHT, WIDTH, dtype=torch.bool)
        valid[5:15, 20:44] = False
    settings = TrainingSettings(blur_evaluation="separable")
    found = {}
    for device in ("cpu", "gpu"):
        objective = Objective(psf, frame, space, settings, torch.device(device), ratio())
        rendered = image if device == "cpu" else brought_up(image)
        for _ in range(2):  # (tables go up once)
            card.traffic.up = card.traffic.down = card.traffic.orders = 0
            mask = None if valid is None else valid.to(device)
            found[device] = getattr(objective, phase)(rendered, photo.to(device), mask)
    pixels = HEIGHT * WIDTH
    assert card.traffic.up == 12 * pixels + (pixels if masked else 0) and card.traffic.down == 0
    assert float(found["gpu"].loss) == pytest.approx(float(found["cpu"].loss), rel=CLOSE)
    # (sums in another order turn the sign of a few differences next to zero; all others agree)
    off = (found["gpu"].gradient.cpu() - found["cpu"].gradient).abs() / found["cpu"].gradient.abs().max()
    assert off.max() < CLOSE_GRADIENT
    assert card.traffic.orders <= {"srgb": 17, "linear": 50}[space], "each costs more than a small image's shader"


def test_the_objective_of_sharp_photos_takes_five_orders(card):
    frame = Frame(HEIGHT, WIDTH, 0)
    objective = Objective(None, frame, "srgb", TrainingSettings(), torch.device("gpu"))
    image, photo = brought_up(drawn(3, HEIGHT, WIDTH)), brought_up(drawn(3, HEIGHT, WIDTH, seed=1))
    card.traffic.orders = 0
    found = objective.loss(image, photo, None)
    assert card.traffic.orders <= 5 and found.gradient.held.only_on_card


def test_another_exposure_is_the_reference_s(card):
    """Levels of three curves, px that may be clipped either way among them; nothing but the curve goes up."""
    photo, shown = drawn(3, 30, 41), drawn(3, 30, 41, seed=1)
    photo[:, :5], photo[:, 5:9] = 1.0, 0.0
    levels = torch.linspace(0.0, 1.0, 1024)
    table = torch.stack([levels**power for power in (0.8, 1.0, 1.3)])
    curve = LevelCurve(table, torch.tensor([1000, 1023, 1024]), torch.tensor([9, 1, 0]), torch.tensor([0.02, 0.3, 0.1]))
    wanted = backend_named("reference").reexposed(photo, shown, curve)
    assert (wanted != backend_named("reference").reexposed(photo, torch.full_like(shown, 0.5), curve)).any()
    on_card, render = brought_up(photo), brought_up(shown)
    card.traffic.up = card.traffic.down = 0
    found = backend_named("gpu").reexposed(on_card, render, curve)
    assert card.traffic.up == 4 * table.numel() and card.traffic.down == 0
    torch.testing.assert_close(found.cpu(), wanted, rtol=0, atol=1e-7)
