"""The shader for graphics cards in a real Blender window, where a program stands in for a card.

Asked for as `test_window.py` is: DGS_WINDOW=sid (Blender 5.2) or DGS_WINDOW=trixie (4.3).
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core.formats.ply import write_ply
from dgs.tests.gui import window
from dgs.tests.gui.test_drawing import ball, by_command, inside, screen
from PIL import Image

pytestmark = pytest.mark.timeout(1800)


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    window.skip_unless_asked()
    work = tmp_path_factory.mktemp("card")
    write_ply(work / "twin.ply", ball())
    window.play(work, "card_story.py", 1500)
    return work


@pytest.fixture(scope="module")
def seen(work: Path) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((work / "story.json").read_text("utf-8"))
    print(json.dumps(found, indent=1))
    assert found["failure"] == "", found["failure"] + (work / "words").read_text("utf-8")[-3000:]
    return found


def test_a_program_is_no_card_unless_it_is_asked_for(seen: dict[str, Any]) -> None:
    assert seen["automatic"][0] is False and "is a program, no graphics card" in seen["automatic"][1]
    assert seen["asked for"][0] is True and seen["said"][:2] == seen["asked for"][:2], "it can"


@pytest.mark.parametrize("number", range(3))
def test_the_shader_draws_what_the_command_renders(work: Path, seen: dict[str, Any], number: int) -> None:
    """What it blended, to 8 bits, and what the window showed of it."""
    wanted = by_command(work, "transforms.json", f"{number}.png")
    blended = np.load(work / f"card-{number}.npy")[::-1, :, :3]
    for name, shown in (
        ("blended", (blended.clip(0.0, 1.0) * 255 + 0.5).astype(int)),
        ("screen", inside(screen(work, seen, f"rendered-{number}"))),
    ):
        away = np.abs(shown - (wanted if name == "blended" else inside(wanted)))
        print(f"view {number}, {name}: mean difference {away.mean():.4f}, largest {away.max()}")
        assert wanted.std() > 20 and away.mean() <= 0.5 and away.max() <= 3


@pytest.mark.parametrize("mode", ["", "rendered-"])
def test_meshes_hide_and_are_hidden(work: Path, seen: dict[str, Any], mode: str) -> None:
    names = ("rendered-0" if mode else "solid", f"{mode}mesh-behind", f"{mode}mesh-front")
    alone, behind, front = (screen(work, seen, name) for name in names)
    height, width = alone.shape[:2]
    middle = slice(height // 2 - 40, height // 2 + 40), slice(width // 2 - 40, width // 2 + 40)
    assert alone[middle].std() > 20 and np.abs(behind[middle] - alone[middle]).max() <= 2
    assert np.abs(front[middle] - alone[middle]).mean() > 40 and front[middle].std() < 20, "a plain wall"


@pytest.mark.parametrize("lens", ["PERSP", "ORTHO"])
def test_moved_stretched_and_cropped_it_is_the_engines_picture(work: Path, seen: dict[str, Any], lens: str) -> None:
    card, engine = (inside(screen(work, seen, f"moved-{lens}-{who}")) for who in ("CARD", "ENGINE"))
    away = np.abs(card - engine)
    far = (away > 3).any(axis=2).mean()
    print(f"{lens}: mean difference {away.mean():.4f}, largest {away.max()}, more than 3 in {far:.4%} of the px")
    assert engine.std() > 10 and away.mean() <= 0.5
    # Without perspective the engine's camera stands a thousand widths back, where float32 has some thousand depths
    # for all 25,000 splats: it sorts those of one depth by their content, the shader by where they are.
    assert far <= 0.005 if lens == "ORTHO" else far == 0.0


def test_the_order_is_quick(seen: dict[str, Any]) -> None:
    for name in ("card seconds", "engine seconds", "order seconds", "orbit CARD", "orbit ENGINE"):
        print(name, seen[name])
    assert seen["order seconds"] < 0.1 and seen["orbit CARD"]["draws"] > 0.2


def test_nothing_went_wrong_in_blender(work: Path, seen: dict[str, Any]) -> None:
    words = (work / "words").read_text("utf-8")
    for word in ("Traceback", "script error", "Shader Compile Error"):
        assert word not in words, words
    assert Image.open(work / "pictures" / "solid.png").size == window.SCREEN
