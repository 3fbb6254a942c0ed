"""What has moved in a region: how many, and how much of their motion shows through the blur."""

from __future__ import annotations

import itertools
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from dgs.core.change import regions
from dgs.core.change.alignment import SAME
from dgs.core.change.compared import _compared, _paired
from dgs.core.change.evidence import Places, evidence
from dgs.core.change.kinds import _grown
from dgs.core.change.motion import Motion, between, common_motion, pooled, solved
from dgs.core.change.pair import Compared
from dgs.core.change.parts import Part, parted
from dgs.core.change.settings import PARTS
from dgs.core.change.sizes import Fit, _likely, _members, _Moving, _ways, sized
from dgs.core.change.surface import Surface, surface_of
from dgs.core.progress import Silent
from dgs.core.twin.opened import open_twin
from numpy.typing import NDArray

from .scene import AWAY, PX, Scene, write_scene
from .test_estimates import PHOTOS, Evidence

#: Places of a flat grid, 2 px apart.
COLUMNS, ROWS = 36, 20


def said(by: NDArray[np.float64], seed: int) -> Evidence:
    """Of photos that see all places move `by` [N, 3]."""
    random = np.random.default_rng(seed)
    looks = np.random.default_rng(5).normal(size=(PHOTOS, len(by), 4, 3))
    seen = np.einsum("pnki,ni->pnk", looks, by) + 0.2 * random.standard_normal((PHOTOS, len(by), 4))
    matrices = np.einsum("pnki,pnkj->pnij", looks, looks)
    return Evidence(matrices, np.einsum("pnki,pnk->pni", looks, seen), np.ones((PHOTOS, len(by))), np.ones(PHOTOS))


def grid(by: NDArray[np.float64]) -> Compared:
    """A flat surface whose places have moved `by` [N, 3]."""
    x, y = np.meshgrid(2.0 * np.arange(COLUMNS), 2.0 * np.arange(ROWS))
    count = x.size
    places = Places(np.stack([x.ravel(), y.ravel(), np.zeros(count)], axis=1), np.ones(count))
    index = np.arange(count).reshape(ROWS, COLUMNS)
    sides = [(index[:, :-1], index[:, 1:]), (index[:-1], index[1:])]
    edges = np.concatenate([np.stack([a.ravel(), b.ravel()], axis=1) for a, b in sides])
    nothing: Any = None
    surface = Surface(nothing, nothing, places, edges, np.full(count, 4.0))
    own, other = said(np.zeros((count, 3)), 1), said(by, 2)
    common = common_motion(own, other, places)
    return Compared(
        surface, surface, own, other, common, regions.tested(own, other, places, common), np.zeros(count), SAME
    )


def moving(gap: float) -> tuple[Compared, NDArray[np.int64]]:
    """Two squares of 24 px that move by 1 px and lie a gap apart that seems to move by `gap`, and their region."""
    by = np.zeros((ROWS, COLUMNS, 3))
    by[4:16, 3:15, 0] = by[4:16, 18:30, 0] = 1.0
    by[4:16, 15:18, 0] = gap
    flat = by.reshape(-1, 3)
    return grid(flat), np.flatnonzero(flat[:, 0] > 0.1)


def whole(found: Compared, region: NDArray[np.int64]) -> Any:
    members = _members([region], len(found.surface.places.at))
    return between(pooled(found.own, members), pooled(found.other, members))


def test_what_a_narrow_gap_joins_is_parted_where_the_motion_falls_off() -> None:
    found, region = moving(gap=0.2)
    two = sorted(parted(found, region, whole(found, region)), key=lambda part: int(part.places.min()))
    assert len(two) == 2 and np.array_equal(np.sort(np.concatenate([part.places for part in two])), region)
    for part, columns in zip(two, ((3, 15), (18, 30)), strict=True):
        core = part.supports[PARTS.shares.index(0.5)]
        column = core % COLUMNS
        assert (column >= columns[0] - 1).all() and (column < columns[1] + 1).all() and len(core) > 0.9 * 144
        assert all(np.isin(few, more).all() for more, few in itertools.pairwise(part.supports))
        assert np.isin(part.inner, core).all() and 5 <= len(part.inner) < len(core)


def test_three_that_touch_two_by_two_are_three() -> None:
    """The saddles between them are of different heights."""
    by = np.zeros((ROWS, COLUMNS, 3))
    by[4:16, 1:11, 0] = by[4:16, 13:23, 0] = by[4:16, 25:35, 0] = 1.0
    by[8:12, 11:13, 0], by[8:12, 23:25, 0] = 0.75, 0.55
    flat = by.reshape(-1, 3)
    found, region = grid(flat), np.flatnonzero(flat[:, 0] > 0.1)
    parts = sorted(parted(found, region, whole(found, region)), key=lambda part: int(part.places.min()))
    assert [int(np.median(part.places % COLUMNS)) // 12 for part in parts] == [0, 1, 2]


def test_what_moves_as_one_stays_one() -> None:
    found, region = moving(gap=1.0)
    (one,) = parted(found, region, whole(found, region))
    assert np.array_equal(one.places, region)


@pytest.fixture(scope="module")
def still(tmp_path_factory: pytest.TempPathFactory) -> Compared:
    """A small scene and itself."""
    twin = open_twin(write_scene(tmp_path_factory.mktemp("still"), Scene()), Silent())
    first = surface_of(twin, Silent())
    own = evidence(twin, twin, first.places, Silent())
    return _compared(first, first, _paired(first, first, own, own, SAME), SAME)


def disc(found: Compared, radius: float) -> NDArray[np.int64]:
    """Places within `radius` px of a place of the bare wall."""
    at = (found.surface.places.at - (0.05, -0.2, AWAY)) / PX
    return np.flatnonzero(np.linalg.norm(at, axis=1) < radius)


def explained(still: Compared, support: NDArray[np.int64], by: float, tried: tuple[float, ...]) -> list[Fit]:
    """What discs of the radii `tried` explain of a support that moves by `by` px sideways, without noise."""
    model, everywhere = _Moving(still), np.zeros((len(still.gap), 3))
    everywhere[support] = (by, 0.0, 0.0)
    said = model._evidence(everywhere)
    model.shown = pooled(said, model.near)  # (photos as free of noise as what they are compared with)
    near = solved(model.shown)
    observed = Motion(near.by, np.tile(0.05**2 * np.eye(3), (len(near.by), 1, 1)), near.seen)
    inner = disc(still, 4.0)
    shown = solved(pooled(said, _members([inner], len(near.by)))).by
    part = Part(support, disc(still, 26.0), tuple(disc(still, radius) for radius in tried), inner, 4.0)
    return [model.fit([part], index, shown, observed) for index in range(len(tried))]


def test_how_a_motion_falls_off_says_how_far_it_reaches_and_so_how_large_it_is(still: Compared) -> None:
    narrow, right, wide = explained(still, disc(still, 10.0), 0.8, (6.0, 10.0, 16.0))
    assert right.misfits[0] < 0.05 * min(narrow.misfits[0], wide.misfits[0])
    assert right.sizes[0] == pytest.approx(0.8, rel=0.02)
    assert narrow.sizes[0] > 1.05 * right.sizes[0] > 1.1 * wide.sizes[0]


def test_noise_in_gradients_is_taken_off(still: Compared) -> None:
    """Photos whose gradients hold a fifth more than the render's: motions had come out as much too small."""
    model = _Moving(still)
    clean = pooled(model._evidence(np.zeros((len(still.gap), 3))), model.near)
    model.shown = replace(clean, matrices=1.2 * clean.matrices)
    places, way = disc(still, 10.0), np.array([1.0, 0.0, 0.0])
    assert model._noise(clean, places, way) == pytest.approx(np.full(len(places), 1.2), rel=1e-5)
    model.shown = replace(clean, matrices=9.0 * clean.matrices)  # (another surface, rather than noise)
    assert model._noise(clean, places, way).max() == PARTS.noise


def test_a_size_is_the_mean_of_what_supports_say_and_its_interval_holds_those_that_explain_as_much() -> None:
    one = np.ones(1)
    alike = [Fit(size * one, one, 0.01 * one) for size in (0.8, 1.0)]
    size, deviation = _likely(alike, 4.0 * one, 0.0 * one)
    assert size[0] == pytest.approx(0.9) and deviation[0] == pytest.approx(np.hypot(0.1, 0.05))
    clear = [Fit(0.8 * one, 9.0 * one, 0.01 * one), Fit(one, one, 0.01 * one)]
    size, deviation = _likely(clear, 4.0 * one, 0.1 * one)
    assert size[0] == pytest.approx(1.0) and deviation[0] == pytest.approx(np.hypot(0.1, 0.05), rel=1e-4)
    exact = [Fit(size * one, misfit * one, 0.01 * one) for size, misfit in ((0.8, 1.0), (1.0, 0.0))]
    assert _likely(exact, 4.0 * one, 0.1 * one)[0] == pytest.approx(1.0)


def test_what_is_seen_worst_counts_where_it_is_more_than_chance() -> None:
    covariance = np.tile(np.diag([0.01, 0.01, 0.25]), (2, 1, 1))
    by = np.array([[1.0, 0.0, 0.9], [1.0, 0.0, 1.1]])
    assert _ways(by, covariance) == pytest.approx(np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 1.1]]))


def test_all_of_a_motion_is_found_where_a_part_is_wide(still: Compared) -> None:
    """Photos that show it, as `between` asks them: the whole of the wall about a place."""
    inner, wide = disc(still, 5.0), disc(still, 26.0)
    found = Compared(**{**vars(still), "other": still.other.moved(np.tile([-0.6, 0.0, 0.0], (len(still.gap), 1)))})
    motion = sized(found, [Part(wide, wide, (disc(still, 60.0),) * len(PARTS.shares), inner, 4.0)])
    assert motion.by[0] == pytest.approx([0.6, 0.0, 0.0], abs=0.06)
    assert 0.06 <= motion.deviation[0] < 0.2


@pytest.mark.parametrize("left, kind", [(-0.8, "grew"), (0.0, None), (1.0, None)])
def test_what_has_grown_has_two_sides_that_went_opposite_ways(left: float, kind: str | None) -> None:
    """Where one side stands still, the other has moved, and how far it reaches is asked."""
    by = np.zeros((ROWS, COLUMNS, 3))
    by[4:16, 10:18, 0], by[4:16, 18:26, 0] = left, 0.8
    found, region = grid(by.reshape(-1, 3)), np.zeros((ROWS, COLUMNS), bool)
    region[4:16, 10:26] = True
    grown = _grown(found, np.flatnonzero(region))
    assert (grown is None and kind is None) or (grown is not None and grown.kind == kind)
