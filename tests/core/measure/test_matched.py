"""Depths that the pictures of a twin agree on where its splats lie before the surface, and the kernel that compares."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.measure.located import NothingThere, located, on_surface
from dgs.core.measure.matched import MatchedDepth, matched_depth
from dgs.core.measure.matched_kernels import plane_correlations
from dgs.core.measure.places import PRECISION, deviation_of_depth
from dgs.core.measure.request import AskedPlace
from dgs.core.measure.sights import Sight, Sights
from dgs.core.training.scale import SceneScale
from scipy.ndimage import gaussian_filter, map_coordinates

SIZE, FOCAL, DEPTH, TILT = 80, 120.0, 2.0, 0.4
PX = DEPTH / FOCAL


def texture(seed: int = 0) -> np.ndarray:
    """[400, 400] of a surface, 100 to a unit."""
    noise = gaussian_filter(np.random.default_rng(seed).normal(size=(400, 400)), 3.0)
    return (0.5 + 0.1 * noise / noise.std()).astype(np.float32)


def seen(x: float, y: float, before: float = 0.0) -> Sight:
    """What a camera at (x, y, 0) sees of the plane z = DEPTH + TILT X, whose splats lie `before` px nearer."""
    camera = Camera(f"{x} {y}", SIZE, SIZE, FOCAL, FOCAL, SIZE / 2, SIZE / 2, np.eye(3), np.array([-x, -y, 0.0]))
    u, v = np.meshgrid(*[(np.arange(SIZE) + 0.5 - SIZE / 2) / FOCAL] * 2)
    z = (DEPTH + TILT * x) / (1.0 - TILT * u)
    at = np.stack([(v * z + y) * 100 + 200, (u * z + x) * 100 + 200])
    image = np.tile(map_coordinates(texture(), at, order=1, mode="reflect"), (3, 1, 1)).astype(np.float32)
    depth = (z * (1.0 - before / FOCAL)).astype(np.float32)
    return Sight(camera, depth, np.ones((3, SIZE, SIZE), np.float32), image)


def all_round(before: float = 5.0) -> Sights:
    found = [seen(x, y, before) for x in (-0.3, 0.0, 0.3) for y in (-0.3, 0.0, 0.3)]
    return Sights({one.camera.name: one for one in found}, SceneScale(np.zeros(3), 1.0), 0.01)


def first(views: Sights) -> Sight:
    return views.views["0.0 0.0"]


def off(found: MatchedDepth | None, x: float) -> float:
    """px from the plane."""
    assert found is not None
    true = DEPTH / (1.0 - TILT * (x - SIZE / 2) / FOCAL)
    return (found.depth - true) / (true / FOCAL)


@pytest.mark.parametrize("before", [5.0, -7.0, 0.0])
def test_a_place_lies_where_the_pictures_agree(before: float) -> None:
    views = all_round(before)
    for x, y in ((40.2, 38.7), (30.5, 47.0), (52.0, 33.3)):
        own = float(first(views).depth[int(y), int(x)])
        found = matched_depth(views, first(views), x, y, own)
        assert abs(off(found, x)) < 0.3
        assert found is not None and abs(found.moved - abs(before)) < 1.2


def test_a_point_of_a_photo_is_where_its_surface_is_seen_not_where_its_splats_are() -> None:
    views = all_round(5.0)
    place = on_surface(views, first(views), (40.0, 40.0), 0.3, "It")
    assert abs(place.position[2] - DEPTH) < 0.3 * PX
    assert place.seen == 9 and place.reach > 9.0
    found, _ = deviation_of_depth(views, first(views).camera, place.position)
    deviation = float(np.sqrt(place.covariance[2, 2])) / PX
    assert deviation > PRECISION.moved * 4.5, "how far it lies from the splats counts"
    assert np.isfinite(found)


def test_pictures_that_show_nothing_or_something_else_move_no_place() -> None:
    views, own = all_round(5.0), float(first(all_round(5.0)).depth[40, 40])
    plain = {name: replace(one, image=np.full_like(one.image, 0.4)) for name, one in views.views.items()}
    assert matched_depth(replace(views, views=plain), plain["0.0 0.0"], 40.5, 40.5, own) is None
    others = {name: one if name == "0.0 0.0" else plain[name] for name, one in views.views.items()}
    assert matched_depth(replace(views, views=others), first(views), 40.5, 40.5, own) is None
    few = {name: views.views[name] for name in ("0.0 0.0", "0.3 0.0", "-0.3 0.0")}
    assert matched_depth(replace(views, views=few), first(views), 40.5, 40.5, own) is None, "two are no witnesses"
    only = {name: replace(one, trained=name == "0.0 0.0") for name, one in views.views.items()}
    assert matched_depth(replace(views, views=only), first(views), 40.5, 40.5, own) is None


def test_what_lies_on_another_side_of_a_step_is_not_compared() -> None:
    """A wall behind the right half of the window, of another picture in every camera."""
    views = all_round(5.0)
    for index, (name, one) in enumerate(views.views.items()):
        depth, image = one.depth.copy(), one.image.copy()
        edge = 43 - round((one.camera.centre[0]) / DEPTH * FOCAL)
        depth[:, edge:] = 4.0
        image[:, :, edge:] = texture(index + 1)[:SIZE, : SIZE - edge]
        views.views[name] = replace(one, depth=depth, image=image)
    found = matched_depth(views, first(views), 40.5, 40.5, float(first(views).depth[40, 40]))
    assert abs(off(found, 40.5)) < 0.5


def test_a_position_on_the_seen_surface_is_found_again() -> None:
    views = all_round(8.0)
    place = on_surface(views, first(views), (40.0, 40.0), 0.3, "It")
    x, y, z = place.position
    again = located(AskedPlace("a", {}, (x, y, z), None), views, {}, 0.0)
    assert np.linalg.norm(again.position - place.position) < 0.5 * PX
    with pytest.raises(NothingThere, match="no surface"):
        located(AskedPlace("b", {}, (x, y, z - 14 * PX), None), views, {}, 0.0)


def test_a_position_on_the_splats_stays_there_where_pictures_agree_on_another() -> None:
    views = all_round(8.0)
    on_splats = DEPTH * (1 - 8.0 / FOCAL)
    place = located(AskedPlace("a", {}, (0.0, 0.0, on_splats), None), views, {}, 0.0)
    assert abs(place.position[2] - on_splats) < 0.5 * PX and place.reach == PRECISION.own


def test_the_kernel_samples_as_scipy_does() -> None:
    """Between px, at borders, and outside."""
    random, picture = np.random.default_rng(3), texture()[:30, :40]
    x, y = np.meshgrid(np.arange(5.0), np.arange(5.0))
    x, y, values = x.ravel(), y.ravel(), random.normal(size=25)
    values = (values - values.mean()) / np.linalg.norm(values - values.mean())
    turn = np.array([[1.0, 0.02, 3.3], [-0.01, 1.1, 2.7], [0.001, 0.0, 1.0]])
    shift, nearer = np.array([0.4, -0.3, 0.1]), 0.01 * x
    depths, out = np.array([0.2, 1.0, 1.7, -1.0]), np.empty(4)
    plane_correlations(0, 4, depths, picture, turn, shift, x, y, nearer, values, 0.01, out)
    for depth, found in zip(depths, out, strict=True):
        local = (depth / (1 - nearer))[:, None] * (np.stack([x, y, np.ones(25)], 1) @ turn.T) + shift
        u, v = (local[:, :2] / local[:, 2:]).T
        if (local[:, 2] <= 0).any() or (u < 0).any() or (u >= 40).any() or (v < 0).any() or (v >= 30).any():
            assert found == -1.0
            continue
        seen = map_coordinates(picture, [v - 0.5, u - 0.5], np.float64, order=1, mode="nearest")
        seen -= seen.mean()
        assert np.isclose(found, seen @ values / (np.linalg.norm(seen) + 0.01), atol=1e-6)
    assert (out > -1).sum() >= 2
