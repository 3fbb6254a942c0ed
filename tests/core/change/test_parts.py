"""What has moved in a region: how many, and how much of their motion shows through the blur."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from dgs.core.change import parts, regions
from dgs.core.change.alignment import SAME
from dgs.core.change.compared import _compared, _paired
from dgs.core.change.evidence import Places, evidence
from dgs.core.change.motion import between, common_motion, pooled
from dgs.core.change.pair import Compared
from dgs.core.change.parts import _members, _Moving, parted, sized
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
        core, fewest, most = part.supports
        column = core % COLUMNS
        assert (column >= columns[0] - 1).all() and (column < columns[1] + 1).all() and len(core) > 0.9 * 144
        assert len(fewest) <= len(core) <= len(most) and np.isin(core, most).all()
        assert np.isin(part.inner, core).all() and 5 <= len(part.inner) < len(core)


def test_what_moves_as_one_stays_one() -> None:
    found, region = moving(gap=1.0)
    (one,) = parted(found, region, whole(found, region))
    assert np.array_equal(one.places, region)


def test_what_may_have_moved_too_faintly_to_be_seen_widens_the_reach() -> None:
    """Places about the squares that say next to nothing."""
    found, region = moving(gap=0.2)
    loud = np.where(np.isin(np.arange(COLUMNS * ROWS), region), 1.0, 1e-3).astype(np.float32)
    rows = [
        replace(e, matrices=e.matrices * loud[:, None, None] ** 2, moments=e.moments * loud[:, None])
        for e in (found.own, found.other)
    ]
    quiet = replace(found, own=rows[0], other=rows[1])
    clear, faint = (parted(some, region, whole(some, region)) for some in (found, quiet))
    assert max(len(part.supports[2]) for part in clear) < 1.2 * 144 < min(len(part.supports[2]) for part in faint)


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


def test_the_smaller_what_moves_the_less_of_its_motion_shows(still: Compared) -> None:
    """A window sees what lies beside it, too, and a neighbour that moves as well gives some of it back."""
    model, by = _Moving(still), np.array([[0.8, 0.0, 0.0]])
    members = _members([disc(still, 3.0)], len(still.surface.places.at))
    shown = [float(model.shares([disc(still, radius)], members, by)[0]) for radius in (3.0, 6.0, 20.0)]
    assert shown[0] < 0.5 < shown[1] < shown[2] and shown[2] == pytest.approx(1.0, abs=0.05), shown
    ring = np.setdiff1d(disc(still, 14.0), disc(still, 6.0))
    both = _members([disc(still, 3.0), ring], len(still.surface.places.at))
    beside = model.shares([disc(still, 6.0), ring], both, np.tile(by, (2, 1)))
    assert beside[0] > shown[1] + 0.1


def test_a_size_is_what_shows_over_its_share_and_its_interval_holds_how_far_it_may_reach(
    still: Compared, monkeypatch: pytest.MonkeyPatch
) -> None:
    inner = disc(still, 5.0)
    part = parts.Part(inner, (inner, inner, inner), inner)
    shares = iter([np.array([0.8]), np.array([0.6]), np.array([1.0])])
    monkeypatch.setattr(parts._Moving, "shares", lambda *_: next(shares))
    found = Compared(**{**vars(still), "other": still.other.moved(np.tile([-0.6, 0.0, 0.0], (len(still.gap), 1)))})
    motion = sized(found, [part])
    assert np.linalg.norm(motion.by[0]) == pytest.approx(0.6 * (1 / 0.8 + 1.0) / 2, rel=0.05)
    assert motion.deviation[0] > 0.6 * (1 / 0.6 - 1.0) / 2
