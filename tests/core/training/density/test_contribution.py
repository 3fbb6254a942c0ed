"""What photos see of each Gaussian, in closed form; what none of them needs goes, and the rest stays as it is."""

from __future__ import annotations

import math

import numpy as np
import pytest
import torch
from dgs.core.camera import Camera
from dgs.core.gaussians import Gaussians
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.density.contribution import (
    CONTRIBUTION,
    SeenByPhotos,
    asking,
    due,
    needed,
    photos_asked,
    seen_by,
    times_asked,
)
from dgs.core.training.density.control import DensityControl
from dgs.core.training.optimizer import Adam

SETTINGS = RasterSettings(low_pass=0.3)


def camera_at(x: float = 0.0, side: int = 96) -> Camera:
    return Camera("c", side, side, 96.0, 96.0, side / 2, side / 2, np.eye(3), np.array([-x, 0.0, 0.0]))


def discs(depths: list[float], opacity: float, size: float = 0.08) -> Gaussians:
    """Round Gaussians on the axis, at depths."""
    n = len(depths)
    return Gaussians(
        means=torch.tensor([[0.0, 0.0, d] for d in depths]),
        log_scales=torch.full((n, 3), math.log(size)),
        quaternions=torch.tensor([[1.0, 0.0, 0.0, 0.0]] * n),
        opacity_logits=torch.full((n,), math.log(opacity / (1 - opacity))),
        sh=torch.randn(n, 4, 3),
    )


def test_one_gaussian_alone_covers_its_opacity_times_its_area() -> None:
    one = discs([2.0], 0.3)
    found = seen_by(one, [(camera_at(), None)], SETTINGS).contribution
    variance = (96.0 * 0.08 / 2.0) ** 2 + 0.3
    # (what lies outside of the ellipse where alpha is below 1/255 is not blended)
    blended = 1.0 - (1 / 255) / 0.3
    assert float(found[0]) == pytest.approx(0.3 * 2 * math.pi * variance * blended, rel=0.02)


def test_the_weights_of_all_add_up_to_the_opacity_of_the_picture() -> None:
    torch.manual_seed(0)
    some = discs([1.5, 2.0, 2.5, 3.0], 0.7)
    views = [camera_at(x) for x in (-0.1, 0.0, 0.2)]
    found = seen_by(some, [(view, None) for view in views], SETTINGS).contribution
    alpha = sum(float(render(some, view, settings=SETTINGS).alpha.sum()) for view in views)
    assert float(found.sum()) == pytest.approx(alpha, rel=1e-4)


def test_what_a_surface_hides_is_not_seen_until_a_camera_looks_behind_it() -> None:
    hidden = discs([1.0, 3.0], 0.99)  # the second one lies behind the first, which looks three times as large
    hidden.log_scales[0] = math.log(0.3)
    hidden.opacity_logits[0] = 12.0
    front = seen_by(hidden, [(camera_at(), None)], SETTINGS)
    both = seen_by(hidden, [(camera_at(), None), (camera_at(1.4, 512), None)], SETTINGS)
    assert needed(front).tolist() == [True, False]
    assert float(front.contribution[1]) < 1.0 and float(both.contribution[1]) > 10.0


def test_how_much_of_itself_is_seen() -> None:
    alone = seen_by(discs([2.0], 0.5), [(camera_at(), None)], SETTINGS)
    assert float(alone.visibility[0]) == pytest.approx(1.0, rel=0.03) and float(alone.framed[0]) == 1.0
    # A small one before the middle of a large one: what is left of its middle is a tenth.
    two = discs([1.0, 2.0], 0.9)
    two.log_scales[0] = math.log(0.4)
    behind = seen_by(two, [(camera_at(), None), (camera_at(0.1), None)], SETTINGS)
    assert float(behind.visibility[1]) == pytest.approx(2 * 0.1, rel=0.15) and float(behind.framed[1]) == 2.0


def test_a_centre_outside_of_the_frame_says_nothing() -> None:
    outside = discs([2.0], 0.9, size=1.0)
    outside.means[0, 0] = 1.3
    found = seen_by(outside, [(camera_at(), None)], SETTINGS)
    assert float(found.contribution[0]) > 100.0
    assert (float(found.visibility[0]), float(found.framed[0])) == (0.0, 0.0)
    assert needed(found).tolist() == [True]


def seen(contribution: list[float], visibility: list[float], framed: list[float]) -> SeenByPhotos:
    return SeenByPhotos(torch.tensor(contribution), torch.tensor(visibility), torch.tensor(framed))


def test_what_lies_hidden_goes_however_much_its_cracks_add_up() -> None:
    of_forty, limit = seen([200.0, 200.0, 10.0], [0.15, 0.3, 20.0], [40.0] * 3), 40 * CONTRIBUTION.hidden
    assert 0.15 < limit < 0.3
    assert needed(of_forty).tolist() == [False, True, False]


def test_of_very_many_photos_few_are_enough() -> None:
    """One photo of a thousand that sees half of it: it is needed."""
    assert needed(seen([100.0], [0.5], [1000.0])).tolist() == [True]
    assert needed(seen([100.0], [0.3], [1000.0])).tolist() == [False]


def test_px_that_do_not_count_need_nothing() -> None:
    one = discs([2.0, 2.0], 0.5, 0.02)
    one.means[0, 0], one.means[1, 0] = -0.5, 0.5
    left = torch.zeros(96, 96)
    left[:, :48] = 1.0
    found = seen_by(one, [(camera_at(), left)], SETTINGS).contribution
    assert float(found[0]) > 1.0 and float(found[1]) == 0.0


def test_nothing_but_what_is_asked_for_is_changed() -> None:
    some = discs([1.5, 2.0], 0.7).requires_grad_()
    before = some.detached()
    seen_by(some, [(camera_at(), None)], SETTINGS)
    assert all(torch.equal(a.detach(), b) for (_, a), (_, b) in zip(some.named(), before.named(), strict=True))
    assert all(t.grad is None for _, t in some.named())


def test_asking_never_takes_more_than_its_price() -> None:
    for steps in (20, 300, 1000, 3400, 30_000):
        for photos in (1, 2, 12, 33, 91, 500, 2000):
            assert 1 <= photos_asked(steps, photos) <= photos
            assert asking(steps, photos) <= max(CONTRIBUTION.price * steps, CONTRIBUTION.step_price)


def test_the_last_question_comes_before_the_end_and_none_comes_twice() -> None:
    for steps, photos in ((300, 33), (1000, 91), (3400, 91)):
        asked, times = 0, []
        for step in range(steps):
            if asked < due(step / steps, steps, photos):
                asked += 1
                times.append(step / steps)
        assert asked == times_asked(steps, photos)
        assert times[-1] == pytest.approx(CONTRIBUTION.last, abs=2 / steps)
        assert np.diff([0.0, *times]).max() < CONTRIBUTION.last / len(times) + 2 / steps


def test_a_long_run_does_not_ask_on_and_on() -> None:
    """57 times in 12,000 steps left 17,000 of 85,000 Gaussians, and held-out views 4.6 dB worse."""
    assert [times_asked(steps, 42) for steps in (300, 1000, 2000, 12_000, 100_000)] == [1, 4, 9, 12, 12]
    assert [due(share, 12_000, 42) for share in (0.04, 0.1, 1.0)] == [0, 2, 12]


def test_the_density_control_keeps_what_it_has_gathered_of_the_others() -> None:
    optimizer = Adam(discs([1.5, 2.0, 2.5], 0.7))
    optimizer.first["means"][:, 0] = torch.arange(3.0)
    density = DensityControl(3, torch.device("cpu"))
    density.gradients, density.views = torch.tensor([1.0, 2.0, 3.0]), torch.tensor([4.0, 5.0, 6.0])
    density.keep(optimizer, torch.tensor([0, 2]))
    assert density.gradients.tolist() == [1.0, 3.0] and density.views.tolist() == [4.0, 6.0]
    assert optimizer.gaussians.means[:, 2].tolist() == [1.5, 2.5]
    assert optimizer.first["means"][:, 0].tolist() == [0.0, 2.0]
