"""A run keeps to its time, ends when it is good enough, and its report says what had been predicted."""

from __future__ import annotations

import json
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest
from dgs.command_line import run
from dgs.command_line.arguments import quality
from dgs.command_line.progress_bars import curve
from dgs.core.effort import plan
from dgs.core.effort.clock import OthersLoad, process_began
from dgs.core.effort.described import RunDescription
from dgs.core.effort.timing import RunTiming
from dgs.core.errors import DgsError
from dgs.core.pipeline.reconstruct import FinishedRun, reconstruct
from dgs.core.progress import Silent
from dgs.core.report.schema import problems
from dgs.core.run_settings import ReconstructSettings
from dgs.tests.command_line.scene import SIGMA, write_scene

PSF = f"gaussian:{SIGMA}"


@pytest.fixture(scope="module")
def scene(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("set")
    write_scene(folder)
    return folder


@pytest.fixture(scope="module", autouse=True)
def own_cache(tmp_path_factory) -> Path:
    """Records of other runs would calibrate these. Compiled kernels stay where they are."""
    from dgs.core.effort import records

    folder, before = tmp_path_factory.mktemp("cache"), records.cache_base
    records.cache_base = lambda: folder
    yield folder
    records.cache_base = before


def settings(scene: Path, out: Path, **changes) -> ReconstructSettings:
    return ReconstructSettings(
        photos=scene / "photos",
        out=out,
        psf=PSF,
        cameras=scene / "model",
        threads=1,
        max_gaussians=1500,
        holdout_every=4,
        **changes,
    )


def reconstructed(asked: ReconstructSettings, began: float | None = None) -> FinishedRun:
    """As the command does it."""
    run = asked.split()
    return reconstruct(run, Silent(), began, partial(RunTiming, RunDescription.of(run)))


def test_time_that_helps_nobody_is_not_used(scene, tmp_path, monkeypatch):
    few = replace(plan.PLANNING, useful_steps=30, useful_visits=1, longest_steps=40)
    monkeypatch.setattr(plan, "PLANNING", few)
    began = time.perf_counter()
    report = reconstructed(settings(scene, tmp_path, time_limit=300.0), began).report
    assert time.perf_counter() - began < 60.0
    assert report["predicted"]["enough"] is True
    assert any("more than the longest training" in note for note in report["notes"])


def test_the_time_is_kept_and_all_of_it_is_used(scene, tmp_path, monkeypatch):
    limit = 14.0
    monkeypatch.setattr(plan, "PLANNING", replace(plan.PLANNING, useful_steps=10**6))
    began = time.perf_counter()
    outcome = reconstructed(settings(scene, tmp_path, time_limit=limit), began)
    taken = time.perf_counter() - began
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert problems(report) == [] and report["status"] == "time limit"
    assert limit - 6.0 < taken < limit + 3.0, report["seconds"]
    assert report["predicted"]["by"] == "plan" and report["predicted"]["seconds"] == limit
    assert report["gaussians"] <= 1500 and report["steps"] > 20
    assert (tmp_path / "report.html").stat().st_size > 1000 and not outcome.cancelled
    named = report["seconds"]
    parts = sum(value or 0.0 for name, value in named.items() if name != "total")
    assert parts == pytest.approx(named["total"], abs=0.5), "every second belongs to a stage"


def test_an_estimate_is_compared_with_what_it_took(scene, tmp_path, capsys, own_cache):
    words = [
        "estimate",
        str(scene / "photos"),
        "--psf",
        PSF,
        "--cameras",
        str(scene / "model"),
        "--threads",
        "1",
        "--max-gaussians",
        "1500",
        "--holdout-every",
        "4",
        "--progress",
        "none",
    ]
    assert run([*words, "--json"]) == 0
    answer = json.loads(capsys.readouterr().out)
    assert set(answer["presets"]) == {"draft", "balanced", "fine", "best"} and answer["photos"] == 9
    draft, fine = answer["presets"]["draft"], answer["presets"]["fine"]
    assert 0 < draft["seconds"]["low"] < draft["seconds"]["value"] < fine["seconds"]["value"]
    assert draft["psnr"] is None and not draft["seconds"]["calibrated"]
    assert run(words) == 0
    assert "not calibrated" in capsys.readouterr().out
    reconstructed(settings(scene, tmp_path, preset="draft"))
    report = json.loads((tmp_path / "report.json").read_text("utf-8"))
    assert report["predicted"]["by"] == "estimate" and report["predicted"]["seconds"] > 0
    assert "Predicted" in (tmp_path / "report.html").read_text("utf-8")
    assert run([*words, "--json"]) == 0
    again = json.loads(capsys.readouterr().out)
    known = again["presets"]["draft"]["psnr"]
    assert known is not None and known["value"] == pytest.approx(report["heldout"]["degraded"]["psnr"], abs=0.01)


def test_quality_ends_a_run_and_needs_photos_held_out(scene, tmp_path):
    report = reconstructed(settings(scene, tmp_path, until=14.0, preset="draft")).report
    assert report["status"] == "quality" and report["steps"] < 300
    with pytest.raises(DgsError, match="--holdout-every"):
        reconstructed(ReconstructSettings(scene / "photos", tmp_path, until=14.0, holdout_every=0))


def test_qualities_as_they_are_typed():
    assert (quality("plateau"), quality("28.5"), quality("30dB"), quality("30 dB")) == ("plateau", 28.5, 30.0, 30.0)
    for wrong in ("best", "-3", "0", "nan", "400"):
        with pytest.raises(Exception, match="neither"):
            quality(wrong)


def test_a_curve_for_terminals():
    assert curve([20.0, 21.0, 22.0, 23.0]) == "▁▃▆█" and curve([20.0]) == "▁"
    assert len(curve([float(i) for i in range(50)])) == 16


def test_the_process_began_before_now_and_others_take_a_share():
    assert process_began() < time.perf_counter()
    others = OthersLoad()
    until = time.perf_counter() + 0.3
    while time.perf_counter() < until:
        pass
    share = others.share()
    assert share is None or 0.0 <= share <= 1.0
