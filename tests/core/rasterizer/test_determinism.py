"""Same input, same bits: on repeated runs and for any number of threads."""

from __future__ import annotations

import pytest
import torch
from dgs.core import compiled
from dgs.core.rasterizer import RasterSettings
from dgs.tests.core.rasterizer.rasterizer_scenes import gradients, make_camera, random_scene


@pytest.mark.parametrize("threads", [1, 2, 3])
def test_same_bits_on_any_number_of_threads(threads: int) -> None:
    scene, camera = random_scene(800, 1, seed=1), make_camera(150, 110, 120.0)
    options = {"background": torch.rand(3), "twist": torch.zeros(6), "settings": RasterSettings(depth=True)}
    before = compiled.threads()
    try:
        compiled.set_threads(1)
        first, wanted = gradients(scene, camera, "cpu", **options)  # type: ignore[arg-type]
        compiled.set_threads(threads)
        for _ in range(3):
            view, found = gradients(scene, camera, "cpu", **options)  # type: ignore[arg-type]
            assert torch.equal(view.image, first.image)
            assert torch.equal(view.alpha, first.alpha)
            assert view.depth is not None and first.depth is not None
            assert torch.equal(view.depth, first.depth)
            assert view.screen.evaluations == first.screen.evaluations > 0
            assert view.screen.mean_gradient is not None and first.screen.mean_gradient is not None
            assert torch.equal(view.screen.mean_gradient, first.screen.mean_gradient)
            for name, gradient in wanted.items():
                assert torch.equal(found[name], gradient), name
    finally:
        compiled.set_threads(before)


def test_reference_repeats_itself() -> None:
    scene, camera = random_scene(300, 1, seed=2), make_camera()
    first, wanted = gradients(scene, camera, "reference")
    view, found = gradients(scene, camera, "reference")
    assert torch.equal(view.image, first.image)
    for name, gradient in wanted.items():
        assert torch.equal(found[name], gradient), name
