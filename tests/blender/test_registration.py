"""The add-on goes in and out of Blender without traces, as often as wanted."""

from __future__ import annotations

import subprocess
import sys

import pytest

bpy = pytest.importorskip("bpy")

import dgs  # noqa: E402
from dgs import operators, panels  # noqa: E402


def test_register_twice_unregister_twice_and_again() -> None:
    for _ in range(2):
        dgs.register()
        dgs.register()
        for kind in operators.CLASSES + panels.CLASSES:
            assert kind.is_registered
        dgs.unregister()
        dgs.unregister()
        for kind in operators.CLASSES + panels.CLASSES:
            assert not kind.is_registered


def test_importing_the_package_needs_no_blender() -> None:
    code = (
        "import sys; sys.modules['bpy'] = None; import run_dgs;"
        "run_dgs.mount_package(); import dgs.dgs_addon, dgs.dgs_addon.axes, dgs.dgs_addon.scene.save_blend"
    )
    subprocess.run([sys.executable, "-c", code], cwd=dgs.__path__[0], check=True)
