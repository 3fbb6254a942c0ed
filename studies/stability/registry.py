"""The list of all hard cases: importing their files fills it."""

from __future__ import annotations

from . import by_depth, files, geometry, kernels, loss, paths, poses, psf, rasterizer, scale, sfm  # noqa: F401 (each adds its cases to `CASES`)
from .case import CASES, FAMILIES, Case


def all_cases() -> list[Case]:
    """Every case, family by family, in the order in which the files state them."""
    return sorted(CASES, key=lambda one: FAMILIES.index(one.family))
