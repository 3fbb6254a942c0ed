"""The parts of the estimator, on numbers whose answer is written down."""

from __future__ import annotations

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.change.alignment import agreed_world, composed, inverse
from dgs.core.change.evidence import Evidence, Places
from dgs.core.change.light import lit_alike
from dgs.core.change.matching import Matches
from dgs.core.change.motion import Motion, between, common_motion, paired, rotation_of
from dgs.core.change.regions import chance, not_by_chance
from dgs.core.errors import NoOverlap
from dgs.core.evaluation.poses import Similarity
from scipy.ndimage import gaussian_filter

PHOTOS, PLACES = 14, 300


def places() -> Places:
    at = np.random.default_rng(0).normal(size=(PLACES, 3)) * (1.0, 0.7, 0.1)
    return Places(at, np.full(PLACES, 0.01))


def evidence(by: np.ndarray, seed: int, noise: float = 0.5) -> Evidence:
    """Of photos that each see all places move `by` [N, 3], in directions of their own."""
    random = np.random.default_rng(seed)
    looks = np.random.default_rng(5).normal(size=(PHOTOS, PLACES, 4, 3))
    seen = np.einsum("pnki,ni->pnk", looks, by) + noise * random.standard_normal((PHOTOS, PLACES, 4))
    matrices = np.einsum("pnki,pnkj->pnij", looks, looks)
    ones = np.ones((PHOTOS, PLACES))
    return Evidence(matrices, np.einsum("pnki,pnk->pni", looks, seen), ones, np.ones(PHOTOS))


def test_motions_come_out_with_deviations_that_hold() -> None:
    """Less what the first photos have wrong, too."""
    wrong, by = np.full((PLACES, 3), 0.4), np.tile([1.0, -0.5, 0.2], (PLACES, 1))
    motion = between(evidence(wrong, 1), evidence(wrong + by, 2))
    assert np.allclose(motion.by.mean(axis=0), by[0], atol=0.03)
    off = Motion(motion.by - by, motion.covariance, motion.seen)
    assert 0.9 < np.mean(off.surprise < 7.815) <= 1.0


def test_photos_of_cameras_that_stand_alike_go_together() -> None:
    cameras = [
        Camera(str(x), 9, 9, 9.0, 9.0, 4.5, 4.5, np.eye(3), np.array([-x, 0.0, 3.0])) for x in np.linspace(-1, 1, 14)
    ]
    still = evidence(np.zeros((PLACES, 3)), 1)
    own, other = paired(still, still.rows(np.arange(13, 2, -1)), (cameras, cameras[:2:-1]), places())
    assert len(own.matrices) == len(other.matrices) == 14
    beside = (other.matrices != 0).any(axis=(1, 2, 3))
    assert beside.sum() == 11 and np.array_equal(own.moments[beside], other.moments[beside])


def test_a_common_motion_is_that_of_the_majority() -> None:
    """A third of the places moves by itself."""
    where, true = places(), np.array([0.5, -0.3, 0.4, 0.6, 0.2, -0.5, 0.3])
    still = evidence(np.zeros((PLACES, 3)), 1)
    jacobian = common_motion(still, still, where).jacobian
    by = jacobian @ true
    by[:100] += (3.0, 4.0, -5.0)
    found = common_motion(still, evidence(by, 2), where)
    assert np.allclose(found.values, true, atol=0.15)
    assert (np.abs(found.values - true) < 4 * np.sqrt(np.diag(found.covariance))).all()
    scale, rotation, translation = found.similarity()
    moved = (scale * where.at @ rotation.T + translation - where.at) / where.pixel[:, None]
    assert np.allclose(moved, found.by, atol=0.02)


def test_what_has_moved_draws_the_whole_its_way_unless_it_is_left_out() -> None:
    """Half of the places move all by the same little."""
    by, moved = np.zeros((PLACES, 3)), np.arange(PLACES) % 2 == 0
    by[moved, 0] = 0.6
    own, other = evidence(np.zeros((PLACES, 3)), 1), evidence(by, 2)
    drawn, free = common_motion(own, other, places()), common_motion(own, other, places(), ~moved)
    assert abs(free.by[:, 0].mean()) < 0.03 < 0.07 < drawn.by[:, 0].mean()


def test_false_ones_are_kept_few() -> None:
    random = np.random.default_rng(0)
    spread = np.diag([0.01, 0.02, 0.3])
    by = random.multivariate_normal(np.zeros(3), spread, 4000)
    held = np.ones(4000, bool)
    motion = Motion(by, np.tile(spread, (4000, 1, 1)), np.full(4000, 200))
    assert np.isclose(np.mean(chance(motion) < 0.05), 0.05, atol=0.015)
    assert not_by_chance(chance(motion)[None], held).sum() <= 2
    by[:400, 2] += 4.0  # seven deviations, where cameras see worst
    kept = not_by_chance(chance(Motion(by, motion.covariance, motion.seen))[None], held)[0]
    assert kept[:400].mean() > 0.95 and kept[400:].sum() <= 12


def test_light_is_no_change_and_a_spot_is_one() -> None:
    random = np.random.default_rng(0)
    shown = gaussian_filter(random.random((3, 120, 160)), (0, 2, 2)).astype(np.float32)
    shown = (shown - shown.min()) / np.ptp(shown)
    x = np.linspace(0.0, 1.0, 160)
    photo = (0.7 * shown * (1.0 + 0.1 * x) + 0.02).astype(np.float32)
    photo[:, 50:60, 60:70] += 0.2
    difference, light = lit_alike(shown, photo)
    assert np.isclose(light.gain, 0.7 * 1.05, atol=0.03)
    spot = np.zeros((120, 160), bool)
    spot[50:60, 60:70] = True
    assert difference[:, spot].mean() > 0.2 and np.abs(difference[:, ~spot]).mean() < 0.02


WORLD = Similarity(0.3, rotation_of(np.array([0.4, -1.0, 2.0])), np.array([5.0, -2.0, 1.0]), 3)


def test_similarities_go_back_and_on() -> None:
    points = np.random.default_rng(0).normal(size=(5, 3))
    assert np.allclose(inverse(WORLD).points(WORLD.points(points)), points)
    assert np.allclose(composed(WORLD, WORLD).points(points), WORLD.points(WORLD.points(points)))


def matches(true: int, false: int) -> Matches:
    """Points that two cameras of each world see, half a px off, and false ones."""
    random, count = np.random.default_rng(0), true + false
    points = random.uniform(-1, 1, (count, 3)) + (0.0, 0.0, 4.0)
    cameras = [Camera("a", 800, 600, 700.0, 700.0, 400.0, 300.0, np.eye(3), np.array([x, 0, 0])) for x in (-0.7, 0.7)]
    photo = np.arange(count) % 2
    local = points + np.stack([camera.translation for camera in cameras])[photo]
    at = local[:, :2] / local[:, 2:] * 700.0 + (400.0, 300.0)
    of_other = np.concatenate([points[:true], random.permutation(points[true:])])
    both = [at + random.normal(0, 0.5, at.shape), at + random.normal(0, 0.5, at.shape)]
    both[1][true:] = random.uniform(0, 600, (false, 2))
    there = inverse(WORLD)
    return Matches(
        (cameras, [there.camera(camera) for camera in cameras]),
        np.stack([photo, photo]),
        np.stack(both),
        np.stack([points, there.points(of_other)]),
    )


def test_worlds_are_aligned_by_what_most_matches_agree_on() -> None:
    world, agreeing = agreed_world(matches(200, 200))
    assert 190 <= agreeing <= 215
    points = np.random.default_rng(1).uniform(-1, 1, (50, 3)) + (0.0, 0.0, 4.0)
    off = world.points(inverse(WORLD).points(points)) - points
    assert np.abs(off).max() < 0.4 * 4.0 / 700.0  # px of the first cameras


def test_worlds_without_agreement_are_refused_with_the_way_out() -> None:
    for found in (matches(0, 300), matches(20, 0)):
        with pytest.raises(NoOverlap, match="cannot be aligned.*Give twins of one object"):
            agreed_world(found)
