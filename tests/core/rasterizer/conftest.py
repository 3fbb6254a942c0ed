"""The back ends that the rasterizer's tests run on."""

from __future__ import annotations

import pytest
from dgs.tests.back_ends import or_skip


@pytest.fixture(params=["cpu", "gpu"])
def backend(request: pytest.FixtureRequest) -> str:
    """Every back end that mirrors the reference and is here."""
    return or_skip(request.param)


@pytest.fixture(params=["reference", "cpu", "gpu"])
def any_backend(request: pytest.FixtureRequest) -> str:
    """Every back end that is here."""
    return or_skip(request.param)
