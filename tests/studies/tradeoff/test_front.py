"""Which points nothing beats, and what a given time buys."""

from __future__ import annotations

import csv
import io
from pathlib import Path

import pytest
from dgs.studies.tradeoff.chart import draw, front_names
from dgs.studies.tradeoff.front import best_within, line_error, points, time_to
from dgs.studies.tradeoff.knobs import GROUPS, knobs
from dgs.studies.tradeoff.runs import table
from PIL import Image

CURVE = [[5.0, 18.0], [10.0, 20.0], [20.0, 21.0], [80.0, 22.0]]


def row(knob: str, seconds: float, psnr: float, curve: list[list[float]] | None = None, **more) -> dict:
    return {
        "knob": knob,
        "group": "iterations",
        "seconds": {"total": seconds},
        "gaussians": 100,
        "steps": 10,
        "heldout": {"psnr": psnr, "ssim": 0.5},
        "curve": curve or [[seconds, psnr]],
        "lines": {},
        "disturbed": 0.0,
        **more,
    }


def test_the_front_is_what_nothing_beats():
    rows = [
        row("slow, exact", 100, 25),
        row("quick, coarse", 10, 20),
        row("beaten", 50, 19),
        row("equal", 10, 20),
        row("middle", 40, 23),
        row("same time, worse", 40, 22.9),
    ]
    found, _ = points(rows)
    assert {p["knob"] for p in found if p["front"]} == {"slow, exact", "quick, coarse", "equal", "middle"}
    assert front_names(found)[-2:] == ["middle", "slow, exact"]


def test_medians_over_seeds_and_what_was_skipped():
    rows = [row("a", 10, 20), row("a", 12, 22), row("a", 30, 21), row("b", 1, 0, skipped="No such thing.")]
    found, target = points(rows)
    a, b = found
    assert (a["seconds"], a["psnr"], a["seeds"]) == (12, 21, 3) and a["psnr_spread"] == pytest.approx(0.8165, abs=1e-3)
    assert target == 20.5 and b["skipped"] and "front" not in b


def test_time_to_target_and_best_in_a_minute():
    one = row("a", 80, 22, CURVE)
    assert time_to(one, 19.0) == pytest.approx(7.5) and time_to(one, 20.0) == 10.0
    assert time_to(one, 17.0) == 5.0 and time_to(one, 22.5) is None
    assert best_within(one, 60.0) == 21.0 and best_within(one, 4.0) is None
    found, _ = points([one, row("a", 80, 21.4, [[70.0, 21.4]])], target=21.5)
    assert found[0]["time_to_target"] is None and found[0]["best_in_60"] is None, "not every seed got there"


def test_line_width_error_in_percent():
    views = [
        {"heldout": True, "true": 10.0, "rendered": 11.0},
        {"heldout": True, "true": 20.0, "rendered": 19.0},
        {"heldout": False, "true": 10.0, "rendered": 30.0},
    ]
    assert line_error({"lines": {"red": {"views": views}}}) == pytest.approx(7.5)
    assert line_error({"lines": {}}) is None


def test_every_knob_of_the_table_has_a_name_of_its_own():
    names = [knob.name for knob in knobs(False)]
    assert len(names) == len(set(names)) > 35
    assert {knob.group for knob in knobs(False)} == set(GROUPS)
    assert [knob.label for knob in knobs(False, ["harmonics"])] == ["balanced", "SH 0", "SH 2", "SH 3"]


def test_chart_and_csv_hold_every_point(tmp_path: Path):
    rows = [row(f"knob {i}", 5.0 * 1.3**i, 20 + (i * 7 % 5) + 0.3 * i) for i in range(14)]
    found, target = points([*rows, row("gone", 1, 1, skipped="why")])
    draw(found, target, "set", tmp_path / "a.svg", tmp_path / "a.png")
    svg = (tmp_path / "a.svg").read_text("utf-8")
    assert all(f">knob {i}<" in svg for i in range(14)) and "gone" not in svg
    with Image.open(tmp_path / "a.png") as picture:
        assert picture.width == pytest.approx(1600, abs=2)
    read = list(csv.DictReader(io.StringIO(table(found))))
    assert [line["knob"] for line in read] == [p["knob"] for p in found]
    assert float(read[3]["seconds"]) == pytest.approx(found[3]["seconds"], abs=1e-3) and read[-1]["skipped"] == "why"
