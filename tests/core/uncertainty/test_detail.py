"""Detail that photos resolve through the blur, and which candidate covers most of it."""

from dataclasses import replace

import pytest
import torch
from dgs.core.imaging.psf import PointSpread
from dgs.core.uncertainty.coverage import Coverage
from dgs.core.uncertainty.detail import Detail, passed
from dgs.core.uncertainty.linear_model import LinearModel
from dgs.tests.core.uncertainty.uncertainty_scenes import camera, linear_model_at

NOISE = 0.02


def viewpoint(linear, where):
    return type(linear.viewpoints[0])(where, linear.viewpoints[0].psf)


def detail_of(cameras, sigma, wanted=None):
    linear = linear_model_at(cameras, sigma)
    return Detail(linear, NOISE, [viewpoint(linear, c) for c in wanted or cameras], linear.viewpoints)


def test_the_blur_passes_what_its_spectrum_says_and_px_nothing_beyond_half_a_cycle():
    frequencies = torch.tensor([0.0, 0.1, 0.2, 0.6])
    wide = passed(PointSpread("gaussian", 2.0, 2.0), frequencies)
    exact = torch.exp(-4 * torch.pi**2 * 4.0 * frequencies**2)
    torch.testing.assert_close(wide[:3], exact[:3], atol=5e-3, rtol=0.02)
    assert float(wide[3]) == 0.0 and passed(None, frequencies).tolist() == [1.0, 1.0, 1.0, 0.0]


def test_blur_distance_and_slant_resolve_less():
    near = camera(0.0)
    clear, blurred = (detail_of([near], sigma) for sigma in (0.0, 2.0))
    seen = clear.seen(clear.linear.viewpoints[0]) > 1.0
    resolved = [d.resolved(d.linear.viewpoints[0])[seen].mean(dim=0) for d in (clear, blurred)]
    assert float(resolved[0].mean()) > float(resolved[1].mean()) + 0.2
    assert float(resolved[1][0]) < 0.01 and float(resolved[1][-1]) > 0.5  # fine detail is gone, coarse is there
    others = camera(0.0, -5.0), camera(4.0, -0.5, 0.0)
    far, aslant = (float(clear.resolved(viewpoint(clear.linear, c))[seen].mean()) for c in others)
    assert float(resolved[0].mean()) > far + 0.1 and float(resolved[0].mean()) > aslant + 0.3


def test_contrast_is_where_the_colours_change_and_the_unseen_is_like_its_neighbours():
    linear = linear_model_at([camera(0.0)], 0.0)
    means = linear.gaussians.means
    left = means[:, 0] < 0.0
    sh = torch.where(left[:, None, None], 0.0, linear.gaussians.sh)
    twin = LinearModel(replace(linear.gaussians, sh=sh), linear.viewpoints, 0, torch.zeros(3), linear.settings)
    variance = Detail(twin, NOISE, twin.viewpoints, twin.viewpoints).variance
    inner = means[:, 1].abs() < 0.4
    plain, painted = (float(variance[inner & ((means[:, 0] - x).abs() < 0.15)].mean()) for x in (-0.4, 0.4))
    assert painted > 3 * plain
    middle = viewpoint(twin, camera(0.0, -0.8))  # does not see the sides
    variance = Detail(twin, NOISE, twin.viewpoints, [middle]).variance
    plain, painted = (float(variance[inner & ((means[:, 0] - x).abs() < 0.15)].mean()) for x in (-0.75, 0.75))
    assert painted > 3 * plain


def test_photos_cover_what_they_see_and_a_second_one_there_adds_little():
    first = camera(-0.6, -1.0)
    detail = detail_of([first], 1.5, [first, camera(0.6, -1.0), camera(0.0, 2.0)])
    linear = detail.linear
    coverage = Coverage(detail, [viewpoint(linear, c) for c in (first, camera(0.6, -1.0), camera(0.0, 2.0))])
    assert coverage.gain(linear.viewpoints[0]) > 0.0
    coverage.take(linear.viewpoints[0])
    again, other, away = (viewpoint(linear, c) for c in (first, camera(0.6, -1.0), camera(9.0, -1.0)))
    assert coverage.gain(again) < 0.1 * coverage.gain(other) < 0.1 and coverage.gain(away) == 0.0
    scores = coverage.scores([again, other, away])
    assert scores[1] == max(scores)
    coverage.take(other)
    assert coverage.gain(other) == 0.0


def test_standing_aside_counts_but_not_for_who_looks_away():
    front = camera(0.0)
    detail = detail_of([front], 1.5)
    linear = detail.linear
    coverage = Coverage(detail, linear.viewpoints, linear.viewpoints)
    others = camera(0.2, look=0.0), camera(2.0, look=0.0), camera(9.0)
    near, wide, away = (coverage.aside(viewpoint(linear, c)) for c in others)
    assert wide > 3 * near > 0.0 and away == 0.0


@pytest.mark.parametrize("count", [0, 1])
def test_twins_of_nothing_are_ranked_without_a_word(count):
    linear = linear_model_at([camera(0.0)], 1.5)
    few = type(linear.gaussians)(**{n: t[:count] for n, t in linear.gaussians.named()})
    twin = LinearModel(few, linear.viewpoints, linear.margin, torch.zeros(3), linear.settings)
    detail = Detail(twin, NOISE, twin.viewpoints, twin.viewpoints)
    scores = Coverage(detail, twin.viewpoints, twin.viewpoints).scores(
        [viewpoint(twin, camera(x)) for x in (0.0, 1.0, 9.0)]
    )
    assert len(scores) == 3 and all(score == score for score in scores)
