"""Learned focus: what it finds, what the twin gains, and what is kept of it."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.errors import CheckpointError
from dgs.core.forward import ForwardModel, medium_of, sharp_view
from dgs.core.frames import Frame
from dgs.core.imaging.formation.chain import Formation
from dgs.core.imaging.formation.effect import Shot
from dgs.core.imaging.formation.focus import Focus, LensFocus
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import checkpoint_of, restore
from dgs.core.training.optics.focus import BlurByDepth, LearnedFocus, Seen
from dgs.core.training.run import train
from dgs.core.training.scale import scene_scale
from dgs.core.training.trainer import Trainer
from dgs.core.views import SparsePoints
from dgs.tests.core.training.training_scenes import HEIGHT, SHORT, WIDTH, blurred_scene

SETTINGS = RasterSettings(low_pass=0.3, depth=True)
#: Standard deviation in px for 1 / depth in the world's unit, and foci at both ends and in the middle of the slope.
PX, FOCI = 12.0, (1 / 2.2, 1 / 3.0, 1 / 4.4)
DIAGONAL = float(np.hypot(WIDTH, HEIGHT))


class Photo:
    """What the forward model asks of one."""

    def __init__(self, camera) -> None:
        self.name, self.camera, self.psf = camera.name, camera, None


def true_lens(scene, px=PX):
    """All photos but the last two, each with a focus."""
    names = [view.name for view in scene.views][:-2]
    foci = torch.tensor([FOCI[i % 3] for i in range(len(names))])
    return LensFocus(names, torch.full((len(names),), px / DIAGONAL), foci)


def through(scene, lens):
    """The scene's views, photographed by a lens."""
    views = []
    for view in scene.views:
        frame = Frame(view.camera.height, view.camera.width, 0)
        model = ForwardModel(SETTINGS, lambda _, frame=frame: medium_of(None, frame), 0, Formation([lens]))
        with torch.no_grad():
            photo = model.expose(scene.truth, Photo(view.camera)).degraded.numpy()
        pixels = np.round(photo.clip(0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)
        views.append(replace(view, photo=np.ascontiguousarray(pixels)))
    return views


@pytest.fixture(scope="module")
def scene():
    """A slope: depths from 2 to 4.5."""
    flat = blurred_scene(sigma=0.0)
    means = flat.truth.means.clone()
    means[:, 2] += 0.55 * means[:, 0]
    points = flat.points.positions.copy()
    points[:, 2] += 0.55 * points[:, 0]
    flat.truth.means = means
    return replace(flat, points=SparsePoints(points, flat.points.colours))


def start(views):
    names = [view.name for view in views]
    return Formation([LensFocus(names, torch.zeros(len(names)), torch.ones(len(names)))])


def table_of(scene, view, learned):
    """A photo before the true view, blurred evenly."""
    frame = Frame(view.camera.height, view.camera.width, 0)
    with torch.no_grad():
        rendered = sharp_view(scene.truth, view.camera, SETTINGS)
    photo, shot = torch.from_numpy(view.planes()), Shot(view.name, view.camera.height, view.camera.width)
    seen = Seen(rendered, rendered.mean_depth, photo, None, medium_of(None, frame), shot)
    return BlurByDepth.of(seen, learned.effect, learned.settings)


def test_focus_is_found_and_the_twin_is_sharper_for_it(scene):
    lens = true_lens(scene)
    views = through(scene, lens)
    fitted, held = views[:-2], views[-2:]
    settings, scores = replace(SHORT, steps=200, coarse_share=0.0), []
    sharp = {}
    for view in scene.views:
        with torch.no_grad():
            sharp[view.name] = sharp_view(scene.truth, view.camera, SETTINGS).image
    for chain in (Formation(), start(views)):
        twin = train(TrainingJob(fitted, held, scene.points, Medium(), settings, chain), Silent())
        errors = []
        for view in held:
            with torch.no_grad():
                image = sharp_view(twin.gaussians, view.camera, RasterSettings(low_pass=twin.low_pass)).image
            errors.append(float((image - sharp[view.name]).square().mean()))
        scores.append(-10 * np.log10(np.mean(errors)))
    assert scores[1] > scores[0] + 0.5, scores
    found = twin.formation.focus
    assert found.unit == pytest.approx(scene_scale([v.camera for v in fitted], scene.points).size)
    strengths = [found.of(v.name).strength * found.unit * DIAGONAL for v in fitted]
    assert np.median(strengths) == pytest.approx(PX, rel=0.2)
    for view in fitted:
        assert found.of(view.name).focus / found.unit == pytest.approx(lens.of(view.name).focus, abs=0.045), view.name
    unseen = [found.of(v.name).strength * found.unit * DIAGONAL for v in held]
    assert max(unseen) < 0.3 * np.median(strengths), unseen
    assert float(found.errors.max()) > 0 and set(found.described()["photos"]) == {v.name for v in views}


def test_learning_begins_with_what_points_show(scene):
    """In the world's unit; what they show of a photo that is held out does not count, and a sharp photo stays sharp."""
    lens = true_lens(scene)
    views = through(scene, lens)
    names = [view.name for view in views]
    shown = {name: lens.of(name) for name in names[:-2] if name != names[1]} | {names[-2]: Focus(0.0, 0.3)}
    trainer = Trainer(
        views[:-1], views[-1:], scene.points, Medium(), SHORT, Formation([LensFocus.begun(names, shown, 1.0)])
    )
    focus, size = trainer.learned.focus, trainer.scale.size
    assert focus.begun and focus._own == {names[-2]}
    assert focus.common == pytest.approx(PX / DIAGONAL / size, rel=1e-5)
    for name in names[:-2]:
        if name == names[1]:
            assert focus.effect.of(name).strength == 0.0
            continue
        assert focus.effect.of(name).strength == pytest.approx(lens.of(name).strength / size, rel=1e-5)
        assert focus.effect.of(name).focus == pytest.approx(lens.of(name).focus * size, rel=1e-5)
    assert focus.effect.of(names[-2]).strength == 0.0
    held = Trainer(
        views[:-2], views[-2:], scene.points, Medium(), SHORT, Formation([LensFocus.begun(names, shown, 1.0)])
    )
    assert held.learned.focus._own == set()
    # The same in another unit of depth.
    other = {name: Focus(each.strength / 3.0, each.focus * 3.0) for name, each in shown.items()}
    again = Trainer(
        views[:-1], views[-1:], scene.points, Medium(), SHORT, Formation([LensFocus.begun(names, other, 3.0)])
    )
    for name in names[:-1]:
        assert again.learned.focus.effect.of(name).focus == pytest.approx(focus.effect.of(name).focus, rel=1e-5)
        assert again.learned.focus.effect.of(name).strength == pytest.approx(focus.effect.of(name).strength, rel=1e-5)


def test_a_search_leaves_what_points_show_and_finds_the_rest(scene):
    lens = true_lens(scene)
    views = through(scene, lens)[:-2]
    names = [view.name for view in views]
    shown = {name: lens.of(name) for name in names[1:]}
    learned = LearnedFocus(LensFocus.begun(names, shown, 1.0), names)
    before = {name: learned.effect.of(name) for name in names[1:]}
    tables = {view.name: table_of(scene, view, learned) for view in views}
    learned.search(tables, 0.1)
    assert {name: learned.effect.of(name) for name in names[1:]} == before
    assert learned.effect.of(names[0]).focus == pytest.approx(lens.of(names[0]).focus, abs=0.03)
    assert learned.effect.of(names[0]).strength == pytest.approx(learned.common, rel=0.15)


def test_even_blurs_of_the_true_view_say_focus_and_strength(scene):
    lens = true_lens(scene)
    views = through(scene, lens)[:-2]
    learned = LearnedFocus(start(views).focus, [v.name for v in views])
    tables = {view.name: table_of(scene, view, learned) for view in views}
    learned.search(tables, 0.5)
    assert learned.common * DIAGONAL == pytest.approx(PX, rel=0.2)
    for view in views:
        assert learned.effect.of(view.name).focus == pytest.approx(lens.of(view.name).focus, abs=0.03)
    assert not learned._own


def test_a_run_that_is_resumed_goes_on_to_the_bit(scene):
    views = through(scene, true_lens(scene))

    def trainer():
        return Trainer(views, [], scene.points, Medium(), SHORT, start(views))

    whole, first, again = trainer(), trainer(), trainer()
    for step in range(16):
        whole.advance(step / 40)
        if step < 8:
            first.advance(step / 40)
    restore(again, checkpoint_of(first, 0.0, []))
    for step in range(8, 16):
        again.advance(step / 40)
    a, b = (t.learned.focus.effect.parameters["foci"] for t in (whole, again))
    assert whole.learned.focus.common > 0 and torch.equal(a, b)
    assert torch.equal(whole.optimizer.gaussians.means, again.optimizer.gaussians.means)
    state = checkpoint_of(first, 0.0, [])
    del state.arrays["focus.own"]
    with pytest.raises(CheckpointError, match="focus"):
        restore(trainer(), state)


def test_depth_takes_its_part_of_the_gradient(scene):
    """Where blur goes by depth, moving a Gaussian along the line of sight changes the photo."""
    view, lens = scene.views[0], true_lens(scene)
    frame = Frame(view.camera.height, view.camera.width, 0)
    model = ForwardModel(SETTINGS, lambda _: medium_of(None, frame), 0, Formation([lens]))
    photo = torch.from_numpy(scene.views[0].planes())
    gaussians = scene.truth.detached()

    def loss(along: float) -> float:
        moved = replace(gaussians, means=gaussians.means + along * forward)
        with torch.no_grad():
            return float((model.expose(moved, Photo(view.camera)).reached - photo).square().sum())

    forward = torch.from_numpy(view.camera.rotation[2]).float()
    for _, tensor in gaussians.named():
        tensor.requires_grad_()
    exposed = model.expose(gaussians, Photo(view.camera))
    exposed.backward(2 * (exposed.reached - photo))
    with torch.no_grad():
        own = float((gaussians.means.grad @ forward).sum())
    gaussians = gaussians.detached()
    assert own == pytest.approx((loss(2e-3) - loss(-2e-3)) / 4e-3, rel=0.15)


def test_slopes_of_one_picture_stand_for_those_of_its_layers(scene):
    """A photo is rendered in layers; its slopes are those of one picture, blurred by the depth of its surface."""
    view, lens = scene.views[0], true_lens(scene)
    frame = Frame(view.camera.height, view.camera.width, 0)

    def exposed(by_strength: float = 0.0, by_focus: float = 0.0):
        now = lens.of(view.name)
        changed = lens.alone(view.name, replace(now, strength=now.strength + by_strength, focus=now.focus + by_focus))
        model = ForwardModel(SETTINGS, lambda _: medium_of(None, frame), 0, Formation([changed]))
        with torch.no_grad():
            return model.expose(scene.truth, Photo(view.camera)), changed

    still, effect = exposed()
    learned = LearnedFocus(lens, [view.name])
    learned.effect, learned.begun, learned.common, learned._range = effect, True, lens.of(view.name).strength, 0.2
    assert still.layers is not None
    matrix, _ = learned._linearised(view.name, still, still.degraded, None)
    small = learned.settings.change * learned.common, learned.settings.change * learned._range
    slopes = [
        (exposed(*by)[0].degraded - still.degraded).reshape(-1) / step
        for by, step in (((small[0], 0.0), small[0]), ((0.0, small[1]), small[1]))
    ]
    wanted = torch.stack([torch.stack([one @ other for other in slopes]) for one in slopes]).numpy()
    ratio = np.sqrt(np.diag(matrix) / np.diag(wanted))
    assert ratio[0] / ratio[1] == pytest.approx(1.0, abs=0.06)
    alike = [m[0, 1] / np.sqrt(m[0, 0] * m[1, 1]) for m in (matrix, wanted)]
    assert alike[0] == pytest.approx(alike[1], abs=0.2)


def test_a_flat_scene_is_left_as_it_is():
    """All at nearly one depth: no photo shows where it is focused, and nothing is blurred."""
    focus = LearnedFocus(LensFocus.unknown(["a"]), ["a"])
    known = np.array([0.0, 1.0]), np.ones((24, 2)), np.ones((24, 1)), 0.5, 100.0
    focus.search({"a": BlurByDepth(1.0 / np.linspace(1.0, 1.02, 24), np.full(24, 1 / 24), *known)}, 0.1)
    assert not focus.begun and float(focus.effect.parameters["strengths"].abs().max()) == 0.0


def test_a_focus_at_infinity_is_found():
    inverse = np.linspace(0.4, 1.6, 24)
    variances = np.linspace(0.0, 40.0, 81)
    true = (0.012 * 250.0 * inverse) ** 2
    gap = (np.sqrt(variances)[None] - np.sqrt(true + 1.0)[:, None]) * 0.02
    products = gap[:, :-1] * gap[:, 1:] + 1e-5
    table = BlurByDepth(inverse, np.full(24, 1 / 24), variances, gap**2 + 1e-5, products, 1.0, 250.0)
    learned = LearnedFocus(LensFocus.unknown(["a"]), ["a"])
    learned.search({"a": table}, 0.1)
    assert learned.effect.of("a").focus == pytest.approx(0.0, abs=0.1)
    assert learned.effect.of("a").strength == pytest.approx(0.012, rel=0.15)
