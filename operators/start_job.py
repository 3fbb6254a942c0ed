"""What the operators that start the engine have in common."""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import bpy

from ..core.errors import DgsError
from ..dgs_addon.engine.interpreter import find_python, why_not
from ..dgs_addon.job import runner
from ..dgs_addon.job.request import Request
from ..dgs_addon.paths import chosen_photos


def why_no_job(scene: Any) -> str:
    """Why no job can be started now; '' if one can."""
    if runner.running():
        return "A job is running: wait for it or cancel it"
    found = chosen_photos(scene.dgs)
    if found is None:
        return "Choose the folder of photos first (step 1)"
    return found.problem or why_not()


def start_job(operator: Any, context: Any, make: Callable[[], Request], needs_engine: bool = True) -> set[str]:
    """Starts what `make` asks for; without a window it is waited for."""
    try:
        job = runner.start(make(), find_python() if needs_engine else Path(sys.executable), context.scene)
    except DgsError as error:
        operator.report({"ERROR"}, str(error))
        return {"CANCELLED"}
    if not bpy.app.background:
        return {"FINISHED"}
    runner.wait()
    if job.state.phase != "done":
        operator.report({"ERROR"}, job.state.error or "Cancelled; what was done is kept.")
        return {"CANCELLED"}
    return {"FINISHED"}
