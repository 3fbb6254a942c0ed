"""In which unit changes are said: px-equivalents, or that of a known length with its uncertainty in every interval."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dgs.core.change.alignment import SAME
from dgs.core.change.findings import Alignment, Changes, Region
from dgs.core.change.tables import as_plain, csv_text, interval, lines
from dgs.core.measure.known import LengthScale
from dgs.core.measure.request import KnownLength

MOVED = Region("moved", np.zeros(3), 0.02, 300.0, 1.5, 0.1, np.array([1.5, 0.0, 0.0]), "sideways", np.arange(4))
PAINTED = Region("repainted", np.zeros(3), 0.02, 80.0, None, None, np.zeros(3), "", np.arange(2))
FOUND = Changes(
    (MOVED, PAINTED),
    Alignment(SAME, "same world", 0, 0.01, 0.0),
    10,
    np.ones(10, bool),
    0.1,
    1.0,
    ("none", "none"),
    np.full(10, 1.5),
    np.full(10, 0.1),
)
#: A unit of the world is 250 mm, sure to 2 %.
SCALE = LengthScale(KnownLength("edge", 500.0, 10.0, "mm"), 250.0, 5.0)


def test_without_a_known_length_there_are_px_equivalents_and_never_mm() -> None:
    assert FOUND.said(MOVED) == MOVED
    content = as_plain(FOUND, {})
    assert content["scale"] is None and {one["unit"] for one in content["regions"]} == {"px-equivalent"}
    said = "\n".join(lines(FOUND))
    assert "px-equivalents" in said and "--measures FILE" in said and "Lengths are mm" not in said


def test_a_known_length_gives_sizes_ways_and_intervals_its_unit() -> None:
    """A px is 0.02 of the world, so 5 mm; what draws of both factors scatter is the deviation."""
    found = replace(FOUND, scale=SCALE)
    said = found.said(MOVED)
    assert said.value is not None and said.deviation is not None
    assert np.isclose(said.value, 1.5 * 5.0) and np.isclose(said.area, 300.0 * 25.0)
    assert np.allclose(said.motion, [7.5, 0.0, 0.0])
    random = np.random.default_rng(0)
    drawn = random.normal(1.5, 0.1, 10**6) * random.normal(5.0, 0.1, 10**6)
    assert np.isclose(said.deviation, drawn.std(), rtol=0.01) and said.deviation > 0.1 * 5.0
    assert np.allclose(interval(said), np.quantile(drawn, [0.025, 0.975]), rtol=0.01)
    (moved, painted), size = as_plain(found, {})["regions"], as_plain(found, {})["scale"]["size"]
    assert moved["unit"] == "mm" and np.isclose(moved["value"] / (moved["pixel"] * size), 1.5)
    assert painted["value"] is None and np.isclose(painted["area"], 80.0 * 25.0)
    assert csv_text(found).splitlines()[1].split(",")[9] == "mm"
    assert lines(found)[-1] == "Lengths are mm, for 'edge' is 500 +- 10 mm; areas are their squares"


def test_another_world_has_another_size_and_the_same_share_of_uncertainty() -> None:
    inches = SCALE.in_world(40.0)
    assert np.isclose(inches.size, 250.0 / 40.0) and np.isclose(inches.deviation / inches.size, 0.02)
