"""Measures in Blender: set by a script, kept with the object, listed, scaled, exported; the surface as a mesh.

tests/gui/test_measuring.py sets them with the mouse.
"""

from __future__ import annotations

import csv
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import panels  # noqa: E402
from dgs.core.measure.request import parsed_request  # noqa: E402
from dgs.dgs_addon.engine.conversation import Conversation  # noqa: E402
from dgs.dgs_addon.job.results import add_twin_of  # noqa: E402
from dgs.dgs_addon.questions import measures  # noqa: E402
from dgs.dgs_addon.scene.measures import asked_of, from_file, known_of, sight_line, value_text  # noqa: E402
from dgs.dgs_addon.scene.surface import SURFACE  # noqa: E402
from dgs.tests.blender.paper import drawn  # noqa: E402
from dgs.tests.card_twin import DEPTH, FOCAL, LINE, RECTANGLE, write_card_twin  # noqa: E402


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return write_card_twin(tmp_path_factory.mktemp("card"))


@pytest.fixture(scope="module", autouse=True)
def one_engine() -> Iterator[None]:
    """Opening the twin takes seconds: the engine stays for all tests."""
    kept, measures.stop = measures.stop, lambda: None
    yield
    measures.stop = kept
    measures.stop()


@pytest.fixture
def twin(folder: Path) -> Iterator[Any]:
    dgs.register()
    yield add_twin_of(folder, bpy.context.scene)
    dgs.unregister()


def at(twin: Any, *places: tuple[float, float]) -> str:
    """Places of the card, in Blender's world, as the operator takes them."""
    world = from_file(twin)
    points = [(world @ [x, y, DEPTH, 1.0])[:3] for x, y in places]
    return "; ".join(" ".join(f"{value:.6f}" for value in point) for point in points)


def measured(twin: Any, kind: str, *places: tuple[float, float], name: str = "") -> Any:
    assert bpy.ops.dgs.measure(kind=kind, points=at(twin, *places), name=name) == {"FINISHED"}
    return twin.dgs_measures.items[-1]


SIDE = ((-RECTANGLE[0], 0.1), (RECTANGLE[0], 0.1))


def test_measures_of_all_kinds_are_those_of_the_card(twin: Any) -> None:
    """Wherever the twin stands in the scene, and at any size."""
    twin.scale, twin.location = (3.0, 3.0, 3.0), (1.0, 2.0, 3.0)
    bpy.context.view_layer.update()
    length = measured(twin, "length", *SIDE)
    assert length.unit == "px-equivalent" and length.low < 0.9 * FOCAL / DEPTH < length.high
    assert abs(length.value - 0.9 * FOCAL / DEPTH) < 0.5 and length.photos >= 2
    angle = measured(twin, "angle", SIDE[0], (0.0, 0.1), (0.0, 0.3))
    assert angle.unit == "deg" and abs(angle.value - 90.0) < 2.0 < angle.high - angle.value + 2.0
    area = measured(twin, "area", (-0.4, -0.2), (0.4, -0.2), (0.4, 0.2), (-0.4, 0.2))
    assert abs(area.value / (0.32 * (FOCAL / DEPTH) ** 2) - 1) < 0.03 and area.unit == "px-equivalent^2"
    width = measured(twin, "width", (-LINE[0] - 0.1, 0.0), (LINE[0] + 0.1, 0.0))
    assert width.low < 2 * LINE[0] * FOCAL / DEPTH < width.high
    way = measured(twin, "polyline", (-0.3, 0.0), (0.0, 0.0), (0.3, 0.0))
    assert abs(way.value - 0.6 * FOCAL / DEPTH) < 0.5
    assert [item.name for item in twin.dgs_measures.items] == ["Length", "Angle", "Area", "Width", "Path"]


def test_a_line_of_sight_is_kept_in_the_axes_of_the_file(twin: Any) -> None:
    twin.scale, twin.location = (2.0, 2.0, 2.0), (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    ends = [(from_file(twin) @ [*point, 1.0])[:3] for point in ((0.1, 0.2, 0.0), (0.3, 0.1, DEPTH))]
    line = sight_line(twin, *ends, 0.001, True)
    assert np.allclose([line["from"], line["towards"]], [(0.1, 0.2, 0.0), (0.3, 0.1, DEPTH)], atol=1e-5)
    parsed_request({"places": {"a": line}, "measures": []}, alone=True)


def test_where_nothing_is_it_says_so_and_keeps_nothing(twin: Any) -> None:
    for points, why in (
        (at(twin, SIDE[0], (2.0, 0.0)), "lies on no surface"),
        (at(twin, SIDE[0]), "of 2 places, not of 1"),
        ("1 2; 3", "no position"),
    ):
        with pytest.raises(RuntimeError, match=why):
            bpy.ops.dgs.measure(kind="length", points=points)
    assert not len(twin.dgs_measures.items)


def test_a_known_length_scales_all_and_is_forgotten_again(twin: Any) -> None:
    measured(twin, "length", *SIDE, name="edge")
    other = measured(twin, "length", (-0.3, 0.0), (0.3, 0.0))
    twin.dgs_measures.active = 0
    assert bpy.ops.dgs.know_length(length=90.0, deviation=0.5, unit="mm") == {"FINISHED"}
    edge, other = twin.dgs_measures.items
    assert edge.known and value_text(edge) == "90 mm" and other.unit == "mm"
    assert abs(other.value - 60.0) < 1.0 and other.low < 60.0 < other.high and value_text(other).startswith("60 ± ")
    paper = drawn(panels.DGS_PT_twin_measure)
    assert "Scale: edge is 90 mm" in paper.words and "95 %:" in paper.words
    assert bpy.ops.dgs.forget_length() == {"FINISHED"} and other.unit == "px-equivalent"
    assert "No length is known" in drawn(panels.DGS_PT_twin_measure).words
    bpy.ops.dgs.know_length(length=90.0, unit="mm")
    assert bpy.ops.dgs.remove_measure() == {"FINISHED"} and len(twin.dgs_measures.items) == 1
    assert twin.dgs_measures.items[0].unit == "px-equivalent", "nothing is known any more"


def test_a_board_that_is_not_there_changes_nothing(twin: Any) -> None:
    edge = measured(twin, "length", *SIDE, name="edge")
    bpy.ops.dgs.know_length(length=90.0, unit="mm")
    with pytest.raises(RuntimeError, match="No marker of 'aruco:40mm' is found"):
        bpy.ops.dgs.scale_by_board(board="aruco:40mm")
    held = twin.dgs_measures
    assert edge.known and edge.unit == "mm" and held.board == ""
    paper = drawn(panels.DGS_PT_twin_measure)
    assert "Scale: edge is 90 mm" in paper.words and "No marker of" in paper.words
    with pytest.raises(RuntimeError, match="Write aruco:"):
        bpy.ops.dgs.scale_by_board(board="40mm")
    assert bpy.ops.dgs.forget_length() == {"FINISHED"} and "No marker" not in drawn(panels.DGS_PT_twin_measure).words


def test_a_board_that_was_found_is_said_and_asked_for(twin: Any) -> None:
    measured(twin, "length", *SIDE, name="edge")
    held = twin.dgs_measures
    held.board = "aruco:40mm"
    held.answer = json.dumps({"scale": {"markers": 6, "photos": 20, "size": 50.0, "deviation": 0.1}})
    words = " ".join(drawn(panels.DGS_PT_twin_measure).words.split())
    assert "Scale by aruco:40mm: 6 markers on 20 photos, known to 0.2 %" in words
    assert parsed_request(asked_of(twin)).board is not None
    alone = known_of(twin)
    assert alone is not None and parsed_request(alone).board is not None


def test_a_file_keeps_them_and_they_can_be_measured_again(twin: Any, tmp_path: Path) -> None:
    before = measured(twin, "length", *SIDE, name="edge")
    value, asked = before.value, asked_of(twin)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "a.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "a.blend"))
    twin = bpy.context.view_layer.objects.active
    (item,) = twin.dgs_measures.items
    assert (item.name, item.value) == ("edge", value) and asked_of(twin) == asked
    item.value = 1.0
    assert bpy.ops.dgs.measure_again() == {"FINISHED"} and abs(item.value - value) < 0.02  # px


def test_tables_have_the_names_and_intervals(twin: Any, tmp_path: Path) -> None:
    measured(twin, "length", *SIDE)
    measured(twin, "angle", SIDE[0], (0.0, 0.1), (0.0, 0.3))
    twin.dgs_measures.items[0].name = "edge, long"
    assert bpy.ops.dgs.export_measures(filepath=str(tmp_path / "a.csv")) == {"FINISHED"}
    with (tmp_path / "a.csv").open(encoding="utf-8") as file:
        first, second = csv.DictReader(file)
    assert (first["name"], first["kind"], first["unit"]) == ("edge, long", "length", "px-equivalent")
    assert float(first["low"]) < float(first["value"]) < float(first["high"]) and second["unit"] == "deg"
    assert bpy.ops.dgs.export_measures(filepath=str(tmp_path / "a.json")) == {"FINISHED"}
    content = json.loads((tmp_path / "a.json").read_text("utf-8"))
    parsed_request(content["asked"])
    assert content["measures"][0]["name"] == "edge, long" and len(content["places"]) == 5
    with pytest.raises(RuntimeError, match="no table"):
        bpy.ops.dgs.export_measures(filepath=str(tmp_path / "a.txt"))


def test_a_twin_without_a_folder_is_refused_with_the_reason(twin: Any) -> None:
    twin["dgs_results"] = ""
    assert "folder of results" in measures.why_no_measure(twin)
    assert not bpy.ops.dgs.measure.poll() and not bpy.ops.dgs.make_mesh.poll()
    assert "folder of results" in drawn(panels.DGS_PT_twin_measure).words.replace("\n", " ")


def test_the_mesh_lies_on_the_twin(twin: Any) -> None:
    twin.scale, twin.location = (2.0, 2.0, 2.0), (1.0, 0.0, 0.0)
    bpy.context.view_layer.update()
    assert bpy.ops.dgs.make_mesh(faces=2000) == {"FINISHED"}
    (surface,) = [child for child in twin.children if child.get(SURFACE)]
    bpy.context.view_layer.update()
    places = np.array([surface.matrix_world @ vertex.co for vertex in surface.data.vertices])
    back = np.c_[places, np.ones(len(places))] @ np.linalg.inv(from_file(twin)).T
    assert 100 < len(surface.data.polygons) <= 2000 and np.median(abs(back[:, 2] - DEPTH)) < 0.5 * DEPTH / FOCAL
    assert np.abs(back[:, 0]).max() > 0.5 and len(surface.data.color_attributes) == 1
    assert bpy.context.view_layer.objects.active == twin


def test_an_engine_that_dies_says_of_what() -> None:
    talk = Conversation([sys.executable, "-c", "import sys; print('{}', flush=True); input(); sys.exit('no more')"])
    talk.ask("a", {})
    assert talk.wait("a") == {"event": "error", "text": "no more"} and not talk.ready
    talk = Conversation(["/nowhere/python"])
    assert "nowhere" in talk.wait("a")["text"]


def test_a_value_that_is_no_larger_than_its_error_is_a_bound():
    def item(value: float, low: float, high: float) -> SimpleNamespace:
        return SimpleNamespace(found=True, known=False, unit="mm^2", value=value, low=low, high=high)

    assert value_text(item(44_848.0, 0.0, 2_425_718.0)).startswith("< 2")
    assert value_text(item(120.0, 100.0, 140.0)) == "120 ± 20 mm²"
