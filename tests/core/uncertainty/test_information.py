"""What the photos determine and what they leave open, against dense linear algebra and against common sense."""

import numpy as np
import pytest
import torch
from dgs.core.uncertainty.candidates import candidates, looking_at, viewing_geometry
from dgs.core.uncertainty.information_gain import carried, gain_of
from dgs.core.uncertainty.posterior import sample_posterior
from dgs.tests.core.uncertainty.uncertainty_scenes import UP, camera, linear_model_at

NOISE = 0.02


@pytest.mark.parametrize("sigma", [0.0, 1.5])
def test_apply_and_adjoint_are_transposes(sigma):
    linear = linear_model_at([camera(0.2)], sigma)
    viewpoint = linear.viewpoints[0]
    generator = torch.Generator().manual_seed(1)
    step = torch.randn((len(linear.gaussians), 3), generator=generator)
    change = torch.randn((3, viewpoint.camera.height, viewpoint.camera.width), generator=generator)
    there = float((linear.apply(step, viewpoint) * change).sum())
    back = float((linear.adjoint([change], viewpoint)[0] * step).sum())
    scale = float(linear.apply(step, viewpoint).norm() * change.norm())
    assert abs(there - back) < 1e-4 * scale


def dense(linear, taken):
    """[3N, 3N] information of the colours, column by column."""
    n = len(linear.gaussians)
    columns = []
    for index in range(3 * n):
        step = torch.zeros((n, 3))
        step[index // 3, index % 3] = 1.0
        columns.append(torch.cat([linear.apply(step, viewpoint).flatten() for viewpoint in taken]))
    a = torch.stack(columns, dim=1).double()
    return a.T @ a


def test_samples_have_the_spread_of_the_dense_inverse():
    linear = linear_model_at([camera(-0.5), camera(0.1)], 1.5, spacing=0.3)
    exact = torch.linalg.inv(torch.eye(3 * len(linear.gaussians)) + dense(linear, linear.viewpoints) / NOISE**2)
    found = sample_posterior(linear, linear.viewpoints, NOISE, samples=60, iterations=40).steps
    spread = found.square().mean(dim=0).flatten().sqrt()
    wanted = exact.diagonal().float().sqrt()
    np.testing.assert_allclose(spread, wanted, rtol=0.5, atol=0.01)
    assert float((spread / wanted).median()) == pytest.approx(1.0, abs=0.08)


def test_cut_short_it_errs_to_the_side_of_too_much():
    linear = linear_model_at([camera(0.0)], 1.5)
    short, long = (sample_posterior(linear, linear.viewpoints, NOISE, 6, n).steps.square().mean() for n in (2, 40))
    assert 1.05 > float(short) > float(long)


def test_probes_find_the_diagonal():
    linear = linear_model_at([camera(-0.5), camera(0.1)], 1.5, spacing=0.3)
    exact = dense(linear, linear.viewpoints).diagonal().reshape(-1, 3).float()
    probed = linear.diagonal(linear.viewpoints, torch.Generator().manual_seed(0), probes=150)
    seen = exact > 0.01 * exact.max()
    assert float((probed[seen] / exact[seen]).mean()) == pytest.approx(1.0, abs=0.1)


def test_blur_leaves_more_open_and_unseen_splats_keep_the_prior():
    sharp, blurred = (
        (linear := linear_model_at([camera(-0.6, -1.0)], sigma))
        and sample_posterior(linear, linear.viewpoints, NOISE, 8, 15)
        for sigma in (0.0, 2.0)
    )
    near = sharp.seen[0] & blurred.seen[0]
    open_sharp, open_blurred = (float(p.steps[:, near].square().mean()) for p in (sharp, blurred))
    assert open_blurred > 1.15 * open_sharp
    means = linear_model_at([camera(0.0)], 0.0).gaussians.means
    far = means[:, 0] > 0.5  # out of that camera's frame
    for posterior in (sharp, blurred):
        assert float(posterior.steps[:, far].square().mean()) == pytest.approx(1.0, abs=0.1)
        assert not bool(posterior.seen[0, far].any())
        assert float(posterior.determined()[~far].mean()) > float(posterior.determined()[far].mean()) + 0.15


def test_the_next_view_is_where_nobody_has_looked():
    linear = linear_model_at([camera(-0.6, -1.0)], 1.5)
    posterior = sample_posterior(linear, linear.viewpoints, NOISE, 6, 15)
    viewpoint = lambda c: type(linear.viewpoints[0])(c, linear.viewpoints[0].psf)  # noqa: E731
    again, other, away = (
        gain_of(linear, posterior, linear.viewpoints, viewpoint(c))
        for c in (camera(-0.6, -1.0), camera(0.6, -1.0), camera(9.0, -1.0))
    )
    assert other.bits > 2 * again.bits and other.guessed > again.guessed
    assert away.bits == 0.0 and away.covered == 0.0


def test_the_back_of_what_was_seen_from_the_front_is_open():
    linear = linear_model_at([camera(0.0)], 1.5)
    posterior = sample_posterior(linear, linear.viewpoints, NOISE, 4, 10)
    viewpoint = lambda c: type(linear.viewpoints[0])(c, linear.viewpoints[0].psf)  # noqa: E731
    front, back = (
        gain_of(linear, posterior, linear.viewpoints, viewpoint(c)) for c in (camera(0.05), camera(0.0, 2.0))
    )
    assert back.bits > 2 * front.bits
    seen = posterior.seen[0]
    assert float(carried(linear, posterior, linear.viewpoints, viewpoint(camera(0.0)))[seen].min()) > 0.99
    assert float(carried(linear, posterior, linear.viewpoints, viewpoint(camera(0.0, 2.0)))[seen].max()) < 0.01


@pytest.mark.parametrize("path", ["rail", "orbit", "dome"])
def test_candidates_look_at_what_the_photos_look_at(path):
    photos = [camera(x, -2.0, look=0.0) for x in (-0.5, -0.2, 0.1, 0.4)]
    geometry = viewing_geometry(photos)
    np.testing.assert_allclose(geometry.focus, 0.0, atol=1e-3)
    found = candidates(path, photos, 12)
    assert len({c.name for c in found}) == 12
    for c in found:
        u, v, depth = c.rotation @ geometry.focus + c.translation
        assert depth > 0 and abs(u) < 1e-9 and abs(v) < 1e-9
        assert np.linalg.det(c.rotation) == pytest.approx(1.0)
        assert c.rotation[1] @ geometry.up < 0.0  # upright


def test_up_is_up_though_the_cameras_look_down():
    random = np.random.default_rng(0)
    lens = camera(0.0)
    photos = [
        looking_at(lens, str(i), np.array([3 * np.sin(a), -2.0, -3 * np.cos(a)]), np.zeros(3), UP)
        for i, a in enumerate(random.uniform(-0.4, 0.4, 8))
    ]
    np.testing.assert_allclose(viewing_geometry(photos).up, [0.0, -1.0, 0.0], atol=1e-6)
    assert min(-c.centre[1] for c in candidates("orbit", photos, 12)) > 1.9  # none below the table
