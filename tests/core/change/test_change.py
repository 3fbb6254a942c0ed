"""What has changed between two twins of a small scene: found with its size where it is, and nothing where it is not."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from dgs.core.change.compared import changes
from dgs.core.change.findings import Changes
from dgs.core.progress import Silent
from dgs.core.twin.opened import OpenedTwin, open_twin

from .scene import BLOCK, KNOB, Scene, write_scene


@pytest.fixture(scope="module")
def before(tmp_path_factory: pytest.TempPathFactory) -> OpenedTwin:
    """The first week."""
    return open_twin(write_scene(tmp_path_factory.mktemp("before"), Scene()), Silent())


def changed(before: OpenedTwin, place: Path, scene: Scene) -> Changes:
    return changes(before, open_twin(write_scene(place, scene), Silent()), 1, Silent())[0]


def test_the_same_scene_again_has_not_changed(before: OpenedTwin, tmp_path: Path) -> None:
    """Under another light, too."""
    found = changed(before, tmp_path, Scene(seed=1, light=0.85))
    assert found.held.mean() > 0.3 and found.changed < 0.02
    assert np.isclose(found.gain, 0.85, atol=0.02)


def test_a_block_that_has_come_out_and_a_knob_that_is_gone(before: OpenedTwin, tmp_path: Path) -> None:
    found = changed(before, tmp_path, Scene(seed=1, out=1.5, knob=False))
    kinds = {region.kind: region for region in found.regions}
    for r in found.regions:
        print(r.kind, r.centre, r.area, r.value, r.deviation, r.motion, r.direction, r.after)
    assert np.allclose(kinds["moved"].centre[:2], BLOCK, atol=0.1)
    assert kinds["moved"].direction == "towards the cameras"
    assert np.allclose(kinds["vanished"].centre[:2], KNOB, atol=0.1)
