"""What the panels say, drawn on paper: Blender draws none without a window (tests/gui has one)."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from bl_ui.utils import PresetPanel  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.cloud import GaussianCloud  # noqa: E402
from dgs.dgs_addon.questions import estimate, exact, inspection  # noqa: E402
from dgs.dgs_addon.scene.cameras import new_camera  # noqa: E402
from dgs.dgs_addon.scene.twin import add_twin  # noqa: E402
from dgs.operators import menus  # noqa: E402
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
        if issubclass(panel, PresetPanel):  # Blender's own draws it
            continue
        if not hasattr(panel, "poll"):
            assert drawn(panel) is not None


def test_an_estimate_is_not_cut_off() -> None:
    span = {"value": 100.0, "low": 60.0, "high": 3700.0}
    preset = {"seconds": {**span, "calibrated": False}, "memory_mb": {"value": 2300.0}, "psnr": span}
    estimate.question.answer = {"trials": True, "presets": dict.fromkeys(("draft", "balanced", "fine", "best"), preset)}
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
    given = SimpleNamespace(python="", wheels="", draw_with="AUTO")
    paper = drawn(preferences.DGS_AP_preferences, **vars(given))
    assert ("use_online_access" in paper.props) is not override
    assert ("--offline-mode" in paper.words) is override


def answer(*effects: tuple[str, bool, float]) -> None:
    """What the engine says of the photos 'somewhere'."""
    inspection.effects.subject = ("somewhere",)
    inspection.effects.answer = {
        "effects": [
            {"name": name, "needed": needed, "evidence": f"shown by {name}", "estimate": {"value": value}}
            for name, needed, value in effects
        ]
    }


@pytest.fixture
def settings() -> Iterator[object]:
    bpy.context.scene.dgs.photos = "somewhere"
    yield bpy.context.scene.dgs
    inspection.effects.subject, inspection.effects.answer = (), {}


def icons() -> dict[str, str]:
    """Of the lines that the medium step draws, by their first word."""
    return {
        text.partition(":")[0]: icon
        for text, icon in drawn(panels.DGS_PT_medium).labels
        if ":" in text and not text.startswith("No blur")
    }


def mark(panel: type) -> str:
    return drawn(panel, method="draw_header_preset").labels[0][1]


def test_what_the_settings_leave_out_is_marked_and_one_press_takes_it_in(settings: object) -> None:
    answer(("blur", True, 2.75), ("motion", True, 6.0), ("noise", True, 3.0), ("haze", False, 0.1))
    settings.medium, settings.effects = "none", "usual"
    assert icons() == {"Blur": "ERROR", "Motion": "ERROR", "Noise": "INFO"}
    assert "dgs.use_inspection" in drawn(panels.DGS_PT_medium).buttons
    assert bpy.ops.dgs.use_inspection() == {"FINISHED"}
    assert (settings.medium, settings.sigma, settings.effects) == ("gaussian", 2.75, "auto")
    assert icons() == {"Blur": "CHECKMARK", "Motion": "CHECKMARK", "Noise": "INFO"}
    paper = drawn(panels.DGS_PT_medium)
    assert "dgs.use_inspection" not in paper.buttons and "into account" in paper.words.replace("\n", " ")
    answer(("exposure", True, 0.3), ("vignetting", True, 0.2))
    bpy.ops.dgs.use_inspection()
    assert (settings.medium, settings.effects) == ("none", "auto")
    settings.effects = "usual"
    assert icons() == {"Exposure": "CHECKMARK", "Vignetting": "ERROR"}
    answer(("blur", False, 0.4), ("white_balance", True, 0.1))
    assert bpy.ops.dgs.use_inspection() == {"FINISHED"} and settings.effects == "usual"


def test_no_medium_is_no_step_that_is_done_until_the_photos_say_so(settings: object) -> None:
    assert settings.medium == "auto" and mark(panels.DGS_PT_medium) == "CHECKMARK"
    settings.medium = "none"
    assert mark(panels.DGS_PT_medium) == "RADIOBUT_OFF"
    answer(("blur", True, 2.0))
    assert mark(panels.DGS_PT_medium) == "RADIOBUT_OFF"
    answer(("blur", False, 0.5))
    assert mark(panels.DGS_PT_medium) == "CHECKMARK"
    settings.photos = "elsewhere"
    assert mark(panels.DGS_PT_medium) == "RADIOBUT_OFF"
    settings.medium = "file"
    assert mark(panels.DGS_PT_medium) == "RADIOBUT_OFF", "no file is chosen"


def test_an_exact_view_is_its_scenes_own_and_says_when_it_is_outdated(cloud: GaussianCloud) -> None:
    scene, other = bpy.context.scene, bpy.data.scenes.new("Other")
    twin = add_twin(cloud, "twin", scene.collection)
    bpy.context.view_layer.objects.active = twin
    new_camera("Camera", scene)
    bpy.context.view_layer.update()
    scene.dgs.exact_view = bpy.data.images.new("Descatter Exact View", 4, 4)
    scene.dgs.exact_of = exact.subject_of(twin, scene)
    assert "Outdated" not in drawn(panels.DGS_PT_validate).words
    for change in (
        lambda: setattr(scene.camera, "location", (1, 2, 3)),
        lambda: setattr(twin, "location", (0, 0, 1)),
        lambda: setattr(scene.render, "resolution_x", 640),
        lambda: setattr(scene.dgs, "view_kind", "medium"),
        lambda: setattr(scene.dgs, "sigma", 7.0),
        lambda: twin.data.attributes["radiance:base"].data.foreach_set("color", [0.5] * 36),
    ):
        change()
        bpy.context.view_layer.update()
        assert "Outdated" in drawn(panels.DGS_PT_validate).words
        scene.dgs.exact_of = exact.subject_of(twin, scene)
        assert "Outdated" not in drawn(panels.DGS_PT_validate).words
    scene.dgs.view_kind = "sharp"
    scene.dgs.exact_of = exact.subject_of(twin, scene)
    scene.dgs.sigma = 2.0
    assert "Outdated" not in drawn(panels.DGS_PT_validate).words, "the sharp view has no medium before it"
    scene.dgs.split_shown, scene.dgs.split_against = True, "difference"
    assert "Outdated" in drawn(panels.DGS_PT_validate).words, "what is compared has one"
    assert other.dgs.exact_view is None and "Outdated" not in drawn(panels.DGS_PT_validate, scene=other).words


def test_blenders_own_menus_offer_what_the_tab_does() -> None:
    """F3 finds what stands in a menu."""
    for menu in (bpy.types.VIEW3D_MT_add, bpy.types.VIEW3D_MT_object):
        assert [entry for entry in menu.draw._draw_funcs if entry.__module__ == menus.__name__], menu
    for menu in (menus.DGS_MT_object, menus.DGS_MT_add):
        assert len(drawn(menu).buttons) >= 4
    dgs.unregister()
    try:
        for menu in (bpy.types.VIEW3D_MT_add, bpy.types.VIEW3D_MT_object):
            assert not [entry for entry in menu.draw._draw_funcs if entry.__module__ == menus.__name__], menu
    finally:
        dgs.register()
