"""A folder of photos with their cameras is all that a run needs, in every command that takes photos."""

import json
import shutil
import subprocess
import sys
from pathlib import Path

import dgs
import pytest
from dgs.core.files import read_json
from dgs.tests.command_line.scene import write_scene

ROOT = Path(dgs.__file__).parent


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A COLMAP folder, with results beside it."""
    made = tmp_path_factory.mktemp("sets")
    write_scene(made / "scene")
    root = made / "a set"
    shutil.copytree(made / "scene" / "sharp", root / "images")
    shutil.copytree(made / "scene" / "model", root / "sparse" / "0")
    return root


def said(*arguments) -> str:
    command = [sys.executable, str(ROOT / "run_dgs.py"), *map(str, arguments), "--progress", "json"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300, encoding="utf-8")
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_reconstruct_takes_the_cameras_of_the_folder(folder):
    out = folder.parent / "twin"
    text = said("reconstruct", folder, "--out", out, "--preset", "draft", "--max-gaussians", 1500, "--sh-degree", 0)
    assert "Photos of 'images' with the cameras of 'sparse/0'" in text
    report = read_json(out / "report.json")
    assert report["cameras"]["source"] == "given"
    assert report["photos"]["registered"] == 9
    assert report["heldout"]["degraded"]["psnr"] > 22.0


def test_estimate_and_inspect_take_it(folder):
    found = json.loads(said("estimate", folder, "--json").splitlines()[-1])
    assert found["photos"] == 9
    seen = said("inspect", folder, "--json")
    assert '"cameras": true' in seen
