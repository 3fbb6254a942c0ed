"""A twin is compared with an earlier one in a real Blender window.

Asked for as `test_window.py` is: DGS_WINDOW=sid (Blender 5.2) or DGS_WINDOW=trixie (4.3).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from dgs.tests.core.change.scene import AWAY, PX, Scene, write_scene
from dgs.tests.gui import window

pytestmark = pytest.mark.timeout(1000)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    window.skip_unless_asked()
    work = tmp_path_factory.mktemp("comparing")
    write_scene(work / "week1", Scene())
    write_scene(work / "week2", Scene(seed=1, out=1.5, knob=False))
    ends = [[-0.9, -0.7, AWAY], [0.9, -0.7, AWAY]]
    known = {"name": "wall", "ends": ends, "length": 180.0, "unit": "mm"}
    (work / "known.json").write_text(json.dumps(known), "utf-8")
    window.play(work, "comparing_story.py", 900)
    return work


@pytest.fixture(scope="module")
def seen(work: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((work / "story.json").read_text("utf-8"))
    print(json.dumps(found, indent=1))
    assert found["failure"] == "", found["failure"]
    return found


def test_what_has_changed_is_shown_in_the_twins_place(seen: dict[str, Any]) -> None:
    assert seen["ended"] == ["done", ""] and seen["shown"] == [True, False]
    assert sorted(region["kind"] for region in seen["changes"]["regions"]) == ["moved", "vanished"]
    gone = next(region for region in seen["changes"]["regions"] if region["kind"] == "vanished")
    assert gone["unit"] == "mm" and gone["low"] < 8 * PX * 100 < gone["high"]


def test_it_can_be_cancelled_switched_and_undone(seen: dict[str, Any]) -> None:
    assert seen["cancelled"] == ["cancelled", True]
    assert seen["switched"] == [False, True] and seen["undone"] == [False, True]


def test_nothing_went_wrong_in_blender(work: Path) -> None:
    words = (work / "words").read_text("utf-8")
    for word in ("Traceback", "script error", "Shader Compile Error"):
        assert word not in words, words
