"""The engine is killed at random moments: Blender lives, says so, and little is lost (tools/kill_engine.py)."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("bpy")

import dgs

ROOT = Path(dgs.__path__[0])
from dgs.tests.command_line.scene import write_scene  # noqa: E402
from dgs.tools import kill_engine  # noqa: E402


@pytest.mark.timeout(1200)
def test_killed_at_random_moments(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(kill_engine, "LATEST", 2.0)
    monkeypatch.setattr(kill_engine, "LATEST_TRAINING", 2.0)
    monkeypatch.setattr(kill_engine, "PRESET", "balanced")
    monkeypatch.setattr(kill_engine, "GAUSSIANS", 300)
    dgs.register()
    try:
        write_scene(tmp_path / "set")
        kills, phase = kill_engine.kill_jobs(tmp_path / "set", tmp_path / "out", 3, seed=1)
    finally:
        dgs.unregister()
    assert phase == "done" and len(kills) == 3
    assert all(kill.alive for kill in kills)
    assert max(kill.lost for kill in kills) <= kill_engine.ALLOWED
