"""The panel's choice of effects is the registry's: a new effect is in it, and goes to the engine as it is."""

from __future__ import annotations

import subprocess
import sys

import pytest

pytest.importorskip("bpy")

import dgs

#: In a process of its own: the add-on reads the registry when it is loaded.
CODE = """
import run_dgs
run_dgs.mount_package()
import bpy
from dgs.core.effects import registry
from dgs.tests.core.effects import toy
registry.EFFECTS = (*registry.EFFECTS, toy.SPEC)
import dgs
dgs.register()
settings = bpy.context.scene.dgs
items = settings.bl_rna.properties["effects"].enum_items
print(",".join(items.keys()), "|", items["dust"].name, "|", items["dust"].description)
settings.effects = "dust"
from pathlib import Path
from dgs.dgs_addon.job.options import job_arguments
from dgs.dgs_addon.job.request import _effort
print(" ".join(job_arguments("reconstruct", Path("/p"), Path("/o"), _effort(settings))))
dgs.unregister()
"""


def test_a_new_effect_is_offered_and_asked_for() -> None:
    run = subprocess.run([sys.executable, "-c", CODE], cwd=dgs.__path__[0], capture_output=True, text=True, check=True)
    offered, arguments = [line for line in run.stdout.splitlines() if line.strip()][-2:]
    names = "none,auto,all,usual,haze,glass,defocus,field_blur,kernels,motion,vignetting,exposure,saturation,dust"
    assert offered == f"{names} | Dust | Grains on the lens that take a share of all light"
    assert "--effects dust" in arguments
