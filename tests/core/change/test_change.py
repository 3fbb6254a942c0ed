"""What has changed between two twins of a small scene: found with its size where it is, and nothing where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.change.compared import changes
from dgs.core.change.findings import Changes
from dgs.core.change.tables import interval, sentence
from dgs.core.progress import Silent
from dgs.core.twin.opened import OpenedTwin, open_twin

from .scene import BLOCK, KNOB, Scene, write_scene


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> OpenedTwin:
    """The first week."""
    return open_twin(write_scene(tmp_path_factory.mktemp("before"), Scene()), Silent())


@pytest.fixture(scope="module")
def later(tmp_path_factory: pytest.TempPathFactory) -> OpenedTwin:
    """The second week: the block has come 1.5 px out, the knob is gone."""
    return open_twin(write_scene(tmp_path_factory.mktemp("later"), Scene(seed=1, out=1.5, knob=False)), Silent())


def between(before: OpenedTwin, later: OpenedTwin) -> Changes:
    return changes(before, later, 1, Silent())[0]


def test_the_same_scene_again_has_not_changed(before: OpenedTwin, tmp_path: Path) -> None:
    """Not under another light, either."""
    found = between(before, open_twin(write_scene(tmp_path, Scene(seed=1, light=0.85)), Silent()))
    assert found.held.mean() > 0.3 and found.changed < 0.02
    assert np.isclose(found.gain, 0.85, atol=0.02)
    assert found.alignment.how == "same world" and found.alignment.taken < 0.1


def test_a_block_that_has_come_out_and_a_knob_that_is_gone(before: OpenedTwin, later: OpenedTwin) -> None:
    found = between(before, later)
    assert sorted(region.kind for region in found.regions) == ["moved", "vanished"], sentence(found)
    block, knob = sorted(found.regions, key=lambda region: region.kind)
    assert np.allclose(block.centre[:2], BLOCK, atol=0.06)
    assert block.direction == "towards the cameras"
    assert block.value is not None and np.isclose(block.value, 1.5, atol=0.25)
    assert np.allclose(knob.centre[:2], KNOB, atol=0.06)
    low, high = interval(knob)
    assert low is not None and high is not None and low < 8.0 < high


def test_what_is_new_is_found_on_the_second_surface(before: OpenedTwin, later: OpenedTwin) -> None:
    """The other way round: the block has gone back, and the knob is there."""
    found = between(later, before)
    kinds = {region.kind: region for region in found.regions}
    assert set(kinds) == {"moved", "appeared"}, sentence(found)
    assert kinds["moved"].direction == "away from the cameras"
    assert kinds["appeared"].after and np.allclose(kinds["appeared"].centre[:2], KNOB, atol=0.06)
