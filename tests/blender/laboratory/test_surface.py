"""The pebbled ball as geometry."""

import numpy as np
from dgs.dgs_addon.laboratory.lines import LINES, centre_line
from dgs.dgs_addon.laboratory.shape import SHAPE, shape_for
from dgs.dgs_addon.laboratory.surface import ball_surface

AXES = np.array([SHAPE.half_length, SHAPE.radius, SHAPE.radius])


def test_pebbles_stand_between_the_valley_and_the_ellipsoid():
    surface = ball_surface(shape_for(200), 0)
    # Distance below the ellipsoid, to first order in the (small) relief.
    radius = np.linalg.norm(surface.vertices / AXES, axis=1)
    normal = np.linalg.norm(surface.vertices / AXES**2, axis=1)
    depth = (1 - radius**2) / (2 * normal)
    assert -1e-6 < depth.min() < 0.2 * SHAPE.height
    assert 0.9 * SHAPE.height < depth.max() < 1.1 * SHAPE.height
    assert 0 <= surface.relief.min() < 0.02 and 0.98 < surface.relief.max() <= 1


def test_normals_point_out_and_seeds_differ():
    shape = shape_for(60)
    first, same, other = ball_surface(shape, 0), ball_surface(shape, 0), ball_surface(shape, 1)
    np.testing.assert_array_equal(first.vertices, same.vertices)
    assert not np.array_equal(first.vertices, other.vertices)
    smooth = ball_surface(type(shape)(height=0.0, around=shape.around, along=shape.along), 0)
    a, b, c, d = (smooth.vertices[smooth.faces[:, i]] for i in range(4))
    assert np.all(np.sum(np.cross(c - a, d - b) * (a + b + c + d), axis=1) > 0)


def test_lines_lie_on_the_ball():
    for line in LINES:
        points, across = centre_line(line, SHAPE)
        np.testing.assert_allclose(np.sum((points / AXES) ** 2, axis=1), 1.0)
        np.testing.assert_allclose(np.sum(across * points / AXES**2, axis=1), 0.0, atol=1e-9)
        np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1.0)
