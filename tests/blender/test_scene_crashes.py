"""A scene that Blender could not write whole takes no other's place; Blender itself does not notice a full disk."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("bpy")

from dgs.tests.crash_commands import CASES, Stage, warm_up
from dgs.tests.crash_trials import Trials
from dgs.tests.crashes import can_mount


@pytest.fixture
def trials(memory_path: Path) -> Iterator[Trials]:
    """Of `blend`, over an older scene."""
    warm_up()
    yield Trials(Stage(memory_path / "stage"), next(case for case in CASES if case.name.startswith("blend")))


def test_a_scene_that_is_cut_off_is_as_before_or_as_after(trials: Trials) -> None:
    steps = trials.steps()
    found = [trials.at("kill", at, again=False) for at in (steps // 2, steps - 1)]
    assert not [outcome.why for outcome in found if outcome.found == "BROKEN"]


@pytest.mark.skipif(not can_mount(), reason="this user may mount no disk")
@pytest.mark.parametrize("pages", [2, 26, 31])
def test_a_disk_that_fills_up_while_blender_writes_leaves_the_old_scene(trials: Trials, pages: int) -> None:
    assert trials.on_disk_of(pages, again=pages == 26).found == "before"
