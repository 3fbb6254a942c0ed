"""Shares that frames along a path have of each row's light: all of it, of its own time, smooth in the readout."""

import pytest
import torch
from dgs.core.imaging.formation.motion import straight_paths
from dgs.core.imaging.formation.row_windows import row_weights


def weights(count: int, height: int, readout: float, margin: int = 0) -> torch.Tensor:
    return row_weights(count, height, torch.tensor(readout, dtype=torch.float64), margin)


@pytest.mark.parametrize("readout", [0.0, 0.3, -1.0, 2.5, -40.0])
@pytest.mark.parametrize("count", [2, 3, 9, 24])
def test_every_row_has_all_its_light(count, readout):
    found = weights(count, 30, readout, 4)
    assert found.shape == (count, 38) and bool((found >= 0).all())
    assert torch.allclose(found.sum(dim=0), torch.ones(38, dtype=torch.float64), atol=1e-12)
    assert torch.equal(found[:, 0], found[:, 3]) or readout != 0  # (margins see what the outermost rows do)
    assert torch.allclose(weights(count, 30, -readout, 4), found.flip(0), atol=1e-12), "read from below: time backwards"


def test_without_readout_all_frames_count_alike():
    assert torch.allclose(weights(7, 12, 0.0), torch.full((7, 12), 1 / 7, dtype=torch.float64), atol=1e-12)


@pytest.mark.parametrize("readout", [0.5, 2.0, -2.0])
def test_a_row_sees_its_own_exposure(readout):
    """Middle and spread of each row's time are those of its window."""
    count, height = 400, 20
    found, length = weights(count, height, readout), 1 + abs(readout)
    times = ((torch.arange(count) + 0.5) / count - 0.5).double()
    middle = times @ found
    share = (torch.arange(height) + 0.5) / height
    assert torch.allclose(middle, (share - 0.5).double() * readout / length, atol=2e-4)
    spread = (times[:, None] - middle).square().mul(found).sum(dim=0)
    assert torch.allclose(spread, torch.full_like(spread, 1 / length**2 / 12), rtol=1e-2)


@pytest.mark.parametrize("readout", [0.7, -0.7, 3.1])
def test_they_are_smooth_in_the_readout(readout):
    given = torch.tensor(readout, dtype=torch.float64, requires_grad=True)
    assert torch.autograd.gradcheck(lambda r: row_weights(5, 11, r, 2), (given,))


def test_paths_that_roll_keep_their_speed_and_have_frames_enough():
    plain = straight_paths({"a": (12 / 80, 0.0)}, 4)
    found = plain.rolling(1.5)
    assert found.readout == 1.5 and found.exposures == 2.5 and plain.readout == 0.0
    assert found.length("a", 80.0) == pytest.approx(2.5 * plain.length("a", 80.0))
    assert found.scaled(2.0).readout == found.for_photos(["a"]).readout == 1.5
    assert found.rolling(0.0).length("a", 80.0) == pytest.approx(12.0, rel=1e-5)
    assert plain.row_weights(9, 10, 12) is None and found.row_weights(1, 10, 12) is None
    assert found.row_weights(9, 10, 12, 2).shape == (9, 14, 1)
    assert torch.equal(found.row_weights(9, 12, 10, 2), found.row_weights(9, 10, 12, 2).mT), "turned upright"
    assert "readout" not in plain.described() and found.described()["readout"] == 1.5
