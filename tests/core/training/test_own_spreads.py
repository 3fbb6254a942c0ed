"""Photos with point spreads of their own: objectives, noise, checkpoints, and what simulating motion gains."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.errors import PsfError
from dgs.core.imaging.composed import moved as moved_by
from dgs.core.imaging.psf_text import parse_psf
from dgs.core.imaging.spectrum import noise_to_signal
from dgs.core.progress import Silent
from dgs.core.rasterizer import RasterSettings, render
from dgs.core.training.job import TrainingJob
from dgs.core.training.kept_state import fingerprint_of
from dgs.core.training.run import train
from dgs.core.training.trainer import Trainer
from dgs.tests.core.training.training_scenes import SHORT, blurred_scene, photographed, psnr

PATH = 9.0


@pytest.fixture(scope="module")
def moved():
    """The tiny scene, every photo smeared along a path of its own; the last two are kept apart."""
    scene = blurred_scene()
    names = [view.name for view in scene.views]
    angles = np.linspace(0, 165, len(names))
    lengths = [0.0 if i % 4 == 3 else PATH for i in range(len(names))]
    psf = scene.medium.psf
    own = {n: moved_by(psf, length, angle) for n, length, angle in zip(names, lengths, angles, strict=True) if length}
    medium = replace(scene.medium, per_view=own)
    views = []
    for view in scene.views:
        photo = photographed(scene.truth, view.camera, medium.psf_for(view.name))
        pixels = np.round(np.clip(photo, 0, 1) * 255).astype(np.uint8).transpose(1, 2, 0)
        views.append(replace(view, photo=np.ascontiguousarray(pixels)))
    return scene, views, medium


def test_photos_that_share_a_spread_share_their_objective(moved):
    scene, views, medium = moved
    trainer = Trainer(views, [], scene.points, medium, SHORT)
    level = trainer.levels[-1]
    objectives = {view.name: trainer.objective(level, view) for view in level.views}
    assert len(set(map(id, objectives.values()))) == 1 + sum(i % 4 != 3 for i in range(len(views)))
    shared = Trainer(views, [], scene.points, scene.medium, SHORT)
    assert len({id(shared.objective(shared.levels[-1], view)) for view in shared.levels[-1].views}) == 1
    assert trainer.levels[-1].margin > shared.levels[-1].margin


def test_a_checkpoint_holds_the_spreads(moved):
    scene, views, medium = moved
    prints = [fingerprint_of(Trainer(views, [], scene.points, m, SHORT)) for m in (scene.medium, medium)]
    name = views[0].name
    longer = replace(medium, per_view={**medium.per_view, name: parse_psf("gaussian:2+path:12,0")})
    prints.append(fingerprint_of(Trainer(views, [], scene.points, longer, SHORT)))
    assert "own point spreads" not in prints[0] and prints[0] != prints[1] != prints[2] != prints[0]


def test_noise_is_measured_with_every_photo_s_own_spread():
    random = np.random.default_rng(0)
    f = np.hypot(np.fft.fftfreq(128)[:, None], np.fft.rfftfreq(128)[None, :])
    spreads = [parse_psf("gaussian:1.5"), parse_psf("gaussian:4"), None, parse_psf("gaussian:2+path:9,20")]
    photos = []
    for psf in spreads:
        scene = np.fft.rfft2(random.standard_normal((3, 128, 128))) * np.maximum(f, 1 / 128) ** -1.2 * 0.01
        if psf is not None:
            kernel = np.zeros((128, 128))
            rows, columns = psf.kernel().shape
            kernel[:rows, :columns] = psf.kernel()
            scene = scene * np.fft.rfft2(np.roll(kernel, (-(rows // 2), -(columns // 2)), (0, 1)))
        noise = 0.002 * random.standard_normal((3, 128, 128))
        photos.append((np.fft.irfft2(scene, s=(128, 128)) + noise).astype(np.float32))
    right = noise_to_signal(photos, spreads, 0.0005)
    wrong = noise_to_signal(photos, spreads[1], 0.0005)
    assert not right.contradicted and wrong.contradicted
    same = [noise_to_signal(photos[:1] * 3, psf, 0.0005) for psf in (spreads[0], [spreads[0]] * 3)]
    assert (same[0].brightness == same[1].brightness).all()


def test_splats_cannot_be_widened_by_different_spreads(moved):
    scene, views, medium = moved
    trainer = Trainer(views, [], scene.points, medium, replace(SHORT, blur_evaluation="splats"))
    with pytest.raises(PsfError, match="round Gaussian"):
        trainer.raster_settings(trainer.levels[-1])


def test_simulated_motion_gives_sharper_views(moved):
    """Held-out SHARP views: the twin that was given the paths is nearer to them than the one that does not."""
    scene, views, medium = moved
    found = []
    for given in (scene.medium, medium):
        settings = replace(SHORT, steps=160, max_gaussians=1500)
        twin = train(TrainingJob(views[:-2], [], scene.points, given, settings), Silent())
        scores = []
        for view in views[-2:]:
            image = render(twin.gaussians, view.camera, settings=RasterSettings(low_pass=twin.low_pass)).image
            inside = (slice(None), slice(12, -12), slice(12, -12))
            scores.append(psnr(image.detach().numpy()[inside], scene.sharp[view.name][inside]))
        found.append(float(np.mean(scores)))
    assert found[1] > found[0] + 0.5, found
