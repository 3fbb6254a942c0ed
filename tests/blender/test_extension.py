"""The extension is built and validated by Blender's own tool, and installs offline."""

from __future__ import annotations

import os
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import pytest

pytest.importorskip("bpy")

import dgs
from dgs.core.version import VERSION

ROOT = Path(dgs.__path__[0])

_INSTALL = """
import sys
import bpy
bpy.ops.extensions.package_install_files(filepath=sys.argv[1], repo="user_default", enable_on_install=True)
name = "bl_ext.user_default.dgs"
assert name in bpy.context.preferences.addons, list(bpy.context.preferences.addons.keys())
assert bpy.context.preferences.addons[name].preferences.python == "", "the add-on has no preferences"
assert not bpy.app.online_access
from pathlib import Path
for bundled in ("plyfile.py", "filelock/__init__.py"):
    assert list(Path(sys.argv[3]).rglob(f"site-packages/{bundled}")), f"the bundled {bundled} was not installed"
assert bpy.ops.dgs.import_twin(filepath=sys.argv[2]) == {"FINISHED"}
assert len(bpy.data.objects["twin"].data.vertices) == 9
bpy.ops.preferences.addon_disable(module=name)
assert name not in bpy.context.preferences.addons
print("installed")
"""


@pytest.fixture(scope="module")
def package() -> Path:
    done = subprocess.run([sys.executable, "-m", "tools.extension"], cwd=ROOT, capture_output=True, text=True)
    assert done.returncode == 0, done.stdout + done.stderr
    return ROOT / "dist" / f"dgs-{VERSION}.zip"


def test_the_zip_holds_what_blender_needs_and_no_more(package: Path) -> None:
    names = zipfile.ZipFile(package).namelist()
    for needed in (
        "__init__.py",
        "blender_manifest.toml",
        "run_dgs.py",
        "core/formats/ply.py",
        "panels/twin.py",
        "dgs_addon/engine/requirements.txt",
    ):
        assert needed in names
    for name in names:
        assert not name.startswith(("tests/", ".", "benchmarks/", "docs/", "tools/")) and "__pycache__" not in name
    assert package.stat().st_size < 5_000_000


def test_one_version_everywhere() -> None:
    manifest = tomllib.loads((ROOT / "blender_manifest.toml").read_text(encoding="utf-8"))
    assert manifest["version"] == VERSION


def test_installs_offline_and_imports_a_twin(package: Path, cloud: object, tmp_path: Path) -> None:
    from dgs.core.formats.ply import write_ply

    write_ply(tmp_path / "twin.ply", cloud)
    (tmp_path / "resources").mkdir()
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(tmp_path / "resources")}
    done = subprocess.run(
        [sys.executable, "-c", _INSTALL, str(package), str(tmp_path / "twin.ply"), str(tmp_path / "resources")],
        env=environment,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert done.returncode == 0 and "installed" in done.stdout, done.stdout + done.stderr
