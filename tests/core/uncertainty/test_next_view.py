"""The ranking of candidates at a whole twin."""

from dataclasses import replace

import numpy as np
import pytest
import torch
from dgs.core.imaging.medium import Medium
from dgs.core.imaging.psf import PointSpread
from dgs.core.progress import Silent
from dgs.core.reconstruction import Figures, Reconstruction
from dgs.core.run_settings import ReconstructSettings
from dgs.core.training.scale import scene_scale
from dgs.core.twin.opened import OpenedTwin
from dgs.core.uncertainty.expected_error import ExpectedErrorSettings
from dgs.core.uncertainty.next_view import NextViewSettings, Observations, rank
from dgs.core.uncertainty.pictures import draw_expected
from dgs.core.views import SparsePoints, View
from dgs.tests.core.uncertainty.uncertainty_scenes import camera, linear_model_at, plane
from PIL import Image

USUAL = ExpectedErrorSettings().usual_weights
QUICK = NextViewSettings(count=2, samples=3, iterations=3)


def twin_of(tmp_path, held, per_view=None):
    """The plane, photographed by five cameras through 1.5 px."""
    cameras = [replace(camera(x, look=0.0), name=f"{i}.png") for i, x in enumerate((-0.6, -0.4, -0.2, 0.0, 0.2))]
    linear = linear_model_at(cameras, 1.5)
    photos = [
        np.round(linear.photo(viewpoint).numpy().clip(0, 1).transpose(1, 2, 0) * 255) for viewpoint in linear.viewpoints
    ]
    views = [View(c, np.ascontiguousarray(p.astype(np.uint8))) for c, p in zip(cameras, photos, strict=True)]
    gaussians = plane()
    where = gaussians.means.numpy().astype(float)
    points = SparsePoints(where, np.full((len(where), 3), 128, np.uint8))
    medium = Medium(PointSpread("gaussian", 1.5, 1.5), per_view=per_view or {})
    figures = Figures("transforms.json", 5, 5, 40.0, float("nan"), 10.0, 0.0)
    settings = ReconstructSettings(photos=tmp_path, out=tmp_path).split()
    return OpenedTwin(
        tmp_path,
        settings,
        [],
        Reconstruction({}, {}, points, figures),
        medium,
        views,
        held,
        gaussians,
        scene_scale(cameras, points),
        torch.zeros(3),
    )


def test_candidates_are_ranked_with_errors_that_held_out_photos_measured(tmp_path):
    offered = [
        replace(c, name=n)
        for c, n in ((camera(-0.3, look=0.0), "again"), (camera(1.5, -1.0, 0.0), "aside"), (camera(30.0), "away"))
    ]
    ranking = rank(twin_of(tmp_path, ["2.png"]), offered, QUICK, Silent())
    by = {s.camera.name: s for s in ranking.suggestions}
    assert ranking.suggestions[0].camera.name == "aside" and by["aside"].order == 1
    assert by["away"].covers == 0.0 and by["aside"].covers > by["again"].covers
    assert by["aside"].error > by["again"].error > 0.0
    assert ranking.error["held_photos"] == 1 and ranking.error["weights"]["placed"] < USUAL[1]
    assert list(ranking.views) == [s.camera.name for s in ranking.suggestions if s.order]
    sharp, deviation, observed = ranking.views["aside"]
    assert sharp.shape[1:] == deviation.shape and float(deviation.square().mean().sqrt()) == pytest.approx(
        by["aside"].error, rel=1e-4
    )
    (tmp_path / "drawn").mkdir()
    (tmp_path / "drawn" / "old.png").write_bytes(b"")
    draw_expected(tmp_path / "drawn", ranking.views, ranking.error["contrast"])
    assert sorted(p.stem for p in (tmp_path / "drawn").iterdir()) == sorted(ranking.views)
    drawn = np.asarray(Image.open(tmp_path / "drawn" / "aside.png")).astype(float)
    assert drawn.shape == (32, 144, 3)
    assert observed.shape == deviation.shape and float(observed.min()) >= 0.0 and float(observed.max()) <= 1.0
    np.testing.assert_allclose(drawn[:, :48] / 255, sharp.clamp(0, 1).permute(1, 2, 0), atol=0.003)
    worst, best = (int(f()) for f in (deviation.argmax, deviation.argmin))
    redness = (drawn[:, 96:, 0] - drawn[:, 96:, 1]).ravel()
    assert redness[worst] > redness[best] + 20
    alone = rank(twin_of(tmp_path, []), offered, QUICK, Silent())
    assert alone.error["held_photos"] == 0
    assert list(alone.error["weights"].values()) == pytest.approx(USUAL)
    assert by["aside"].plain()["expected_error"] == pytest.approx(by["aside"].error, abs=1e-5)


def test_a_candidate_has_the_blur_of_the_photo_next_to_it(tmp_path):
    wide = PointSpread("gaussian", 4.0, 4.0)
    observations = Observations(twin_of(tmp_path, [], {"4.png": wide}))
    blurs = [observations.viewpoint(camera(x, look=0.0)).psf for x in (-0.6, 0.3)]
    assert [round(psf.sigma_x, 3) for psf in blurs] == [1.5, 4.0]
    assert Observations(twin_of(tmp_path, []), through_blur=False).viewpoint(camera(0.3)).psf is None
