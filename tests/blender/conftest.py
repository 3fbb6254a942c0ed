"""A fresh Blender scene for every test."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.dgs_addon.drawing import process  # noqa: E402


@pytest.fixture(autouse=True)
def empty_scene() -> Iterator[None]:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    yield


@pytest.fixture(scope="module")
def one_picture_server() -> Iterator[None]:
    """One process that draws for all tests of a module: starting it takes seconds."""
    kept, process.stop = process.stop, lambda: None
    yield
    process.stop = kept
    process.stop()


@pytest.fixture
def cloud() -> GaussianCloud:
    """Nine glossy splats far enough apart that no two overlap, 4 to 6 units before the origin."""
    generator = np.random.default_rng(7)
    column, row = np.meshgrid([-1.2, 0.0, 1.2], [-1.2, 0.0, 1.2])
    means = np.stack([column.ravel(), row.ravel(), np.full(9, 5.0)], axis=1)
    means[:, 2] += generator.uniform(-0.3, 0.3, 9)
    sh = np.concatenate([generator.uniform(-1.2, 1.7, (9, 1, 3)), generator.uniform(-0.4, 0.4, (9, 3, 3))], axis=1)
    return GaussianCloud(
        means=means.astype(np.float32),
        log_scales=np.log(generator.uniform(0.05, 0.14, (9, 3))).astype(np.float32),
        quaternions=generator.normal(size=(9, 4)).astype(np.float32),
        opacity_logits=generator.uniform(-0.5, 2.5, 9).astype(np.float32),
        sh=sh.astype(np.float32),
    )
