"""Lets the training's tests import `training_scenes`."""

from __future__ import annotations

import pytest


@pytest.fixture(autouse=True)
def one_thread():
    """Small frames gain nothing from threads; tests that compare thread counts set their own."""
    import torch
    from dgs.core import compiled

    before, torch_before = compiled.threads(), torch.get_num_threads()
    compiled.set_threads(1)
    torch.set_num_threads(1)
    yield
    compiled.set_threads(before)
    torch.set_num_threads(torch_before)
