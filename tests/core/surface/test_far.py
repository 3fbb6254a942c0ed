"""What is far: px at no known depth, which other views confirm."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
from dgs.core.imaging.medium import Medium
from dgs.core.progress import Silent
from dgs.core.surface.far import OpenView, far_samples
from dgs.core.surface.find import surface_points
from dgs.core.surface.stack import ViewStack, stack_views

from .scenes import BEHIND, RADIUS, arc, drawn

SURFACES = np.random.default_rng(0).normal(size=(200, 3))
SURFACES /= np.linalg.norm(SURFACES, axis=1, keepdims=True)


def views_of_sky() -> tuple[ViewStack, list[OpenView]]:
    """A ball before a sky that is all white; open is what shows sky."""
    scene = drawn(arc(5), plane=False)
    opaque = [replace(photo, alpha=None, background=None) for photo in scene.photos]
    views = stack_views(opaque, scene.cameras, Medium(None))
    return views, [OpenView(i, ~np.isfinite(depth)) for i, depth in enumerate(scene.depths)]


def test_sky_lies_beyond_everything_and_behind_no_surface() -> None:
    views, opened = views_of_sky()
    found = far_samples(opened, SURFACES, views, 0.05)
    assert len(found) > 500 and (found.confidence == np.float32(0.05)).all() and (found.colours == 255).mean() > 0.98
    middle = np.median(views.centres, axis=0)
    distance = np.linalg.norm(found.positions - middle, axis=1)
    spread = np.linalg.norm(views.centres - middle, axis=1).max()
    reach = np.percentile(np.linalg.norm(SURFACES - middle, axis=1), 98)
    assert np.allclose(distance, max(2 * reach, 10 * spread))
    for view in range(len(views)):  # no sample is seen before the ball
        pixels, depth = views.depths(view, found.positions)
        assert (depth > 0).all()
        at = np.floor(pixels).astype(int)
        assert opened[view].open[at[:, 1], at[:, 0]].mean() > 0.9


def test_what_no_other_view_confirms_is_left_out() -> None:
    views, opened = views_of_sky()
    assert len(far_samples(opened[:1], SURFACES, views, 0.05)) == 0
    tinted = replace(views, colours=views.colours // np.array([1, 2, 4, 8, 16], np.uint8)[:, None, None, None])
    assert len(far_samples(opened, SURFACES, tinted, 0.05)) == 0  # each photo shows another colour there
    assert len(far_samples([replace(o, open=~o.open) for o in opened], SURFACES, views, 0.05)) < 20


def test_a_surface_search_ends_with_the_sky(tmp_path: Path) -> None:
    scene = drawn(arc(12, half=0.5), size=(160, 120), focal=160.0, plane=False)
    opaque = [replace(photo, alpha=None, background=None) for photo in scene.photos]
    found = surface_points(opaque, scene.cameras, Medium(None), tmp_path, 2, Silent()).points
    distance = np.linalg.norm(found.positions, axis=1)
    far = distance > 5 * BEHIND
    assert far.sum() > 200
    assert np.median(np.abs(distance[~far] - RADIUS)) < 0.05
