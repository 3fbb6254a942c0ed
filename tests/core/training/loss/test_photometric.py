"""The photometric loss: against its torch specification, on flat images, with masks."""

import numpy as np
import pytest
import torch
from dgs.core.training.loss.photometric import PhotometricLoss, photometric_reference, structural_similarity_map


def pair(height: int, width: int, seed: int = 0) -> tuple[torch.Tensor, torch.Tensor]:
    generator = torch.Generator().manual_seed(seed)
    photo = torch.rand(3, height, width, generator=generator)
    return photo + 0.1 * torch.randn(3, height, width, generator=generator), photo


@pytest.mark.parametrize("weight", [0.0, 0.2, 1.0])
@pytest.mark.parametrize(("height", "width"), [(3, 4), (40, 50), (33, 129), (70, 300), (120, 128)])
def test_value_and_gradient_match_the_specification(height, width, weight):
    image, photo = pair(height, width)
    value, gradient = PhotometricLoss(photo, ssim_weight=weight).value_and_gradient(image)
    x = image.double().requires_grad_()
    expected = photometric_reference(x, photo.double(), ssim_weight=weight)
    expected.backward()
    assert x.grad is not None
    assert value == pytest.approx(expected.item(), abs=1e-6)
    assert (gradient - x.grad).abs().max() < 2e-5 * x.grad.abs().max()


def test_specification_passes_gradcheck():
    image, photo = pair(7, 8)
    x = image.double().requires_grad_()
    assert torch.autograd.gradcheck(lambda v: photometric_reference(v, photo.double()), (x,))


def test_agrees_with_scikit_image():
    from skimage.metrics import structural_similarity

    image, photo = pair(60, 70)
    ours = structural_similarity_map(image.double(), photo.double())[:, 5:-5, 5:-5].mean()
    theirs = structural_similarity(
        image.double().numpy(),
        photo.double().numpy(),
        channel_axis=0,
        data_range=1.0,
        gaussian_weights=True,
        sigma=1.5,
        use_sample_covariance=False,
    )
    assert float(ours) == pytest.approx(float(theirs), abs=1e-7)


@pytest.mark.parametrize("level", [0.0, 0.3, 0.9999, 1.0])
@pytest.mark.parametrize("offset", [0.0, 1e-7, 1e-3])
def test_flat_images(level, offset):
    photo = torch.full((3, 40, 50), level)
    image = photo + offset
    assert structural_similarity_map(image, photo).max() <= 1 + 1e-6
    value, gradient = PhotometricLoss(photo, ssim_weight=1.0).value_and_gradient(image)
    assert -1e-6 <= value < 2.0 and torch.isfinite(gradient).all()
    assert gradient.abs().max() < 1e-2
    if offset == 0.0:
        assert abs(value) < 1e-6


def test_masked_nan_and_saturated_pixels_have_no_gradient():
    image, photo = pair(45, 150)
    generator = torch.Generator().manual_seed(5)
    mask = torch.rand(45, 150, generator=generator) > 0.3
    photo[1, 20:24, 30:40] = float("nan")
    photo[2, 5, 100] = 1.0
    image[:, ~mask] = float("nan")  # what the render holds there must not matter
    value, gradient = PhotometricLoss(photo, mask, saturation=1.0).value_and_gradient(image)
    assert np.isfinite(value) and torch.isfinite(gradient).all()
    assert (gradient[:, ~mask] == 0).all() and (gradient[1, 20:24, 30:40] == 0).all() and gradient[2, 5, 100] == 0
    x = image.double().requires_grad_()
    expected = photometric_reference(x, photo.double(), mask, saturation=1.0)
    assert value == pytest.approx(expected.item(), abs=1e-6)
    expected.backward()
    assert x.grad is not None and (gradient - x.grad).abs().max() < 2e-5 * x.grad.abs().max()


def test_masked_values_do_not_matter():
    image, photo = pair(30, 40)
    mask = torch.ones(30, 40)
    mask[10:20, 10:20] = 0
    loss = PhotometricLoss(photo, mask)
    value, gradient = loss.value_and_gradient(image)
    image[:, 10:20, 10:20] = 0.123
    again, same = loss.value_and_gradient(image)
    assert value == again and torch.equal(gradient, same)


def test_nothing_valid():
    image, photo = pair(12, 12)
    value, gradient = PhotometricLoss(photo, torch.zeros(12, 12)).value_and_gradient(image)
    assert value == 0.0 and (gradient == 0).all()
    assert float(photometric_reference(image, photo, torch.zeros(12, 12))) == 0.0


def test_autograd_wrapper_scales_the_gradient():
    image, photo = pair(20, 30)
    loss = PhotometricLoss(photo)
    x = image.clone().requires_grad_()
    (3.0 * loss(x)).backward()
    assert x.grad is not None and torch.allclose(x.grad, 3.0 * loss.value_and_gradient(image)[1])


def test_same_result_on_any_number_of_threads():
    from dgs.core import compiled

    image, photo = pair(150, 200)
    before, results = compiled.threads(), []
    try:
        for count in (1, 2, 3):
            compiled.set_threads(count)
            results.append(PhotometricLoss(photo).value_and_gradient(image))
    finally:
        compiled.set_threads(before)
    for value, gradient in results[1:]:
        assert value == results[0][0] and torch.equal(gradient, results[0][1])
