"""Depths of triangles against rays that are followed one by one."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.camera import Camera

pytest.importorskip("bpy")

from dgs.dgs_addon.drawing.triangle_depths import triangle_depths

CAMERA = Camera("", 60, 40, 50.0, 55.0, 29.0, 21.0, np.eye(3), np.zeros(3))


def followed(corners: np.ndarray, near: float) -> np.ndarray:
    """[H, W] by Moeller and Trumbore, one triangle after the other."""
    v, u = np.mgrid[:40, :60] + 0.5
    rays = np.stack([(u - CAMERA.cx) / CAMERA.fx, (v - CAMERA.cy) / CAMERA.fy, np.ones_like(u)], axis=-1)
    nearest = np.full((40, 60), np.inf)
    for a, b, c in corners:
        one, two = b - a, c - a
        across = np.cross(rays, two)
        with np.errstate(divide="ignore", invalid="ignore"):
            scale = 1.0 / (across @ one)
            first = -(across @ a) * scale
            other = np.cross(-a, one)
            second, depth = (rays @ other) * scale, (two @ other) * scale
        hit = (first >= 0) & (second >= 0) & (first + second <= 1) & (depth > near)
        nearest = np.where(hit & (depth < nearest), depth, nearest)
    return nearest


@pytest.mark.parametrize("size", [0.2, 2.0, 30.0])
def test_they_are_those_of_rays(size: float) -> None:
    """Small, large, and such that the camera stands among them, so that some are cut off."""
    random = np.random.default_rng(4)
    middles = random.normal(size=(300 if size < 1 else 30, 1, 3)) * (1.5, 1.2, 2.0) + (0.0, 0.0, 6.0)
    corners = middles + random.normal(size=(len(middles), 3, 3)) * size
    found, wanted = triangle_depths(corners, CAMERA, 0.5), followed(corners, 0.5)
    same = np.isclose(found, wanted, rtol=1e-6) | (np.isinf(found) & np.isinf(wanted))
    assert same.mean() > 0.999 and np.isfinite(wanted).mean() > 0.02


def test_where_there_is_none_there_is_no_depth() -> None:
    assert np.isinf(triangle_depths(np.zeros((0, 3, 3)), CAMERA, 0.1)).all()
    behind = np.array([[[-9.0, -9.0, -2.0], [9.0, -9.0, -2.0], [0.0, 9.0, -2.0]]])
    assert np.isinf(triangle_depths(behind, CAMERA, 0.1)).all()
    flat = np.array([[[0.0, 0.0, 3.0], [1.0, 1.0, 3.0], [2.0, 2.0, 3.0]]])
    assert np.isfinite(triangle_depths(flat, CAMERA, 0.1)).sum() <= 60
