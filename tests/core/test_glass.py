"""`--glass` as text."""

import math

import pytest
from dgs.core.errors import PsfError
from dgs.core.glass import GlassRequest, parse_glass


def test_what_it_takes():
    assert parse_glass("auto") == GlassRequest()
    assert parse_glass("0.38") == GlassRequest(0.38)
    assert parse_glass("0.38,0.8") == GlassRequest(0.38, math.radians(0.8))
    assert parse_glass("tilted") == GlassRequest(tilted=True)
    assert parse_glass("standing") == GlassRequest(tilted=True, standing=True)
    assert parse_glass("1,0.8,-30,5") == GlassRequest(1.0, math.radians(0.8), (math.radians(-30), math.radians(5)))
    assert parse_glass("standing,2") == GlassRequest(2.0, standing=True)
    given = GlassRequest(2.0, math.radians(0.8), (0.0, math.radians(5)), standing=True)
    assert parse_glass("standing,2,0.8,0,5") == given


@pytest.mark.parametrize(
    ("text", "way_out"),
    [
        ("", "DISTANCE"),
        ("far", "DISTANCE"),
        ("1,2,3", "DISTANCE"),
        ("standing,", "DISTANCE"),
        ("1,standing", "DISTANCE"),
        ("standing,-1", "above 0"),
        ("nan", "DISTANCE"),
        ("0", "above 0"),
        ("-1,0.5", "above 0"),
        ("1,0", "above 0"),
        ("1,-2", "above 0"),
        ("1,50", "up to 15"),
        ("1,0.8,0,70", "up to 60"),
    ],
)
def test_what_it_refuses(text, way_out):
    with pytest.raises(PsfError, match=way_out):
        parse_glass(text)
