"""Lines of sight from anywhere: where they meet the twin, and which edge they mean; a program asks line by line."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.measure.listening import listen
from dgs.core.measure.located import NothingThere, located
from dgs.core.measure.looking import LOOK, nearest_edge, px_of_photos
from dgs.core.measure.request import AskedPlace, AskedRay, parsed_request
from dgs.core.measure.sights import Sight, Sights
from dgs.core.progress import Silent
from dgs.core.training.scale import SceneScale
from dgs.tests.card_twin import CARD, DEPTH, FOCAL, HEIGHT, LINE, RECTANGLE, WIDTH, cameras, card, write_card_twin
from scipy.ndimage import gaussian_filter
from scipy.special import ndtr

PX = DEPTH / FOCAL


@pytest.fixture(scope="module")
def views() -> Sights:
    """The card, 3 units of the world to one of its own."""
    depth = np.full((HEIGHT, WIDTH), np.float32(DEPTH))
    tensor = np.stack([np.ones_like(depth), 0 * depth, np.ones_like(depth)])
    found: dict[str, Sight] = {}
    for camera in cameras():
        x, y = np.meshgrid((np.arange(WIDTH) + 0.5 - camera.cx) * PX, (np.arange(HEIGHT) + 0.5 - camera.cy) * PX)
        there = (abs(x + camera.centre[0]) < CARD[0]) & (abs(y + camera.centre[1]) < CARD[1])
        seen = np.where(there, depth, np.nan).astype(np.float32)
        found[camera.name] = Sight(camera, seen, tensor, np.zeros((3, HEIGHT, WIDTH), np.float32))
    return Sights(found, SceneScale(np.array([5.0, 0.0, 0.0]), 3.0), 0.01, card())


def ray(x: float, y: float, *, edges: bool = False, origin: tuple[float, ...] = (0.3, -0.2, 0.4), **more: float):
    """Through a point of the card, in the world's units."""
    ends = (np.array([origin, (x, y, DEPTH)]) * 3.0 + [5.0, 0.0, 0.0]).tolist()
    return AskedPlace("a", {}, None, None, AskedRay(tuple(ends[0]), tuple(ends[1]), edges=edges, **more))


def test_a_line_of_sight_meets_the_surface_and_is_as_sure_as_it_was_set(views: Sights) -> None:
    place = located(ray(0.2, 0.1), views, {}, 0.0)
    assert np.allclose(place.position, (0.2, 0.1, DEPTH), atol=0.1 * PX)
    assert np.isclose(place.pixel, PX, rtol=0.01) and place.seen >= 2
    across = np.sqrt(np.linalg.eigvalsh(place.covariance)[0])
    assert np.isclose(across, 0.3 * PX, rtol=0.05)
    # set on a picture whose px are five times as fine: across the line it is as sure as these px are small
    close = located(ray(0.2, 0.1, spread=0.2 / FOCAL), views, {}, 0.0)
    away = np.linalg.norm([0.1, 0.3, DEPTH - 0.4])
    assert np.isclose(np.sqrt(np.linalg.eigvalsh(close.covariance)[0]), 0.3 * 0.2 / FOCAL * away, rtol=0.05)


def test_where_it_leads_past_everything_it_says_so(views: Sights) -> None:
    with pytest.raises(NothingThere, match="'a' hits nothing"):
        located(ray(3.0, 0.0), views, {}, 0.0)


def test_a_place_near_a_corner_lies_on_it(views: Sights) -> None:
    """Wherever near it was set; splats that are seen from aside draw it half a px and more off its place."""
    corner, offs = np.array(RECTANGLE), ((1.5, -1.0), (-1.0, 1.0), (0.4, 0.3))
    found = [located(ray(*(corner + PX * np.array(off)), edges=True), views, {}, 0.0).position[:2] for off in offs]
    assert np.ptp(found, axis=0).max() < 0.3 * PX
    assert np.abs(found - corner).max() < 1.2 * PX
    far = located(ray(*(corner + [5 * PX, 5 * PX]), edges=True), views, {}, 0.0)
    assert np.allclose(far.position[:2], corner + 5 * PX, atol=0.2 * PX), "no edge is near"


def test_a_place_near_an_edge_moves_across_it_only(views: Sights) -> None:
    found = [
        located(ray(RECTANGLE[0] + off * PX, 0.05, edges=True), views, {}, 0.0).position[:2] for off in (1.7, -0.8)
    ]
    assert np.ptp(found, axis=0).max() < 0.2 * PX
    assert abs(found[0][0] - RECTANGLE[0]) < 1.0 * PX and abs(found[0][1] - 0.05) < 0.25 * PX


def test_an_edge_is_found_between_px_and_a_faint_one_is_none() -> None:
    x, y = np.meshgrid(np.arange(LOOK.side) + 0.5, np.arange(LOOK.side) + 0.5)
    for at in (15.1, 16.5, 18.3):
        edge = np.tile(ndtr((0.8 * x + 0.6 * y - at * 1.4 + 0.0) / 1.2), (3, 1, 1)).astype(np.float32)
        found = nearest_edge(edge)
        middle = LOOK.side / 2
        assert abs(0.8 * found[0] + 0.6 * found[1] - at * 1.4) < 0.03
        along = np.array([-0.6, 0.8])
        assert abs(along @ (np.array(found) - middle)) < 0.05
    assert nearest_edge(0.002 * edge) == (middle, middle)
    noise = gaussian_filter(np.random.default_rng(0).normal(size=(3, LOOK.side, LOOK.side)), 3, axes=(1, 2))
    assert nearest_edge((0.01 * noise).astype(np.float32)) == (middle, middle)


def test_px_are_those_of_photos_that_see_the_place(views: Sights) -> None:
    assert np.isclose(px_of_photos(views, np.array([0.0, 0.0, DEPTH])), PX)
    near = Camera("near", WIDTH, HEIGHT, FOCAL, FOCAL, 60, 45, np.eye(3), np.array([0, 0, -1.5]))
    sight = next(iter(views.views.values()))
    only = Sights({"near": Sight(near, sight.depth - np.float32(1.5), sight.tensor, sight.image)}, views.scale, 0.01)
    assert np.isclose(px_of_photos(only, np.array([0.0, 0.0, DEPTH])), 0.5 / FOCAL)


def test_rays_and_lone_places_are_asked_for_as_json() -> None:
    place = {"from": [0, 0, 0], "towards": [0, 0, 2.0], "spread": 0.01, "edges": True}
    request = parsed_request({"places": {"a": place}, "measures": []}, alone=True)
    assert request.places["a"].ray == AskedRay((0, 0, 0), (0, 0, 2.0), 0.01, True) and not request.measures
    for wrong in ({"towards": [0, 0, 0]}, {"from": [0, 0]}, {"spread": 2}, {"edges": "yes"}):
        with pytest.raises(ValueError, match=r"."):
            parsed_request({"places": {"a": {**place, **wrong}}, "measures": []}, alone=True)
    with pytest.raises(ValueError, match="0 measures"):
        parsed_request({"places": {"a": place}, "measures": []})


def test_a_program_asks_line_by_line(tmp_path: Path) -> None:
    """Lengths of the card from a folder on disk; what makes no sense is answered, too."""
    folder, answers = write_card_twin(tmp_path), list[str]()
    sides = {
        name: {"from": [0, 0, 0], "towards": [sign * RECTANGLE[0], 0.1, DEPTH], "edges": True}
        for name, sign in (("a", -1), ("b", 1))
    }
    line = {f"l{sign}": {"from": [0, 0, 0], "towards": [sign * (LINE[0] + 0.12), 0.0, DEPTH]} for sign in (-1, 1)}
    asked = [
        {"places": {"a": sides["a"]}},
        {
            "places": {**sides, **line},
            "measures": [
                {"name": "side", "kind": "length", "of": ["a", "b"]},
                {"name": "line", "kind": "width", "of": ["l-1", "l1"]},
            ],
            "scale": {"measure": "side", "value": 90, "unit": "mm"},
        },
        {"places": {"a": {"from": [0, 0, 0], "towards": [5, 0, 1]}}},
        {"measures": [{"kind": "length", "of": ["a", "b"]}]},
        "nothing",
        {"places": {"a": {"photo": "none.png", "at": [1, 1]}}},
    ]
    listen(folder, None, 1, [json.dumps(one) for one in asked], answers.append, Silent())
    opened, place, measured, missed, *wrong = map(json.loads, answers)
    assert opened == {"event": "open", "cameras": 5}
    assert np.allclose(place["places"]["a"]["position"], (-RECTANGLE[0], 0.1, DEPTH), atol=PX)
    side, width = measured["measures"]
    assert side["value"] == 90 and width["unit"] == "mm"
    truth = LINE[0] / RECTANGLE[0] * 90
    assert width["low"] < truth < width["high"] and abs(width["value"] / truth - 1) < 0.06
    assert "hits nothing" in missed["missing"]["a"] and missed["places"] == {}
    assert [one["event"] for one in wrong] == ["error"] * 3
