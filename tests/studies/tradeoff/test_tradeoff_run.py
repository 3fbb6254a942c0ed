"""The whole measurement on a small wall: rows that are taken up again, table, chart and page."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from dgs.command_line import run
from dgs.core.errors import Cancelled, DgsError
from dgs.core.progress import Silent
from dgs.studies.tradeoff.runs import measure_tradeoff
from dgs.studies.tradeoff.settings import TradeoffSettings


@pytest.fixture(scope="module")
def measured(rendered_set: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("tradeoff")
    words = [
        "tradeoff",
        str(rendered_set),
        "--out",
        str(out),
        "--cameras",
        "known",
        "--quick",
        "--threads",
        "1",
        "--progress",
        "none",
    ]
    assert run([*words, "--only", "iterations", "--only", "blur", "--only", "float width", "--only", "effects"]) == 0
    return out


def test_every_point_has_figures(measured: Path):
    content = json.loads((measured / "tradeoff.json").read_text("utf-8"))
    points = {point["knob"]: point for point in content["points"]}
    assert list(points) == ["balanced", "30 steps", "Fourier", "splats", "16-bit twin", "without the blur"]
    assert not any(point["skipped"] for point in points.values())
    assert points["30 steps"]["steps"] == 30 and points["balanced"]["steps"] == 60
    assert all(point["psnr"] > 10 and point["seconds"] > 0 for point in points.values())
    assert any(point["front"] for point in points.values())
    assert all(point["line_error"] is not None for point in points.values()), "the wall has a painted line"
    # What must be nearly the same, and what must not be.
    assert points["Fourier"]["psnr"] == pytest.approx(points["balanced"]["psnr"], abs=0.3)
    assert points["16-bit twin"]["psnr"] == pytest.approx(points["balanced"]["psnr"], abs=0.2)
    assert abs(points["splats"]["psnr"] - points["balanced"]["psnr"]) > 1e-3


def test_accuracy_rises_over_time_and_ends_at_the_figure(measured: Path):
    rows = json.loads((measured / "tradeoff.json").read_text("utf-8"))["rows"]
    for row in rows:
        times = [seconds for seconds, _ in row["curve"]]
        assert times == sorted(times) and len(times) >= 4
        assert row["curve"][-1] == [row["seconds"]["total"], row["heldout"]["psnr"]]
        assert row["curve"][0][1] < row["curve"][-1][1]


def test_the_page_needs_no_other_file_and_says_what_it_is(measured: Path):
    page = (measured / "tradeoff.html").read_text("utf-8")
    assert "<svg" in page and "<?xml" not in page and "16-bit twin" in page and "--quick" in page
    assert "src=" not in page and "@import" not in page and (measured / "tradeoff.png").stat().st_size > 10_000


def test_rows_are_taken_up_again(measured: Path, rendered_set: Path):
    files = {file: file.stat().st_mtime_ns for file in (measured / "rows").iterdir()}
    one = min(files)
    one.unlink()
    settings = TradeoffSettings(
        rendered_set,
        measured,
        cameras="known",
        seeds=1,
        quick=True,
        resume=True,
        threads=1,
        only=("iterations", "blur", "float width", "effects"),
    )
    measure_tradeoff(settings, Silent())
    assert one.is_file()
    assert all(file.stat().st_mtime_ns == before for file, before in files.items() if file != one)

    class Stops(Silent):
        def cancelled(self) -> bool:
            return True

    one.unlink()
    with pytest.raises(Cancelled, match="Stopped"):
        measure_tradeoff(settings, Stops())


def test_unknown_knobs_are_named(rendered_set: Path, tmp_path: Path):
    with pytest.raises(DgsError, match="'colour'.*harmonics"):
        measure_tradeoff(TradeoffSettings(rendered_set, tmp_path, only=("colour",)), Silent())
