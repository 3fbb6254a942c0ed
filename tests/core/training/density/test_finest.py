"""What no photo has in focus is not made of what is finer than its spots."""

import math
from dataclasses import dataclass, replace

import pytest
import torch
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.focus import OUT_OF_FOCUS, LensFocus
from dgs.core.training.density.finest import FINEST, hold_sizes, narrowest_blur
from dgs.core.training.guards import GUARDS
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import (
    FOCAL,
    HEIGHT,
    SHORT,
    WIDTH,
    blurred_scene,
    camera_at,
    coloured_plane,
)

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
    assert found.size[3:].isinf().all() and found.out_of_focus(step=1) == 1 and found.out_of_focus(step=2) == 2


def test_a_photo_without_a_lens_is_sharp_everywhere():
    found = narrowest_blur(PLACES, photos("near", "sharp"), lens(near=2.0))
    assert (found.size[:3] == 0).all() and found.size[3:].isinf().all() and found.out_of_focus(step=1) == 0


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


@pytest.mark.parametrize("begun", [True, False])
def test_a_training_holds_sizes_once_foci_are_found(begun):
    """Photos that are focused far before the plane, all of them; before any focus is found nothing is held."""
    scene = blurred_scene(4, sigma=0.0)
    names = [view.name for view in scene.views]
    settings = replace(SHORT, coarse_share=0.0, density_every=10_000)
    trainer = Trainer(scene.views, [], scene.points, scene.medium, settings, Formation([LensFocus.unknown(names)]))
    focus = trainer.learned.focus
    focus.effect.parameters["strengths"].fill_(12.0 / DIAGONAL)
    focus.effect.parameters["foci"].fill_(2.0)
    focus._searches, focus.begun = len(focus.settings.search_at), begun
    trainer.step = GUARDS.every - 1
    trainer.advance(0.9)
    gaussians = trainer.optimizer.gaussians
    narrowest = narrowest_blur(gaussians.means, trainer.levels[-1].views, focus.effect)
    bounded = narrowest.size.isfinite()
    coarse_enough = gaussians.log_scales.exp().amin(dim=1)[bounded] >= 0.999 * FINEST.share * narrowest.size[bounded]
    assert bounded.sum() > 100 and bool(coarse_enough.all()) is begun
    assert trainer.repairs.get(OUT_OF_FOCUS, 0) == (narrowest.out_of_focus(1) if begun else 0)
