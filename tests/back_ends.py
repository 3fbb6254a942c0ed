"""Which back ends of the rasterizer are here; a test of another is skipped, and says why."""

from __future__ import annotations

from typing import Any

import pytest
import torch
from dgs.core.devices import backend_named
from dgs.core.errors import DeviceError


def or_skip(backend: str) -> str:
    """The back end, ready to be used."""
    if backend == "gpu":
        try:
            backend_named(backend).check()
        except DeviceError as error:
            pytest.skip(f"no graphics card, and no driver that stands in for one (mesa-vulkan-drivers): {error}")
    return backend


def brought_up(tensor: torch.Tensor) -> torch.Tensor:
    """A tensor whose values lie on the card and nowhere else, as those that shaders make."""
    found: Any = tensor.to("gpu")
    found.held.for_card()
    found.held.changed_on_card()
    return found  # type: ignore[no-any-return]
