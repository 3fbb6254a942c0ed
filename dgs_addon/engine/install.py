"""Installs the engine into a folder of its own, and checks it; both beside the window."""

from __future__ import annotations

import sys
from pathlib import Path

import bpy

from .errand import Errand, ErrandStep
from .folder import REQUIREMENTS, engine_folder, python_in, stamp
from .process import RUN

#: Seconds between two redraws of the preferences.
_TICK = 0.25

_errand: Errand | None = None


def errand() -> Errand | None:
    """What runs now or ran last: an installation or a check."""
    return _errand


def busy() -> bool:
    """Whether an installation or a check runs."""
    return _errand is not None and _errand.running


def install_steps(
    folder: Path, requirements: Path, wheels: Path | None = None, base: str = sys.executable
) -> list[ErrandStep]:
    """How the engine gets into `folder`; whatever is there already is kept, so that it may be repeated.

    Args:
        folder: of the virtual environment.
        requirements: what to install.
        wheels: folder of wheels to install from instead of the network; None for the network.
        base: Python to make the environment with: Blender's own, of which nothing is changed.
    """
    source = ["--no-index", "--find-links", str(wheels)] if wheels is not None else []
    mark = stamp(folder, requirements)

    def finish() -> None:
        for old in folder.glob("installed-*"):
            old.unlink()
        mark.touch()

    python = str(python_in(folder))
    install = [
        python,
        "-m",
        "pip",
        "install",
        "--disable-pip-version-check",
        "--no-input",
        "--progress-bar",
        "off",
        *source,
        "-r",
        str(requirements),
    ]
    return [
        ErrandStep("Making an environment", [base, "-m", "venv", str(folder)]),
        ErrandStep("Installing the packages", install),
        ErrandStep("Finishing", finish),
    ]


def doctor_step(python: Path) -> ErrandStep:
    """The engine's own check: versions, device, and whether its parts agree."""
    return ErrandStep("Checking", [str(python), str(RUN), "doctor"])


def install_engine(wheels: Path | None) -> Errand:
    """Starts the installation into the extension's own folder, with a check at its end."""
    folder = engine_folder()
    assert folder is not None  # the operator's poll has made sure
    folder.parent.mkdir(parents=True, exist_ok=True)
    steps = [*install_steps(folder, REQUIREMENTS, wheels), doctor_step(python_in(folder))]
    return run(steps, folder.parent / "install.log")


def run(steps: list[ErrandStep], log: Path | None = None) -> Errand:
    """Starts an errand and keeps the preferences drawn while it runs."""
    global _errand
    _errand = Errand(steps, log)
    _errand.start()
    if not bpy.app.background and not bpy.app.timers.is_registered(_tick):
        bpy.app.timers.register(_tick, first_interval=_TICK, persistent=True)
    return _errand


def stop() -> None:
    """Ends what runs, as when the add-on is switched off."""
    global _errand
    if bpy.app.timers.is_registered(_tick):
        bpy.app.timers.unregister(_tick)
    if _errand is not None and _errand.running:
        _errand.cancel()
        _errand.join(5.0)
    _errand = None


def _tick() -> float | None:
    for window in bpy.context.window_manager.windows:
        for area in window.screen.areas:
            if area.type in ("PREFERENCES", "VIEW_3D"):
                area.tag_redraw()
    return _TICK if busy() else None
