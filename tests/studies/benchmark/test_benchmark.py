"""The benchmark: the real product on tiny rendered sets, and a page that says what the rows say."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import pytest
from dgs.studies.benchmark import page as pages
from dgs.studies.benchmark.runs import Bench, figures, kept
from dgs.studies.benchmark.scenes import CHECKED, CHOSEN, SCENES, PhotoSet, RenderedSet

ROOT = Path(__file__).resolve().parents[3]


def row(scene, effort="balanced", psnr=30.0, worst=28.0, **more):
    return {
        "scene": scene,
        "effort": effort,
        "failed": "",
        "photos": 48,
        "registered": 47,
        "size": [400, 300],
        "psnr": psnr,
        "ssim": 0.9,
        "worst": {"name": "view_008.png", "psnr": worst},
        "views": {"view_000.png": 2 * psnr - worst, "view_008.png": worst},
        "seconds": 40.4,
        "gaussians": 20000,
        "sh_degree": 1,
        "steps": 1000,
        "peak_memory_mb": 900.0,
        "others": 0.3,
        "level": "good",
        "verdict": "It is good.",
        "explained": [97.5, None],
        "status": "done",
        "engine": "a",
        **more,
    }


def content(rows, efforts=("draft", "balanced")):
    facts = {"processor": "P", "cores": 2, "device": "cpu"}
    return {"quick": False, "machine": facts, "efforts": efforts, "missing": [], "pictures": [], "rows": rows}


def test_scenes_are_of_all_kinds_and_split_once():
    names = [scene.name for scene in SCENES]
    assert len(names) == len(set(names)) >= 10
    of = {scene.kind for scene in CHECKED}
    assert of >= {"object on white", "transparent", "all-round indoor", "forward-facing", "drone"}
    assert {scene.part for scene in CHECKED} == {"checked on"} and {scene.part for scene in CHOSEN} == {"chosen on"}
    for found in ("given", "found"):
        assert any(scene.cameras == found for scene in CHECKED)
    for kind in of:
        media = {s.source.psf for s in CHECKED if s.kind == kind and isinstance(s.source, RenderedSet)}
        assert media == {"none", "gaussian:3"}, kind
    folders = {s.source.folder for s in CHOSEN if isinstance(s.source, PhotoSet)}
    assert folders.isdisjoint(s.source.folder for s in CHECKED if isinstance(s.source, PhotoSet))


def test_a_quick_run_makes_sets_rows_and_page_and_takes_them_up_again(tmp_path: Path):
    """As `make benchmark ARGS=--quick` starts it."""
    out = tmp_path / "quick"
    command = [sys.executable, "-m", "studies.benchmark", "--quick", "--threads", "1", "--out", str(out)]
    first = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert first.returncode == 0, first.stdout + first.stderr
    rows = {found["scene"]: found for found in json.loads((out / "benchmark.json").read_text("utf-8"))["rows"]}
    assert set(rows) == {"plant", "orrery-blurred"}
    assert all(found["failed"] == "" and found["psnr"] > 12 for found in rows.values())
    assert all(found["registered"] == found["photos"] == 10 and len(found["views"]) == 2 for found in rows.values())
    text = (out / "benchmark.md").read_text("utf-8")
    assert "not results" in text and "| plant | object on white | 10 of 96 x 72 | sharp | given |" in text
    assert (out / "images" / "benchmark" / "plant.jpg").stat().st_size > 1000
    stamp = (out / "rows" / "plant_draft.json").stat().st_mtime_ns
    again = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert again.returncode == 0, again.stdout + again.stderr
    assert (out / "rows" / "plant_draft.json").stat().st_mtime_ns == stamp


def test_the_table_has_mean_worst_and_seconds():
    rows = {(found["scene"], found["effort"]): found for found in [row("plant"), row("room-found", worst=25.0)]}
    lines = pages.table([s for s in SCENES if s.name in ("plant", "room-found")], rows, ["balanced"])
    assert "| plant | object on white | 48 of 400 x 300 | sharp | given | 30.00 (28.0) in 40 s | - |" in lines
    assert (
        "| room-found | all-round indoor | 48 of 400 x 300 | sharp | found: 47 | 30.00 (**25.0**) in 40 s | - |"
        in lines
    )
    assert pages.cell(None) == "-" and pages.cell({"failed": "no cameras"}) == "**failed**"


def test_parts_stand_apart_and_failures_and_hands_words_stay():
    rows = [row("plant"), {**row("lego"), "failed": "It broke"}, row("copr", psnr=28.4)]
    text = pages.page(content(rows), SCENES, "## What is bad\n")
    checked, _, chosen = text.partition("## Chosen on")
    assert "| plant |" in checked and "| lego |" not in checked and "| copr |" in chosen and "**failed**" in chosen
    assert "| good | 97.5 %, - |" in text
    assert "failed: It broke" in text and "35.4 to 35.8" in chosen
    assert pages.kept_by_hand(text) == "## What is bad\n"
    assert pages.kept_by_hand(pages.page(content(rows), SCENES, pages.kept_by_hand(text))) == "## What is bad\n"


@pytest.mark.parametrize(
    ("psnrs", "last", "words"),
    [
        ([30.0, 30.5, 31.0], "time limit", "rises"),
        ([30.0, 30.5, 30.3], "time limit", "falls"),
        ([30.0, 30.5, 30.51], "time limit", "nothing gained"),
        ([30.0, 30.5, 30.51], "plateau", "rises, or ended"),
    ],
)
def test_doublings_that_gain_nothing_are_said(psnrs, last, words):
    limits = ["1 min", "2 min", "4 min"]
    states = ["time limit", "time limit", last]
    rows = [row("plant", e, p, status=s) for e, p, s in zip(limits, psnrs, states, strict=True)]
    assert words in pages.rises(rows)
    assert "| plant |" in pages.page(content(rows, limits), SCENES)


def test_a_preset_that_a_quicker_run_beats_is_named_on_the_views_that_both_scored():
    """The limit's own mean is lower: it has scored the hard view alone."""
    hard, both = {"a": 28.0}, {"a": 27.8, "b": 36.0}
    rows = [
        row("plant", "draft", 27.0, seconds=10.0, views={"a": 25.0, "b": 29.0}),
        row("plant", "0.5 min", 28.0, seconds=30.0, views=hard),
        row("plant", "fine", 31.9, seconds=50.0, views=both),
    ]
    scored = pages.on_common_views(rows[::-1])
    assert [(found["effort"], psnr) for found, psnr in scored] == [("draft", 25.0), ("0.5 min", 28.0), ("fine", 27.8)]
    assert pages.beaten(scored) == ["fine (0.5 min: +0.20 dB)"]
    text = pages.page(content(rows, ["draft", "fine", "0.5 min"]), SCENES)
    assert "| plant | draft 10 s 25.00; 0.5 min 30 s 28.00; fine 50 s 27.80 | fine (0.5 min: +0.20 dB) |" in text


def test_figures_take_the_sharp_truth_where_there_is_one():
    view = {"degraded": {"psnr": 40.0, "ssim": 1.0}, "sharp": {"psnr": 30.0, "ssim": 0.9}}
    report = {
        "heldout": {
            "names": ["a", "b"],
            "views": [{"name": "a", **view}, {"name": "b", **view, "sharp": {"psnr": 26.0, "ssim": 0.8}}],
            "sharp": {"psnr": 28.0, "ssim": 0.85},
            "degraded": {"psnr": 40.0, "ssim": 1.0, "psnr_halves": None},
        },
        "photos": {"given": 10, "registered": 9, "size": [4, 3]},
        "verdict": {"level": "good", "sentence": "Good.", "views": [], "unseen": 0.021, "fitted": None},
        "status": "done",
        "seconds": {"total": 10.0, "train": 5.0},
        "gaussians": 5,
        "steps": 6,
        "peak_memory_mb": 7.0,
        "settings": {"training": {"sh_degree": 1}},
        "machine": {"processor": "P", "cores": 2, "threads": 2, "device": "cpu"},
    }
    found = figures(report)
    assert found["explained"] == [97.9, None]
    assert found["psnr"] == 28.0 and found["worst"] == {"name": "b", "psnr": 26.0}
    for one in report["heldout"]["views"]:
        one["sharp"] = None
    report["heldout"]["sharp"] = {"psnr": None, "ssim": None}
    assert figures(report)["psnr"] == 40.0


def test_rows_of_the_page_stay_where_a_clone_has_no_runs(tmp_path: Path):
    (tmp_path / "rows").mkdir()
    (tmp_path / "rows" / "tea_draft.json").write_text(json.dumps(row("tea", "draft", psnr=31.0)))
    published = [row("tea", "draft", psnr=30.0), row("tea", "best", psnr=32.0), row("lego", "draft", psnr=33.0)]
    found = Bench(tmp_path).rows(["lego", "tea"], published)
    assert [(r["scene"], r["effort"], r["psnr"]) for r in found] == [
        ("lego", "draft", 33.0),
        ("tea", "draft", 31.0),
        ("tea", "best", 32.0),
    ]
    assert [r["psnr"] for r in Bench(tmp_path).rows(["tea"])] == [31.0]


def test_a_row_of_other_words_or_cut_off_is_not_taken(tmp_path: Path):
    file = tmp_path / "row.json"
    assert kept(file, "a") is None
    file.write_text('{"key": "a"}')
    assert kept(file, "a") == {"key": "a"} and kept(file, "b") is None
    file.write_text('{"key": "a"')
    assert kept(file, "a") is None
