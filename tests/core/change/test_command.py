"""The command: its four files, twins whose worlds differ, and what it refuses."""

from __future__ import annotations

import csv
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.command_line import run
from dgs.core.change.alignment import SAME
from dgs.core.change.motion import rotation_of
from dgs.core.evaluation.poses import Similarity
from dgs.core.formats.gltf_file import open_gltf
from PIL import Image

from .scene import AWAY, KNOB, PX, Scene, write_scene


def test_twins_in_two_worlds_are_aligned_and_everything_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The second twin's world is turned, 40 times as large, and elsewhere; its photos are from other places."""
    world = Similarity(40.0, rotation_of(np.array([0.5, 2.0, -1.0])), np.array([100.0, -30.0, 7.0]), 3)
    first = write_scene(tmp_path / "a", Scene())
    second = write_scene(tmp_path / "b", Scene(seed=1, knob=False), world, shift=0.02)
    out = tmp_path / "out"
    measures = tmp_path / "points.json"
    measures.write_text(json.dumps(wall_in(world)))
    words = ["change", str(first), str(second), "--out", str(out), "--threads", "1"]
    words += ["--measures-after", str(measures), "--scale", "wall=180mm+-2mm"]
    assert run(words) == 0
    said = capsys.readouterr().out
    assert "1 vanished" in said and "Lengths are mm, for 'wall' is 180 +- 2 mm" in said
    content = json.loads((out / "change.json").read_text())
    assert content["alignment"]["how"] == "matched photos" and content["alignment"]["matches"] >= 40
    assert np.isclose(content["alignment"]["scale"], 1 / 40.0, rtol=0.01)
    (knob,) = (region for region in content["regions"] if region["kind"] == "vanished")
    assert np.allclose(knob["centre"][:2], KNOB, atol=0.08) and knob["unit"] == "mm"
    assert knob["low"] < 8 * 100 * PX < knob["high"] and np.isclose(knob["value"], 8 * 100 * PX, rtol=0.2)
    assert np.isclose(content["scale"]["size"], 100.0, rtol=0.01), "mm for a unit of the first world"
    assert content["colours"]["vanished"] == [214, 39, 40] and len(content["colours"]["moved"]["bar"]) == 9
    rows = list(csv.DictReader((out / "change.csv").read_text().splitlines()))
    assert len(rows) == len(content["regions"]) and float(rows[0]["x"]) == content["regions"][0]["centre"][0]
    with Image.open(out / "change.png") as picture:
        assert picture.width > 900
    ((part, _),) = open_gltf(out / "change.glb").placed_meshes()
    assert "COLOR_0" in part["primitives"][0]["attributes"]
    (out / "change.csv").write_text("mine")
    assert run(words) == 2
    assert "was not written by this program" in capsys.readouterr().err
    assert (out / "change.csv").read_text() == "mine"


def wall_in(world: Similarity) -> dict[str, Any]:
    """A length of 1.8 on the wall, between positions in a twin's world."""
    ends = world.points(np.array([[-0.9, -0.7, AWAY], [0.9, -0.7, AWAY]])).tolist()
    places = {name: {"position": end} for name, end in zip("ab", ends, strict=True)}
    return {"places": places, "measures": [{"name": "wall", "kind": "length", "of": ["a", "b"]}]}


@pytest.mark.parametrize(
    ("more", "why"),
    [
        (["--scale", "wall=180mm"], "--measures FILE"),
        (["--measures", "points.json"], "no known length"),
        (["--measures", "points.json", "--scale", "door=2m"], "'door' is no length"),
        (["--measures", "points.json", "--scale", "wall=180mm+-2cm"], "is no known length"),
        (["--measures", "nowhere.json", "--scale", "wall=180mm"], "nowhere.json"),
    ],
)
def test_a_scale_that_says_nothing_is_refused_before_anything_is_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, more: list[str], why: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("points.json").write_text(json.dumps(wall_in(SAME)))
    assert run(["change", str(tmp_path), str(tmp_path), "--out", "out", *more]) == 2
    assert why in capsys.readouterr().err and not Path("out").exists()


def test_a_folder_that_is_none_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["change", str(tmp_path / "no"), str(tmp_path), "--out", str(tmp_path / "out")]) == 2
    assert "There is no folder" in capsys.readouterr().err and not (tmp_path / "out").exists()
