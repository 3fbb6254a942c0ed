"""The wheel: built from the clone's files, it works in an environment of its own, away from the clone."""

import shutil
import subprocess
import sys
import sysconfig
import venv
import zipfile
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
BUILD = "import sys; from setuptools import build_meta; print(build_meta.build_wheel(sys.argv[1]))"
#: What belongs to the package; all else is the clone's.
FOLDERS = ("api", "command_line", "core", "dgs_addon", "operators", "panels", "studies")


def ran(*words, **options) -> str:
    done = subprocess.run([*map(str, words)], capture_output=True, text=True, check=False, **options)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def files() -> list[str]:
    listing = subprocess.run(
        ["git", "ls-files", "-co", "--exclude-standard", "-z"], cwd=ROOT, capture_output=True, check=False
    )
    if listing.returncode:
        pytest.skip("no git clone")
    return [name for name in listing.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


@pytest.fixture(scope="module")
def wheel(files, tmp_path_factory) -> Path:
    """Built from a copy: a build leaves folders behind."""
    clone, out = tmp_path_factory.mktemp("clone"), tmp_path_factory.mktemp("wheel")
    for name in files:
        if name.startswith(tuple(f"{folder}/" for folder in FOLDERS)) or "/" not in name:
            (clone / name).parent.mkdir(parents=True, exist_ok=True)
            shutil.copyfile(ROOT / name, clone / name)
    ran(sys.executable, "-c", BUILD, out, cwd=clone)
    return next(out.glob("*.whl"))


@pytest.fixture(scope="module")
def python(wheel, tmp_path_factory) -> Path:
    """A fresh environment with the wheel; the large packages are those that are here, through a path file."""
    folder = tmp_path_factory.mktemp("environment")
    venv.create(folder, with_pip=False)
    found = folder / "bin" / "python"
    own = Path(ran(found, "-c", "import sysconfig; print(sysconfig.get_path('purelib'))").strip())
    (own / "engine.pth").write_text(sysconfig.get_path("purelib") + "\n")
    ran(sys.executable, "-m", "pip", "--python", found, "install", "-q", "--no-deps", "--no-index", wheel)
    return found


def test_the_wheel_holds_every_file_of_the_packages(files, wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    wanted = {f"dgs/{name}" for name in files if name.split("/")[0] in FOLDERS and "/" in name}
    assert wanted | {"dgs/__init__.py", "dgs/run_dgs.py"} <= names
    assert not [name for name in names if "/tests/" in name or "/tools/" in name]
    assert wheel.stat().st_size < 5e6


def test_the_command_works_in_a_fresh_environment(python, tmp_path):
    command = python.with_name("dgs")
    assert ran(command, "--version", cwd=tmp_path).startswith("dgs ")
    assert "usage: dgs" in ran(command, "reconstruct", "--help", cwd=tmp_path)
    refused = subprocess.run(
        [command, "reconstruct", "nowhere", "--out", "x"], cwd=tmp_path, capture_output=True, text=True, check=False
    )
    assert refused.returncode == 2 and "nowhere" in refused.stderr and "Traceback" not in refused.stderr


def test_the_api_works_in_a_fresh_environment(python, tmp_path):
    code = """
import dgs, numpy as np
from dgs.api import Twin, measure_psf
from dgs.core.cloud import GaussianCloud
one = np.ones((1, 3), np.float32)
Twin(GaussianCloud(one, -2 * one, np.float32([[1, 0, 0, 0]]), np.float32([3.0]), one[:, None])).save("twin.spz")
assert len(Twin.open("twin.spz")) == 1
y, x = np.mgrid[:49, :49] - 24.0
assert abs(measure_psf(0.9 * np.exp(-0.5 * (x**2 + y**2) / 9), linear=False).sigma - 3) < 0.05
print(dgs.__file__)
"""
    where = Path(ran(python, "-c", code, cwd=tmp_path).strip())
    assert where.is_relative_to(python.parents[1])
