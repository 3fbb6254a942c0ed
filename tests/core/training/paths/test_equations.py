"""What a step of a path is taken from: the compiled kernels say what plain torch says."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from dgs.core.colour import srgb_to_linear
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.formation.path_poses import middles, polynomials
from dgs.core.imaging.formation.row_windows import over_photo, row_ends
from dgs.core.tone_curve import ToneCurve
from dgs.core.training.paths.along import Along, changed_by
from dgs.core.training.paths.equations import PathEquations, SeenPx
from dgs.core.training.paths.slopes import Looked, Sampled, change_by
from dgs.core.training.paths.straight_ways import left_by_ways
from dgs.tests.core.training.moved_photos import exposed_by
from dgs.tests.core.training.training_scenes import blurred_scene


@pytest.fixture(scope="module")
def scene():
    return blurred_scene()


def along(scene, curve, readout, most):
    """A photo of a shaken camera, and its shares of each part of the path."""
    camera = scene.views[0].camera
    motion = straight_paths({camera.name: (6.0 / camera.fx, 3.0 / camera.fx)}, 4).rolling(readout)
    motion.curve = curve
    exposed = exposed_by(scene, camera, motion)
    looked, count = Looked(exposed, Sampled.of(camera.height, camera.width, most)), len(exposed.frames)
    basis = polynomials(middles(count), 4).T / count
    rows = motion.row_weights(count, camera.height, camera.width, exposed.shot.margin)
    return looked, basis if rows is None else basis[..., None, None] * (count * rows)


@pytest.mark.parametrize("curve", [ToneCurve(), ToneCurve(0.4, 0.3)], ids=["srgb", "own"])
@pytest.mark.parametrize("readout", [0.0, 1.0])
@pytest.mark.parametrize("most", [12_000, 900])
def test_slopes_in_one_pass_are_those_of_torch(scene, curve, readout, most):
    looked, basis = along(scene, curve, readout, most)
    own, wanted = Along.of(looked, basis, True), Along.in_torch(looked, basis, True)
    for name in ("right", "down", "by_curve"):
        found, true = getattr(own, name), getattr(wanted, name)
        assert found.shape == true.shape and float(true.abs().max()) > 1e-3
        assert torch.allclose(found, true, atol=2e-5 * float(true.abs().max()), rtol=1e-4), name
    assert Along.of(looked, basis, False).by_curve is None


def test_a_shutter_that_rolls_over_columns_is_asked_in_torch(scene):
    looked, _ = along(scene, ToneCurve(), 0.0, 900)
    _, width = looked.whole.shape[-2:]
    columns = torch.full((5, len(looked.whole), 1, width), 0.1)
    found = Along.of(looked, columns, False)
    assert torch.equal(found.right, Along.in_torch(looked, columns, False).right)


@pytest.mark.parametrize("curve", [ToneCurve(), ToneCurve(0.4, 0.3)], ids=["srgb", "own"])
@pytest.mark.parametrize("readout", [0.0, 1.0])
@pytest.mark.parametrize("most", [12_000, 900])
def test_what_a_shutter_changes_is_what_torch_says(scene, curve, readout, most):
    looked, _ = along(scene, curve, readout, most)
    height, margin = looked.exposed.shot.height, looked.exposed.shot.margin
    ends = over_photo(row_ends(len(looked.whole), height, torch.tensor(readout), margin), False)
    found, true = changed_by(looked, ends), change_by(looked, ends)
    assert found.shape == true.shape and float(true.abs().max()) > 1e-3
    assert torch.allclose(found, true, atol=2e-5 * float(true.abs().max()), rtol=1e-4)


@pytest.mark.parametrize("beside", [0, 4])
def test_sums_are_those_of_torch(beside):
    random = torch.Generator().manual_seed(beside)
    drawn = lambda *shape: torch.randn(shape, generator=random)  # noqa: E731
    seen = SeenPx(drawn(5, 3, 9, 11), drawn(5, 3, 9, 11), drawn(2, 6, 9, 11), drawn(beside, 3, 9, 11), drawn(3, 9, 11))
    weight = torch.rand((3, 9, 11), generator=random) * (drawn(3, 9, 11) > 0)
    found, wanted = seen.sums(weight), seen.sums_in_torch(weight)
    assert found.shape == (31 + beside, 31 + beside) and found.dtype == torch.float64
    assert torch.equal(found, found.T)
    assert torch.allclose(found, wanted, atol=1e-5 * float(wanted.abs().max()))


def test_what_follows_the_path_is_taken_off_and_what_says_nothing_is_nothing():
    eye = torch.eye(2).double()
    cross = torch.tensor([[0.5, 0.0], [0.0, 0.0]]).double()
    path = PathEquations(eye, torch.tensor([1.0, 0.0]).double(), cross, eye.clone(), torch.tensor([2.0, 3.0]).double())
    precision, wanted = path.step_of(slice(0, 1))
    assert precision == pytest.approx(np.array([[0.75]])) and wanted == pytest.approx(np.array([1.5]))
    precision, wanted = path.step_of(slice(0, 2))
    assert precision == pytest.approx(np.array([[0.75, 0.0], [0.0, 1.0]])) and wanted == pytest.approx([1.5, 3.0])
    path.cross[:] = float("nan")
    for found in path.step_of(slice(0, 2)):
        assert not found.any()


@pytest.mark.parametrize("size", [(61, 80), (60, 81)])
def test_ways_are_asked_by_sums_along_their_direction(size):
    random = torch.Generator().manual_seed(3)
    still, photo = (torch.rand((3, *size), generator=random) for _ in range(2))
    angles, lengths = np.pi * np.arange(8) / 8, 1.5 ** np.arange(9)
    found = left_by_ways(still, photo, angles, lengths)
    window = torch.hann_window(size[0])[:, None] * torch.hann_window(size[1])
    of_still, of_photo = (
        torch.fft.rfft2((light - light.mean(dim=(1, 2), keepdim=True)) * window)
        for light in (srgb_to_linear(still), srgb_to_linear(photo))
    )
    fy, fx = torch.fft.fftfreq(size[0])[:, None], torch.fft.rfftfreq(size[1])
    for row, angle in zip(found, angles, strict=True):
        for one, length in zip(row, lengths, strict=True):
            transfer = torch.sinc(length * (fx * np.cos(angle) + fy * np.sin(angle)))
            left = (of_photo - transfer * of_still).abs().square() - of_photo.abs().square()
            assert one == pytest.approx(float(left.sum()), abs=2e-3 * float(of_still.abs().square().sum()))
