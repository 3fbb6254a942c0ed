"""Frosted glass from photos of a point at several distances."""

import json
import math

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.calibration.glass import WidthAt, glass_of
from dgs.core.errors import PsfError
from dgs.tests.core.calibration import calibration_photos as photos

FOCAL, ANGLE, DISTANCE = 480.0, math.radians(0.8), 0.38


def width(depth: float) -> float:
    return FOCAL * ANGLE * (1 - DISTANCE / depth)


def test_rendered_glass_is_measured():
    """docs/real_blur.md: widths that Cycles gave at z_d = 0.5, 1 degree, f = 213 px."""
    found = glass_of([WidthAt(z, s, 0.01) for z, s in ((0.75, 1.25), (1, 1.86), (2, 2.80), (4, 3.27))], 213.0)
    assert found.distance == pytest.approx(0.5, rel=0.02) and math.degrees(found.angle) == pytest.approx(1.0, rel=0.02)
    assert 0 < found.distance_error < 0.02 and found.setting == "0.49956,1.004"


def test_errors_are_as_large_as_said():
    random, found = np.random.default_rng(0), []
    for _ in range(200):
        found.append(glass_of([WidthAt(z, width(z) + 0.02 * random.normal(), 0.02) for z in (0.5, 0.7, 1.5)], FOCAL))
    off = np.array([(g.distance - DISTANCE) / g.distance_error for g in found])
    assert 0.8 < np.sqrt(np.mean(off**2)) < 1.2


@pytest.mark.parametrize(
    ("widths", "way_out"),
    [
        ([(0.6, 2.0)], "two photos"),
        ([(0.6, 2.0), (0.62, 2.1)], "one and a half times"),
        ([(-1.0, 2.0), (0.62, 2.1)], "two photos"),
        ([(0.6, 2.0), (1.2, 2.0)], "--psf"),
        ([(0.6, 2.0), (1.2, 1.0)], "--psf"),
        ([(0.5, 0.0), (0.6, -0.1), (1.2, 4.0)], "along its axis"),
    ],
)
def test_what_it_refuses(widths, way_out):
    with pytest.raises(PsfError, match=way_out):
        glass_of([WidthAt(z, s, 0.01) for z, s in widths], FOCAL)


def test_the_command_reads_photos(tmp_path, capsys):
    depths, files = (0.55, 1.4), []
    for depth in depths:
        light = photos.point_light(120, (60.2, 59.7), width(depth))
        files.append(str(photos.photo(tmp_path / f"{depth}.tif", light)))
    words = ["--distances", *map(str, depths), "--focal", str(FOCAL), "--progress", "none"]
    assert run(["measure-glass", *files, *words, "--json"]) == 0
    shown = json.loads(capsys.readouterr().out)
    assert shown["distance"] == pytest.approx(DISTANCE, rel=0.02) and shown["angle"] == pytest.approx(0.8, rel=0.02)
    assert run(["measure-glass", *files, "--distances", "1", "--focal", str(FOCAL), "--progress", "none"]) != 0
    assert "one for each photo" in capsys.readouterr().err
