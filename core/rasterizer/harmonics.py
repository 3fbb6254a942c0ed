"""Real spherical harmonics up to degree 3, with the signs of 3DGS files."""

from __future__ import annotations

import torch
from torch import Tensor

from ..constants import SH_C0, SH_C1, SH_C2, SH_C3


def basis(directions: Tensor, coefficients: int) -> Tensor:
    """Values of the harmonics in the given directions.

    Args:
        directions: [N, 3] unit vectors from the camera to the Gaussian, world axes.
        coefficients: 1, 4, 9 or 16 (degree 0 to 3).

    Returns:
        [N, coefficients].
    """
    x, y, z = directions.unbind(-1)
    values = [torch.full_like(x, SH_C0)]
    if coefficients > 1:
        values += [-SH_C1 * y, SH_C1 * z, -SH_C1 * x]
    if coefficients > 4:
        xx, yy, zz = x * x, y * y, z * z
        values += [
            SH_C2[0] * x * y,
            SH_C2[1] * y * z,
            SH_C2[2] * (2 * zz - xx - yy),
            SH_C2[3] * x * z,
            SH_C2[4] * (xx - yy),
        ]
    if coefficients > 9:
        values += [
            SH_C3[0] * y * (3 * xx - yy),
            SH_C3[1] * x * y * z,
            SH_C3[2] * y * (4 * zz - xx - yy),
            SH_C3[3] * z * (2 * zz - 3 * xx - 3 * yy),
            SH_C3[4] * x * (4 * zz - xx - yy),
            SH_C3[5] * z * (xx - yy),
            SH_C3[6] * x * (xx - 3 * yy),
        ]
    return torch.stack(values, dim=-1)


def colours(sh: Tensor, directions: Tensor) -> Tensor:
    """Colour of each Gaussian as seen along its direction, max(SH + 0.5, 0).

    Args:
        sh: [N, K, 3] coefficients, K in {1, 4, 9, 16}.
        directions: [N, 3] unit vectors.

    Returns:
        [N, 3] in the space of the coefficients, >= 0, without an upper bound.
    """
    values = basis(directions, int(sh.shape[1]))
    return (torch.einsum("nk,nkc->nc", values, sh) + 0.5).clamp(min=0.0)
