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
    middle, half, at = _windows(count, height, readout, margin)
    return _of_frames((_tent_until(middle + half - at) - _tent_until(middle - half - at)) / (2.0 * half))


def was_turned(height: int, width: int) -> bool:
    """Whether a photo was turned upright: rows of a sensor lie along its longer side."""
    return height > width


def over_photo(rows: Tensor, turned: bool) -> Tensor:
    """[..., N, 1] of values [..., N] of the sensor's rows; [..., 1, N] where those are the photo's columns."""
    return rows[..., None, :] if turned else rows[..., None]


def row_ends(count: int, height: int, readout: Tensor, margin: int = 0) -> Tensor:
    """[count, height + 2 margin] shares of frames in what a row sees last, less those in what it sees first.

    By so much a row's light changes with the time that it is exposed at, in exposures; arguments as of `row_weights`.
    """
    middle, half, at = _windows(count, height, readout, margin)
    return _of_frames(_tent(middle + half - at) - _tent(middle - half - at))


def _windows(count: int, height: int, readout: Tensor, margin: int) -> tuple[Tensor, Tensor, Tensor]:
    """Middle [height + 2 margin] and half the length of rows' windows, and the middles of frames [count + 2, 1].

    In frames from the opening of the first row, and with a frame more on both sides.
    """
    length = 1.0 + readout.abs()
    rows = torch.arange(-margin, height + margin, dtype=readout.dtype, device=readout.device)
    share = ((rows + 0.5) / height).clamp(0.0, 1.0)
    middle = (0.5 + (share - 0.5) * readout / length) * count
    at = torch.arange(-1, count + 1, dtype=readout.dtype, device=readout.device)[:, None] + 0.5
    return middle, 0.5 * count / length, at


def _of_frames(every: Tensor) -> Tensor:
    """[count, H] of [count + 2, H]: the first and the last frame stand for those beyond them."""
    return torch.cat([every[:1] + every[1:2], every[2:-2], every[-2:-1] + every[-1:]])


def _tent(x: Tensor) -> Tensor:
    """From -1 over 0, where it is 1, to 1."""
    return (1.0 - x.abs()).clamp(min=0.0)


def _tent_until(x: Tensor) -> Tensor:
    """The integral until x of a tent from -1 over 0, where it is 1, to 1."""
    rising, falling = (x + 1.0).clamp(0.0, 1.0), (1.0 - x).clamp(0.0, 1.0)
    return torch.where(x < 0.0, 0.5 * rising.square(), 1.0 - 0.5 * falling.square())
