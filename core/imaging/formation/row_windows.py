"""Which part of its path a row of a photo sees where the shutter rolls; apart from `motion` as it loads torch."""

from __future__ import annotations

import torch
from torch import Tensor


def row_weights(count: int, height: int, readout: Tensor, margin: int = 0) -> Tensor:
    """[count, height + 2 margin] shares of a row's light that so many frames of equal length have; columns sum to 1.

    The photo takes 1 + |readout| exposures, from -1/2 to 1/2. The row whose middle is at the share v of the height sees
    an exposure's length of it around (v - 1/2) readout / (1 + |readout|). Between the middles of two frames light is
    mixed of both, so that weights are smooth in row and readout; before the first middle and behind the last it is that
    frame's. Rows of the margin, which no sensor reads, see what the photo's first and last row do.

    Args:
        readout: [] time from the first row's exposure to the last row's, in exposures; below 0 the last row is first.
    """
    length = 1.0 + readout.abs()
    rows = torch.arange(-margin, height + margin, dtype=readout.dtype, device=readout.device)
    share = ((rows + 0.5) / height).clamp(0.0, 1.0)
    middle = (0.5 + (share - 0.5) * readout / length) * count  # in frames from the opening of the first row
    half = 0.5 * count / length
    # A frame more on both sides: the first and the last one stand for them.
    at = torch.arange(-1, count + 1, dtype=readout.dtype, device=readout.device)[:, None] + 0.5
    every = (_tent_until(middle + half - at) - _tent_until(middle - half - at)) / (2.0 * half)
    return torch.cat([every[:1] + every[1:2], every[2:-2], every[-2:-1] + every[-1:]])


def _tent_until(x: Tensor) -> Tensor:
    """The integral until x of a tent from -1 over 0, where it is 1, to 1."""
    rising, falling = (x + 1.0).clamp(0.0, 1.0), (1.0 - x).clamp(0.0, 1.0)
    return torch.where(x < 0.0, 0.5 * rising.square(), 1.0 - 0.5 * falling.square())
