"""Places, their covariances, and measures of them: against closed forms, and as the command gives them."""

from __future__ import annotations

import csv
import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.camera import Camera
from dgs.core.errors import DgsError, FormatError
from dgs.core.measure.located import NothingThere, end_on_surface, located, on_surface
from dgs.core.measure.measured import _said, scale_of
from dgs.core.measure.places import PRECISION, SurfacePoint, deviation_of_depth, surface_depth
from dgs.core.measure.request import AskedMeasure, AskedPlace, KnownLength, MeasureRequest, read_request
from dgs.core.measure.sights import Sight, Sights
from dgs.core.measure.values import DRAWS, drawn, valued
from dgs.core.measure.widths import WIDTHS, _left_by_blur, width_on
from dgs.core.training.scale import SceneScale
from dgs.studies.stability.fuzzed_state import write_twin
from scipy.special import ndtr

SIZE, FOCAL = 64, 100.0


def camera(name: str, x: float = 0.0) -> Camera:
    """Looks along z from (x, 0, 0)."""
    return Camera(name, SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2, np.eye(3), np.array([-x, 0.0, 0.0]))


def plane_depth(tilt: float = 0.3, x: float = 0.0) -> np.ndarray:
    """[H, W] depth of the plane z = 2 + tilt * X for a camera at (x, 0, 0)."""
    u = (np.arange(SIZE) + 0.5 - SIZE / 2) / FOCAL
    return np.tile(((2.0 + tilt * x) / (1.0 - tilt * u)).astype(np.float32), (SIZE, 1))


def sight(name: str, x: float = 0.0, strength: float = 1.0, tilt: float = 0.3, **more: Any) -> Sight:
    tensor = np.zeros((3, SIZE, SIZE), np.float32)
    tensor[0] = tensor[2] = strength
    return Sight(camera(name, x), plane_depth(tilt, x), tensor, np.zeros((3, SIZE, SIZE), np.float32), **more)


def two_views(strength: float = 1.0, noise: float = 0.01, tilt: float = 0.3) -> Sights:
    views = {"left": sight("left", -0.1, strength, tilt), "right": sight("right", 0.1, strength, tilt)}
    return Sights(views, SceneScale(np.array([5.0, 0.0, 0.0]), 3.0), noise)


def test_depth_between_px_is_the_planes() -> None:
    one = sight("a")
    for x in (20.1, 31.9, 40.5):
        assert np.isclose(surface_depth(one, x, 30.3), 2.0 / (1.0 - 0.3 * (x - SIZE / 2) / FOCAL), rtol=1e-5)


def test_what_is_behind_a_step_does_not_pull_the_plane() -> None:
    depth = plane_depth(0.0)
    depth[:, 33:] = 4.0
    assert np.isclose(surface_depth(replace(sight("a"), depth=depth), 32.5, 20.5), 2.0)
    assert np.isclose(surface_depth(replace(sight("a"), depth=depth), 33.5, 20.5), 4.0)
    depth[20, 32] = np.nan
    assert np.isnan(surface_depth(replace(sight("a"), depth=depth), 32.5, 20.5))
    assert np.isnan(surface_depth(sight("a"), -1.0, 5.0)) and np.isnan(surface_depth(sight("a"), 5.0, 64.0))


def test_deviation_of_depth_is_the_cramer_rao_bound_of_two_views() -> None:
    """Two photos of gradients g see a shift of d = f b / z per px-equivalent apart: var = 2 s^2 / (g d^2)."""
    views = two_views(strength=0.5, noise=0.01, tilt=0.0)
    found, seen = deviation_of_depth(views, camera("left", -0.1), np.array([0.0, 0.0, 2.0]))
    apart = 0.2 / 2.0  # px of disparity for each px-equivalent of depth: baseline over depth
    least = np.sqrt(2 * 0.01**2 / (0.5 * apart**2))
    assert seen == 2
    assert np.isclose(found, np.hypot(PRECISION.photos * least, PRECISION.floor), rtol=1e-3)


def test_blur_that_weakens_gradients_widens_the_interval() -> None:
    place = np.array([0.0, 0.0, 2.0])
    found = [
        deviation_of_depth(two_views(strength, tilt=0.0), camera("left", -0.1), place)[0] for strength in (4, 1, 0.1)
    ]
    assert found[0] < found[1] < found[2]


def test_cameras_that_disagree_widen_it_and_one_camera_holds_nothing() -> None:
    views, place = two_views(1e6, tilt=0.0), np.array([0.0, 0.0, 2.0])
    sure = deviation_of_depth(views, camera("left", -0.1), place)[0]
    views.views["right"] = replace(views.views["right"], depth=views.views["right"].depth + np.float32(0.04))
    assert deviation_of_depth(views, camera("left", -0.1), place)[0] > sure + 0.5
    del views.views["right"]
    assert deviation_of_depth(views, camera("left", -0.1), place)[0] > 100.0


def test_a_place_on_a_photo_is_on_the_surface_and_sure_across_the_ray() -> None:
    views = two_views()
    asked = AskedPlace("a", {"left": (40.0, 32.0)}, None, 0.2)
    place = located(asked, views, asked.marks, 0.0)
    x, y, z = place.position
    assert np.isclose(z, 2.0 + 0.3 * x, atol=1e-5)
    assert np.isclose((x + 0.1) / z * FOCAL + SIZE / 2, 40.0) and np.isclose(y, 0.0)
    assert np.isclose(np.sqrt(place.covariance[1, 1]), 0.2 * place.pixel, rtol=0.02)
    assert place.covariance[2, 2] > place.covariance[1, 1]


def test_an_end_over_a_hole_lies_as_deep_as_the_profile_beside_it() -> None:
    views = two_views()
    sight, end, other = views.views["left"], (24.0, 30.0), (44.0, 30.0)
    whole = end_on_surface(views, sight, end, other, 0.3, "It")
    assert np.allclose(whole.position, on_surface(views, sight, end, 0.3, "It").position)
    sight.depth[:, 21:28] = np.nan
    with pytest.raises(NothingThere):
        on_surface(views, sight, end, 0.3, "It")
    found = end_on_surface(views, sight, end, other, 0.3, "It")
    along = (found.position - sight.camera.centre) / (whole.position - sight.camera.centre)
    assert np.allclose(along, along[0]), "on the same ray"
    assert np.linalg.norm(found.position - whole.position) < 2.5 * whole.pixel, "a wall that leans by 0.3, 4 px beside"
    assert np.trace(found.covariance) > np.trace(whole.covariance) + (3 * whole.pixel) ** 2
    sight.depth[:] = np.nan
    with pytest.raises(NothingThere):
        end_on_surface(views, sight, end, other, 0.3, "It")


def test_where_nothing_is_it_says_so() -> None:
    views = two_views()
    views.views["left"].depth[:, :20] = np.nan
    asked = AskedPlace("a", {"left": (10.0, 30.0)}, None, None)
    with pytest.raises(NothingThere, match="'a' on 'left' hits nothing"):
        located(asked, views, asked.marks, 0.0)
    with pytest.raises(NothingThere, match="outside the photo"):
        on_surface(views, views.views["left"], (70.0, 3.0), 0.3, "It")
    with pytest.raises(NothingThere, match="no surface"):
        located(AskedPlace("b", {}, (0.0, 0.0, 0.0), None), views, {}, 0.0)


def test_a_position_in_space_is_snapped_to_the_surface() -> None:
    views = two_views(tilt=0.0)
    near = np.array([0.01, 0.02, 2.03]) * 3.0 + [5.0, 0.0, 0.0]  # (a px is 0.02 there)
    place = located(AskedPlace("a", {}, (near[0], near[1], near[2]), None), views, {}, 0.0)
    assert np.isclose(place.position[2], 2.0, atol=1e-4)


def test_points_of_two_photos_meet() -> None:
    views, truth = two_views(), np.array([0.05, -0.1, 1.7])
    marks = {}
    for name, one in views.views.items():
        x, y, z = one.camera.rotation @ truth + one.camera.translation
        marks[name] = (FOCAL * x / z + SIZE / 2, FOCAL * y / z + SIZE / 2)
    place = located(AskedPlace("a", marks, None, 0.1), views, marks, 0.0)
    assert np.allclose(place.position, truth, atol=1e-6)
    # depth from two rays: z^2 / (f b) times sqrt(2) of the px
    assert np.isclose(np.sqrt(place.covariance[2, 2]), 1.7**2 / (FOCAL * 0.2) * np.sqrt(2) * 0.1, rtol=0.05)
    same = {"left": (32.0, 32.0), "right": (32.0, 32.0)}
    with pytest.raises(DgsError, match="meet nowhere"):
        located(AskedPlace("a", same, None, 0.1), views, same, 0.0)


def place_at(*position: float, deviation: float = 0.01, pixel: float = 0.5) -> SurfacePoint:
    return SurfacePoint(np.array(position), np.eye(3) * deviation**2, pixel, 9)


def test_values_and_their_spread_are_those_of_closed_forms() -> None:
    generator = np.random.default_rng(1)
    places = [place_at(0, 0, 0), place_at(3, 0, 0), place_at(3, 4, 0), place_at(0, 4, 0)]
    draws = [drawn(place, generator) for place in places]
    length = valued("length", places[:2], draws[:2])
    assert length.value == 3.0 and np.isclose(length.draws.std(), 0.01 * np.sqrt(2), rtol=0.06)
    assert valued("polyline", places[:3], draws[:3]).value == 7.0
    area = valued("area", places, draws)
    assert area.value == 12.0 and np.isclose(area.draws.std(), 0.01 * 5.0, rtol=0.06)  # half the diagonals, twice
    angle = valued("angle", places[:3], draws[:3])
    assert np.isclose(angle.value, 90.0) and 0.1 < angle.draws.std() < 0.4


def said(scale: KnownLength | None) -> dict[str, Any]:
    places = {"a": place_at(0, 0, 0), "b": place_at(2, 0, 0), "c": place_at(2, 2, 0)}
    generator = np.random.default_rng(0)
    draws = {name: drawn(place, generator) for name, place in places.items()}
    asked = (AskedMeasure("edge", "length", ("a", "b")), AskedMeasure("face", "area", ("a", "b", "c")))
    values = {one.name: valued(one.kind, [places[n] for n in one.of], [draws[n] for n in one.of]) for one in asked}
    request = MeasureRequest({}, asked, scale)
    factor, unit = scale_of(request, values, two_views(), generator)
    return {one.name: _said(one, values[one.name], factor, unit, places) for one in asked}


def test_without_a_scale_there_are_px_equivalents_only() -> None:
    found = said(None)
    assert found["edge"].unit == "px-equivalent" and np.isclose(found["edge"].value, 4.0)
    assert found["face"].unit == "px-equivalent^2" and np.isclose(found["face"].value, 8.0)
    assert found["edge"].low < 4.0 < found["edge"].high


def test_a_known_length_sets_the_unit_and_its_own_error_counts() -> None:
    exact, rough = said(KnownLength("edge", 20.0, 0.0, "mm")), said(KnownLength("edge", 20.0, 2.0, "mm"))
    assert exact["edge"].unit == "mm" and np.isclose(exact["edge"].value, 20.0) and exact["edge"].deviation < 1e-9
    assert np.isclose(rough["edge"].deviation, 2.0, rtol=0.06)
    assert exact["face"].unit == "mm^2" and np.isclose(exact["face"].value, 200.0)
    assert rough["face"].deviation > 5 * exact["face"].deviation


def test_width_of_a_line_is_read_across_it() -> None:
    across = np.arange(SIZE) + 0.5
    line = ndtr((across - 26.3) / 0.8) - ndtr((across - 36.7) / 0.8)
    image = np.tile((0.2 + 0.6 * line).astype(np.float32), (3, SIZE, 1))
    one = replace(sight("a", tilt=0.0), image=image, blur=2.5)
    ends = (place_at(-0.24, 0, 2.0, pixel=0.02), place_at(0.24, 0, 2.0, pixel=0.02))
    normal = np.random.default_rng(0).standard_normal(DRAWS)
    width = width_on(one, ((20.0, 30.0), (44.0, 30.0)), ends, normal, "w")
    assert np.isclose(width.value / 0.02, 10.4, atol=0.05)
    assert np.isclose(width.draws.std() / 0.02, 0.06 * 2.5, rtol=0.2)  # what the blur leaves open
    flat = replace(one, image=np.full((3, SIZE, SIZE), 0.5, np.float32))
    with pytest.raises(DgsError, match="no line with two flanks"):
        width_on(flat, ((20.0, 30.0), (44.0, 30.0)), ends, normal, "w")


A, B = {"photo": "a.png", "at": [8, 9]}, {"photo": "a.png", "at": [20, 12]}
LENGTH = {"name": "edge", "kind": "length", "of": ["a", "b"]}


@pytest.mark.parametrize(
    ("content", "why"),
    [
        ({}, "measures is missing"),
        ({"measures": []}, "0 measures"),
        ({"places": {"a": A}, "measures": [LENGTH]}, "'b', which is no place"),
        ({"places": {"a": A, "b": {}}, "measures": [LENGTH]}, "no photo and has no position"),
        ({"places": {"a": A, "b": {"photo": "a.png", "at": [1]}}, "measures": [LENGTH]}, "two coordinates"),
        ({"places": {"a": A, "b": B}, "measures": [LENGTH, LENGTH]}, "same name"),
        ({"places": {"a": A, "b": B}, "measures": [{"kind": "angle", "of": ["a", "b"]}]}, "of 3"),
        ({"measures": [{"kind": "width", "photo": "a.png"}]}, "between no two points"),
        ({"measures": [{"kind": "weight"}]}, "none of"),
        ({"places": {"a": {**A, "at": [1e400, 2]}}, "measures": [LENGTH]}, "asks for no measures"),
    ],
)
def test_what_makes_no_sense_is_refused(tmp_path: Path, content: dict[str, Any], why: str) -> None:
    file = tmp_path / "p.json"
    file.write_text(json.dumps(content).replace("Infinity", "1e400"))
    with pytest.raises(FormatError, match=why):
        read_request(file)


@pytest.mark.parametrize(
    "scale", ["edge", "edge=mm", "edge=-3mm", "edge=1+-2mm", "edge=nanmm", "other=3mm", "edge=0mm"]
)
def test_a_known_length_that_makes_no_sense_is_refused(tmp_path: Path, scale: str) -> None:
    file = tmp_path / "p.json"
    file.write_text(json.dumps({"places": {"a": A, "b": B}, "measures": [LENGTH]}))
    with pytest.raises(FormatError, match="known length"):
        read_request(file, scale)
    assert read_request(file, "edge=12.5+-0.1mm").scale == KnownLength("edge", 12.5, 0.1, "mm")


def test_the_command_measures_a_twin_or_says_what_is_not_there(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_twin(tmp_path)
    twin, file, out = tmp_path / "twin", tmp_path / "points.json", tmp_path / "out" / "m.csv"
    nowhere = {"photo": "a.png", "at": [4000, 3]}
    asked = {"places": {"a": A, "b": B, "n": nowhere}, "measures": [LENGTH, {"kind": "length", "of": ["n", "b"]}]}
    file.write_text(json.dumps(asked))
    assert run(["measure", str(twin), str(file), "--out", str(out), "--progress", "none"]) == 0
    said = capsys.readouterr().out
    assert all(words in said for words in ("px-equivalent", "No length is known", "outside the photo"))
    assert "mm" not in said.partition("Give one")[0]
    rows = list(csv.DictReader(out.open()))
    assert [row["name"] for row in rows] == ["edge", "length 2"] and rows[1]["value"] == ""
    file.write_text(json.dumps({**asked, "places": {**asked["places"], "b": {"photo": "z.png", "at": [1, 1]}}}))
    assert run(["measure", str(twin), str(file), "--progress", "none"]) == 2
    assert "'z.png' is no photo of this twin" in capsys.readouterr().err


def test_a_width_below_twice_the_blur_is_less_sure() -> None:
    """An inverted blur leaves lines wrong that it has wiped out; wide ones keep the small deviation."""
    assert _left_by_blur(3.0, 0.0) == 0.0
    narrow, between, wide = (_left_by_blur(width, 5.0) for width in (8.0, 12.5, 20.0))
    assert np.isclose(narrow, 5.0 * WIDTHS.narrow) and np.isclose(wide, 5.0 * WIDTHS.inverted)
    assert np.isclose(between, (narrow + wide) / 2)
