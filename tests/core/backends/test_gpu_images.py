"""What a training step does with images, on the graphics card: against the specification in float64, without a byte of
an image on the bus."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
import torch
from dgs.core.devices import backend_named
from dgs.core.frames import Frame
from dgs.core.imaging.operator import BlurOperator
from dgs.core.imaging.psf import PointSpread, point_spread_from_samples
from dgs.core.imaging.psf_text import parse_psf


from dgs.tests.back_ends import or_skip

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


def brought_up(tensor: torch.Tensor) -> torch.Tensor:
    """A tensor whose values lie on the card and nowhere else, as those that shaders make."""
    found = tensor.to("gpu")
    found.held.for_card()  # type: ignore[attr-defined]
    found.held.changed_on_card()  # type: ignore[attr-defined]
    return found


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


@pytest.mark.parametrize("size", [(1, 2), (4, 5), (15, 16), (48, 50), (27, 125)])
def test_fourier_transforms(card, size):
    image = drawn(2, *size)
    on_card = brought_up(image)
    torch.fft.irfft2(torch.fft.rfft2(on_card), s=size)  # (tables of turns)
    with nothing_crosses(card):
        spectrum = torch.fft.rfft2(on_card)
        back = torch.fft.irfft2(spectrum, s=size)
    wanted = torch.fft.rfft2(image.double())
    assert (spectrum.cpu() - wanted).abs().max() < 1e-5 * wanted.abs().max()
    agrees(back, image, 1e-5)
    by_roots = torch.fft.irfft2(torch.fft.rfft2(on_card, norm="ortho"), s=size, norm="ortho")
    agrees(by_roots, image, 1e-5)


def test_lengths_with_large_factors_are_torch_s_own(card):
    image = drawn(2, 14, 22)
    spectrum = torch.fft.rfft2(brought_up(image))
    torch.testing.assert_close(torch.fft.irfft2(spectrum, s=(14, 22)).cpu(), image, rtol=1e-5, atol=1e-5)
