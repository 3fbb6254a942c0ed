"""Small views, neighbours, planes, agreement and guesses, on scenes whose depth is known."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.surface.agreement import AgreementSettings, agreed, compared, lifted_map
from dgs.core.surface.choice import chosen_references, neighbours_of
from dgs.core.surface.fill import filled_maps
from dgs.core.surface.stack import StackSettings, stack_pictures, stack_views
from dgs.core.surface.sweep import DepthMap, SweepSettings, swept
from dgs.core.surface.sweep_kernels import UNSEEN, plane_costs, window_statistics
from dgs.tests.core.surface.scenes import arc, around, drawn
from scipy.ndimage import gaussian_filter

NONE = Medium()
BOUNDS = (3.0, 9.0)


@pytest.fixture(scope="module")
def scene():
    return drawn(arc(9))


@pytest.fixture(scope="module")
def views(scene):
    return stack_views(scene.photos, scene.cameras, NONE)


@pytest.fixture(scope="module")
def maps(views):
    found = []
    for view in range(len(views)):
        others = neighbours_of(view, views, *BOUNDS)
        found.append(swept(view, views, others, BOUNDS, views.counts[view]))
    return found


def test_the_stack_projects_as_the_cameras_do(scene, views):
    """Also where photos are made smaller: px centres, depth and the way back."""
    small = stack_views(scene.photos, scene.cameras, NONE, StackSettings(longest_side=48))
    positions = np.random.default_rng(0).uniform(-1, 1, (50, 3))
    for stack, shrunk in ((views, 1.0), (small, 0.5)):
        for index, camera in enumerate(scene.cameras.cameras().values()):
            p = positions @ camera.rotation.T + camera.translation
            pixels, depth = stack.depths(index, positions)
            np.testing.assert_allclose(depth, p[:, 2])
            np.testing.assert_allclose(pixels, shrunk * (p[:, :2] / p[:, 2:] * camera.fx + [camera.cx, camera.cy]))
            np.testing.assert_allclose(stack.lifted(index, pixels, depth), positions, atol=1e-9)
    assert small.grey.shape == (9, 36, 48) and views.empty is None and views.counts.all()
    assert abs(float(small.grey.mean()) - float(views.grey.mean())) < 0.01


def test_a_blur_is_undone_before_anything_is_compared(scene, views):
    """In full: what is compared is nearer to the sharp photo than the blurred one is."""
    blurred = [replace(p, pixels=gaussian_filter(p.pixels, (1.2, 1.2, 0)).astype(np.uint8)) for p in scene.photos[:2]]
    through = stack_views(blurred, scene.cameras, Medium(parse_psf("gaussian:1.2")))
    as_filed = stack_views(blurred, scene.cameras, NONE)
    inside = (slice(None), slice(6, -6), slice(6, -6))
    off = [np.abs(s.grey - views.grey[:2])[inside].mean() for s in (through, as_filed)]
    assert off[0] < 0.5 * off[1]


def test_references_are_spread_and_neighbours_see_the_same():
    scene = drawn(around(24), (32, 24), 33.0)
    views = stack_views(scene.photos, scene.cameras, NONE)
    chosen = chosen_references(views, count=6)
    assert len(set(chosen)) == 6 and chosen == sorted(chosen)
    directions = views.centres / np.linalg.norm(views.centres, axis=1, keepdims=True)
    nearest = np.sort(directions[chosen] @ directions[chosen].T, axis=1)[:, -2]
    assert nearest.max() < np.cos(np.radians(35))  # 24 views stand 30 degrees apart
    for view in chosen:
        others = neighbours_of(view, views, 4.0, 6.0)
        angles = np.degrees(np.arccos(directions[others] @ directions[view]))
        assert view not in others and len(others) >= 2 and angles.max() < 50
        limited = neighbours_of(view, views, 4.0, 6.0, among=np.isin(np.arange(24), others[1:]))
        assert set(limited) <= set(others[1:])


def test_planes_find_the_depth(scene, maps):
    """Of what is believed, nearly all lies within one per cent, on ball and plane; most of the frame is believed."""
    for one, truth in zip(maps, scene.depths, strict=True):
        sure = one.confidence > 0.3
        error = np.abs(one.depth / truth - 1)[sure]
        assert sure.mean() > 0.4
        assert (error < 0.01).mean() > 0.9 and np.median(error) < 0.002


def test_exposure_changes_nothing(scene, views, maps):
    dimmer = replace(views, grey=np.ascontiguousarray(views.grey * np.linspace(0.4, 1, 9)[:, None, None] + 0.1))
    dimmer.grey.flags.writeable = False
    dimmer = replace(dimmer, grey=dimmer.grey.astype(np.float32))
    others = neighbours_of(6, views, *BOUNDS)
    found = swept(6, dimmer, others, BOUNDS, views.counts[6])
    both = (found.confidence > 0.3) & (maps[6].confidence > 0.3)
    assert both.sum() > 0.9 * (maps[6].confidence > 0.3).sum()
    assert np.abs(found.depth[both] / maps[6].depth[both] - 1).max() < 0.01


def test_what_has_no_texture_or_nobody_else_sees_is_not_believed():
    plain = drawn(arc(5), plain=True)
    views = stack_views(plain.photos, plain.cameras, NONE)
    others = neighbours_of(2, views, *BOUNDS)
    found = swept(2, views, others, BOUNDS, views.counts[2])
    wall = plain.depths[2] > 5.5
    inside = np.zeros_like(wall)
    inside[8:-8, 8:-8] = True
    shrunk = wall & np.roll(wall, 6, 1) & np.roll(wall, -6, 1) & np.roll(wall, 6, 0) & np.roll(wall, -6, 0)
    assert (found.depth[shrunk & inside] == 0).all()
    assert not swept(2, views, others[:0], BOUNDS, views.counts[2]).depth.any()
    assert not swept(2, views, others, BOUNDS, np.zeros_like(wall)).depth.any()


def test_where_one_other_view_looks_it_decides(scene, views):
    """More of what lies at the edge of all photos is found, as exactly; where two are asked for, it is not."""
    others = neighbours_of(0, views, *BOUNDS)
    assert len(others) >= 4
    lone, both = (
        swept(0, views, others, BOUNDS, views.counts[0], settings=SweepSettings(fewest=fewest)) for fewest in (1, 2)
    )
    more = (lone.depth > 0) & (both.depth == 0)
    assert more.mean() > 0.03 and (lone.depth > 0)[both.depth > 0].mean() > 0.98
    assert np.median(np.abs(lone.depth / scene.depths[0] - 1)[more]) < 0.01


def test_one_witness_is_enough_where_no_more_look(scene, views):
    truth = [DepthMap(i, d.astype(np.float32), np.ones_like(d, np.float32)) for i, d in enumerate(scene.depths)]
    points = lifted_map(truth[0], views)
    found = compared(points, np.zeros(len(points), np.int32), truth, views)
    edge = ((found.asked == 1) & (found.agree == 1)).reshape(truth[0].depth.shape)
    believed, strict = (agreed(truth, views, AgreementSettings(fewest=fewest))[0].depth > 0 for fewest in (1, 2))
    assert edge.sum() > 20 and believed[edge].all() and not strict[edge].any()
    inside = (found.asked >= 2).reshape(edge.shape)
    assert (believed == strict)[inside].all()


def test_maps_confirm_one_another_and_shreds_are_dropped(scene, views, maps):
    """A patch that one view alone sees in front of everything is gone, and true depths get closer to the truth."""
    torn = [DepthMap(m.view, m.depth.copy(), m.confidence.copy()) for m in maps]
    torn[4].depth[20:40, 30:60] = 3.5
    torn[4].confidence[20:40, 30:60] = 1.0
    checked = agreed(torn, views)
    assert (checked[4].depth[22:38, 32:58] == 0).mean() > 0.99
    for before, after, truth in zip(maps, checked, scene.depths, strict=True):
        kept = (after.depth > 0) & (before.depth > 0)
        kept[20:40, 30:60] = False
        off = [np.median(np.abs(m.depth / truth - 1)[kept]) for m in (before, after)]
        assert kept.mean() > 0.3 and off[1] < off[0]
        assert (np.abs(after.depth / truth - 1)[kept] < 0.01).mean() > 0.95


def test_points_are_seen_through_only_by_views_that_see_behind_them(scene, views):
    truth = [DepthMap(i, d.astype(np.float32), np.ones_like(d, np.float32)) for i, d in enumerate(scene.depths)]
    on = lifted_map(truth[0], views)[::50]
    ahead = views.centres[0] + 0.8 * (on - views.centres[0])
    behind = views.centres[0] + 1.2 * (on - views.centres[0])
    none = np.full(len(on), -1, np.int32)
    found = [compared(points, none, truth, views) for points in (on, ahead, behind)]
    assert (found[0].agree >= 2).mean() > 0.9 and (found[0].conflict == 0).mean() > 0.9
    assert (found[1].conflict >= 2).mean() > 0.9 and (found[2].conflict == 0).mean() > 0.9


def test_points_are_compared_as_one_by_one():
    """Against plain Python: points of four maps with holes and some in none, more than are projected together."""
    random, size = np.random.default_rng(2), (17, 23)
    moved = np.array([[0.0, 0, 0], [0.3, 0, 0], [0, 0.4, -0.2], [0, 0, 4.5]])
    cameras = [Camera(str(n), 23, 17, 20.0, 20.0, 11.5, 8.5, np.eye(3), -at) for n, at in enumerate(moved)]
    views = stack_pictures(cameras, [np.zeros(size, np.float32)] * 4, [np.ones(size, bool)] * 4)
    depths = random.choice([0.0, 2.0, 2.01, 2.05, 2.3], (len(cameras), *size)).astype(np.float32)
    maps = [DepthMap(index, depth, np.ones_like(depth)) for index, depth in enumerate(depths)]
    lifted = np.concatenate([lifted_map(one, views) for one in maps])
    lifted += random.uniform(-1e-3, 1e-3, lifted.shape)  # (none lies just between two px)
    points = np.concatenate([lifted, random.uniform(-3, 5, (150, 3))])
    own = random.integers(-1, len(maps), len(points)).astype(np.int32)
    settings = AgreementSettings(same=0.004, through=0.02)
    found = compared(points, own, maps, views, settings)
    for n in range(len(points)):
        alike, behind, asked, ratios = 0, 0, 0, [1.0]
        for index in range(len(maps)):
            u, v, depth = views.projections[index] @ points[n] + views.offsets[index]
            i, j = (int(np.floor(side / depth - 0.5)) for side in (u, v))
            if index == own[n] or depth <= 0 or not (0 <= i < size[1] - 1 and 0 <= j < size[0] - 1):
                continue
            asked += 1
            near = depths[index, j : j + 2, i : i + 2].ravel()
            seen = near[near > 0].astype(float)
            if not len(seen):
                continue
            nearest = seen[np.abs(seen - depth).argmin()]
            if abs(nearest - depth) < settings.same * depth:
                alike += 1
                ratios.append(nearest / depth)
            else:
                behind += len(seen) == 4 and seen.min() > (1 + settings.through) * depth
        assert (found.agree[n], found.conflict[n], found.asked[n]) == (alike, behind, asked)
        assert np.isclose(found.ratio[n], np.mean(ratios), rtol=1e-6)
    assert len(points) > 600 and all(len(set(of)) > 2 for of in (found.agree, found.conflict, found.asked))


def test_gaps_are_bridged_on_surfaces_and_not_across_edges(scene, views):
    truth = [DepthMap(i, d.astype(np.float32), np.ones_like(d, np.float32)) for i, d in enumerate(scene.depths)]
    holed = [DepthMap(m.view, m.depth.copy(), m.confidence) for m in truth]
    holed[4].depth[5:15, 5:20] = 0  # on the plane
    edge = np.abs(np.diff(truth[4].depth, axis=1)).max(axis=1).argmax()
    column = int(np.abs(np.diff(truth[4].depth[edge])).argmax())
    holed[4].depth[edge - 1 : edge + 2, column - 4 : column + 5] = 0  # where ball and plane meet
    wanted = [np.ones_like(m.depth, bool) for m in truth]
    found = filled_maps(holed, views, wanted, None)
    gap = found[4].depth[5:15, 5:20]
    there = gap > 0
    assert there.mean() > 0.2  # every second px of both directions
    np.testing.assert_allclose(gap[there], truth[4].depth[5:15, 5:20][there], rtol=1e-4)
    crossing = found[4].depth[edge, column - 4 : column + 5]
    wrong = (crossing > 0) & (np.abs(crossing / truth[4].depth[edge, column - 4 : column + 5] - 1) > 0.1)
    assert not wrong.any()
    assert not any(m.depth.any() for k, m in enumerate(found) if k != 4)


@pytest.mark.parametrize("radius", [1, 2, 3])
def test_costs_are_correlations_of_windows_that_the_other_view_shows_whole(radius):
    """Against numpy's, of a view that shows the same moved by (3, 2) px, with noise and a px that does not count."""
    random, (height, width) = np.random.default_rng(0), (24, 31)
    grey = random.random((height, width)).astype(np.float32)
    other = (0.5 * np.roll(grey, (2, 3), (0, 1)) + 0.2 * random.random(grey.shape)).astype(np.float32)
    counts = np.ones((2, height, width), bool)
    counts[1, 12, 15] = False
    mean, scale = np.zeros_like(grey), np.zeros_like(grey)
    window_statistics(0, height, grey, counts[0], radius, np.float32(1e-3), mean, scale)
    views = (np.stack([grey, other]), counts, np.array([[width, height]] * 2, np.int64), np.array([1], np.int32))
    rays = (np.eye(3)[None], np.array([[3.0, 2.0, 0.0]]), np.ones(1), np.ones(grey.shape))

    def costs(*box: int) -> np.ndarray:
        found = np.full((1, height, width), UNSEEN, np.float32)
        plane_costs(0, 1, grey, mean, scale, np.array(box, np.int64), *views, *rays, radius, 1, found)
        return found[0]

    expected = np.full(grey.shape, UNSEEN)
    for y in range(radius, height - radius - 3):  # (a px at the frame's end has no neighbour to be drawn between)
        for x in range(radius, width - radius - 4):
            rows, moved_rows = (slice(y + j - radius, y + j + radius + 1) for j in (0, 2))
            columns, moved_columns = (slice(x + i - radius, x + i + radius + 1) for i in (0, 3))
            if counts[1, moved_rows, moved_columns].all():
                alike = np.corrcoef(grey[rows, columns].ravel(), other[moved_rows, moved_columns].ravel())[0, 1]
                expected[y, x] = 1.0 - alike
    assert 0.0 < np.mean(expected == UNSEEN) < 0.7 and expected.min() < 0.1
    np.testing.assert_allclose(costs(0, 0, width, height), expected, atol=1e-5)
    part = costs(8, 6, 20, 17)
    np.testing.assert_allclose(part[6:17, 8:20], expected[6:17, 8:20], atol=1e-5)
    assert (costs(0, 0, 1, height) == UNSEEN).all(), "no window has room there"
