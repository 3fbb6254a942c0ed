"""The back ends that the rasterizer's tests run on."""

from __future__ import annotations

import pytest


def _with_reason(backend: str) -> str:
    if backend == "cuda":
        from dgs.core.rasterizer.cuda import available

        if not available():
            pytest.skip("no CUDA device with a working gsplat on this machine")
    return backend


@pytest.fixture(params=["cpu", "cuda"])
def backend(request: pytest.FixtureRequest) -> str:
    """Every back end that mirrors the reference and is here."""
    return _with_reason(request.param)


@pytest.fixture(params=["reference", "cpu", "cuda"])
def any_backend(request: pytest.FixtureRequest) -> str:
    """Every back end that is here."""
    return _with_reason(request.param)
