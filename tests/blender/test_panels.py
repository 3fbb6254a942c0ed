"""What the panels say, drawn on paper: Blender draws none without a window (tests/gui has one)."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.dgs_addon.questions import estimate  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.panels import preferences  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402

#: Width of a sidebar as Blender opens it, in px, and characters that fit beside an icon.
SIDEBAR, CHARACTERS = 320, 42


@pytest.fixture(autouse=True)
def add_on() -> Iterator[None]:
    dgs.register()
    yield
    dgs.unregister()


def test_every_panel_draws_in_an_empty_scene() -> None:
    for panel in panels.CLASSES:
        if not hasattr(panel, "poll"):
            assert drawn(panel) is not None


def test_an_estimate_is_not_cut_off() -> None:
    span = {"value": 100.0, "low": 60.0, "high": 3700.0}
    preset = {"seconds": {**span, "calibrated": False}, "memory_mb": {"value": 2300.0}, "psnr": span}
    estimate.question.answer = {"presets": dict.fromkeys(("draft", "balanced", "fine", "best"), preset)}
    estimate.question.subject = estimate.signature(bpy.context.scene.dgs)
    try:
        paper = drawn(panels.DGS_PT_optimize, SIDEBAR)
    finally:
        estimate.question.answer = {}
    assert "dB on held-out photos" in paper.words.replace("\n", " ")
    assert max(len(text) for text, _ in paper.labels) <= CHARACTERS


def test_no_number_of_nine_digits_stands_in_the_panel(cloud: GaussianCloud) -> None:
    twin = add_twin(cloud, "twin", bpy.context.scene.collection)
    bpy.context.view_layer.objects.active = twin
    paper = drawn(panels.DGS_PT_twin_look)
    before = len(paper.props)
    assert "dgs.limit_splats" in paper.buttons
    bpy.ops.dgs.limit_splats()
    paper = drawn(panels.DGS_PT_twin_look)
    assert "dgs.limit_splats" not in paper.buttons and len(paper.props) == before + 1


@pytest.mark.parametrize("override", [False, True])
def test_who_is_offline_sees_the_way_to_the_network(monkeypatch: pytest.MonkeyPatch, override: bool) -> None:
    app = SimpleNamespace(online_access=False, online_access_override=override)
    monkeypatch.setattr(preferences, "bpy", SimpleNamespace(app=app))
    monkeypatch.setattr(preferences, "engine_folder", lambda: "somewhere")
    monkeypatch.setattr(preferences, "is_installed", lambda: False)
    given = SimpleNamespace(python="", wheels="")
    paper = drawn(preferences.DGS_AP_preferences, **vars(given))
    assert ("use_online_access" in paper.props) is not override
    assert ("--offline-mode" in paper.words) is override
