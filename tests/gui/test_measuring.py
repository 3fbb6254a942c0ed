"""A twin is measured in a real Blender window, with the mouse.

Asked for as `test_window.py` is: DGS_WINDOW=sid (Blender 5.2) or DGS_WINDOW=trixie (4.3).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import pytest
from dgs.tests.card_twin import DEPTH, FOCAL, LINE, RECTANGLE, write_card_twin
from dgs.tests.gui import window

pytestmark = pytest.mark.timeout(1500)
_X, _Y = RECTANGLE
PLACES = {
    "left": [-_X, 0.1, DEPTH],
    "right": [_X, 0.1, DEPTH],
    "corner": [_X, _Y, DEPTH],
    "below": [_X, -_Y, DEPTH],
    "other": [-_X, -_Y, DEPTH],
    "before": [-LINE[0] - 0.1, -0.12, DEPTH],
    "behind": [LINE[0] + 0.1, -0.12, DEPTH],
}
MEASURES = [
    ["edge", "length", ["left", "right"]],
    ["crack", "width", ["before", "behind"]],
    ["corner", "angle", ["corner", "below", "other"]],
    ["face", "area", ["corner", "below", "other"]],
]


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    window.skip_unless_asked()
    work = tmp_path_factory.mktemp("measuring")
    write_card_twin(work)
    known = {"length": 90.0, "deviation": 0.0, "unit": "mm"}
    asked = {"places": PLACES, "measures": MEASURES, "nothing": [0.0, 0.62, DEPTH], "known": known}
    (work / "places.json").write_text(json.dumps(asked), "utf-8")
    window.play(work, "measure_story.py", 1400)
    return work


@pytest.fixture(scope="module")
def seen(work: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((work / "story.json").read_text("utf-8"))
    print(json.dumps(found, indent=1))
    assert found["failure"] == "", found["failure"]
    return found


def test_clicks_measure_what_is_there(seen: dict[str, Any]) -> None:
    (_, _, edge, *_), (_, _, crack, *width), (_, _, *angle), (_, _, area, *_) = seen["measures"]
    px = FOCAL / DEPTH
    assert abs(edge - 2 * _X * px) < 3.0, "splats that are seen from aside draw edges off their place"
    assert width[0] < 2 * LINE[0] * px < width[1] and abs(crack - 2 * LINE[0] * px) < 2.0
    assert abs(angle[0] - 90) < 8 and abs(area / (2 * _X * _Y * px**2) - 1) < 0.15


def test_a_click_where_nothing_is_sets_nothing(seen: dict[str, Any]) -> None:
    assert seen["missed"] == [0, True] and seen["kept"] == 0


def test_the_file_keeps_them_with_their_scale(seen: dict[str, Any]) -> None:
    assert [name for name, *_ in seen["opened again"]] == [name for name, *_ in MEASURES]
    assert seen["opened again"][0][2] == pytest.approx(90.0)
    assert abs(seen["opened again"][1][2] - 90.0 * LINE[0] / _X) < 3.0


def test_the_mesh_comes_into_the_scene(seen: dict[str, Any]) -> None:
    assert seen["mesh error"] == "" and len(seen["mesh"]) == 1 and seen["mesh"][0] > 100


def test_nothing_went_wrong_in_blender(work: Path) -> None:
    words = (work / "words").read_text("utf-8")
    for word in ("Traceback", "script error", "Shader Compile Error"):
        assert word not in words, words
