"""The width that edges show at their depth: of an even blur, behind glass, and where none is clear."""

from dataclasses import replace

import numpy as np
import pytest
from dgs.core.effects.glass import inspect
from dgs.core.inspection.blind_psf import edges_of, shared_width
from dgs.core.inspection.edge_depth import width_of_edges
from dgs.core.inspection.photo_set import PhotoSet


def test_an_even_blur_is_found_at_the_depth_of_its_edges(taken):
    photos = taken(psf=(2.0, 2.0, 0.0), space="srgb")
    found = width_of_edges(photos)
    assert found is not None and found.width == pytest.approx(2.0, rel=0.1)
    depth = photos.observations.depth * photos.observations.median_depth
    assert np.quantile(depth, 0.05) < found.depth < np.quantile(depth, 0.95)


def test_sharp_photos_and_photos_without_points_show_none(taken):
    assert width_of_edges(taken()) is None and shared_width(edges_of(taken())) is None
    assert width_of_edges(PhotoSet(taken(psf=(2.0, 2.0, 0.0), space="srgb").photos)) is None


def test_blank_photos_show_none(taken):
    blank = [replace(photo, pixels=np.full_like(photo.pixels, 128)) for photo in taken().photos]
    assert width_of_edges(PhotoSet(blank, taken().cameras)) is None


def test_glass_is_asked_of_points_with_the_width_that_edges_show(taken):
    evidence = inspect(taken(psf=(2.0, 2.0, 0.0), space="srgb"))
    assert "as edges show" in evidence.evidence and not evidence.needed
    assert "as edges show" not in inspect(taken()).evidence
