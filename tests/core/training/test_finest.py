"""What no photo has in focus is not made of what is finer than its spots."""

import math
from dataclasses import dataclass

import pytest
import torch
from dgs.core.imaging.formation.focus import LensFocus
from dgs.core.training.finest import FINEST, hold_sizes, narrowest_blur
from dgs.tests.core.training.training_scenes import FOCAL, HEIGHT, WIDTH, camera_at, coloured_plane

DIAGONAL = math.hypot(WIDTH, HEIGHT)


@dataclass(frozen=True)
class Photo:
    """What is asked of one."""

    name: str
    camera: object


def photos(*names: str) -> list[Photo]:
    return [Photo(name, camera_at(0.0, 0.0, name)) for name in names]


def lens(**foci: float) -> LensFocus:
    """A blur of 12 px for 1 / depth in the world's unit; the foci as depths."""
    return LensFocus(
        list(foci), torch.full((len(foci),), 12.0 / DIAGONAL), torch.tensor([1.0 / depth for depth in foci.values()])
    )


#: On the axis of the cameras: 2, 3 and 5 before them; one behind them, and one far beside their frames.
PLACES = torch.tensor([[0.0, 0.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 2.0], [0.0, 0.0, -9.0], [50.0, 0.0, 0.0]])


def test_the_narrowest_blur_is_that_of_the_photo_which_has_the_place_most_in_focus():
    found = narrowest_blur(PLACES, photos("near", "far"), lens(near=2.0, far=4.0))
    px = [0.0, 12.0 * (1 / 3 - 1 / 4), 12.0 * (1 / 4 - 1 / 5)]
    assert found.px[:3].tolist() == pytest.approx(px, rel=1e-5)
    assert found.size[:3].tolist() == pytest.approx([0.0, px[1] * 3.0 / FOCAL, px[2] * 5.0 / FOCAL], rel=1e-5)
    assert found.size[3:].isinf().all() and found.out_of_focus == 1


def test_a_photo_without_a_lens_is_sharp_everywhere():
    found = narrowest_blur(PLACES, photos("near", "sharp"), lens(near=2.0))
    assert (found.size[:3] == 0).all() and found.size[3:].isinf().all() and found.out_of_focus == 0


def test_only_what_is_finer_grows():
    gaussians = coloured_plane()
    gaussians.log_scales[1] = math.log(0.5)
    before = gaussians.log_scales.clone()
    narrowest = torch.zeros(len(gaussians))
    narrowest[0], narrowest[1], narrowest[2] = 0.4, 0.4, torch.inf
    assert hold_sizes(gaussians, narrowest) == 1
    assert gaussians.log_scales[0].tolist() == pytest.approx([math.log(0.4 * FINEST.share)] * 3)
    assert torch.equal(gaussians.log_scales[1:], before[1:])
    assert hold_sizes(gaussians, narrowest) == 0
