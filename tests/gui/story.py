"""Runs inside Blender with a window: from an empty scene to a rendered twin, pressing the panel's buttons.

    blender --python story.py -- FOLDER

FOLDER/photos is the set; FOLDER/pictures gets the screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import json
import sys
import time
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).parent))
from robot import Robot, Story

FOLDER = Path(sys.argv[sys.argv.index("--") + 1])
ADDON = "bl_ext.user_default.dgs"
seen: dict[str, object] = {"blender": bpy.app.version_string}


def story(robot: Robot) -> Story:
    """The whole way."""
    from importlib import import_module

    runner = import_module(f"{ADDON}.dgs_addon.job.runner")
    yield from robot.open_tab("Descatter")
    yield from robot.picture("1-empty")
    bpy.ops.dgs.choose_photos(directory=str(FOLDER / "photos"))
    settings = bpy.context.scene.dgs
    settings.medium, settings.sigma, settings.preset = "gaussian", 1.5, "draft"
    yield 2.0
    yield from robot.picture("2-photos")
    yield from robot.press("dgs.optimize")
    robot.measure()
    yield from _until(lambda: runner.running(), 10)
    yield from _until(lambda: len(runner.current().state.marks) > 10, 120)
    yield from robot.picture("3-optimizing")
    yield from _until(lambda: not runner.running(), 300)
    job = runner.current()
    gaps = sorted(robot.gaps)
    seen.update(
        phase=job.state.phase, error=job.state.error, worst_gap=gaps[-1], usual_gap=gaps[int(0.99 * len(gaps))],
        ticks=len(gaps), seconds=job.state.seconds(),
    )  # fmt: skip
    yield 3.0
    seen["objects"] = sorted(thing.type for thing in bpy.context.scene.objects)
    yield from robot.picture("4-twin")
    bpy.context.scene.cycles.samples = bpy.context.scene.cycles.preview_samples = 1
    yield from robot.press("dgs.view_twin")
    yield 8.0
    yield from robot.picture("5-view")
    yield from robot.press("dgs.view_twin")
    yield from robot.press("dgs.render_twin")
    seen["clicks"] = robot.clicks
    rendered: list[object] = []
    bpy.app.handlers.render_complete.append(lambda *_: rendered.append(1))
    yield from _until(lambda: rendered, 120)
    yield 1.0
    yield from robot.picture("6-rendered")
    seen["rendered"] = True


def _until(true: object, seconds: float) -> Story:
    end = time.monotonic() + seconds
    while not true():  # type: ignore[operator]
        if time.monotonic() > end:
            raise TimeoutError(f"not in {seconds} s")
        yield 0.1


def _done(error: str) -> None:
    seen["failure"] = error
    (FOLDER / "story.json").write_text(json.dumps(seen), encoding="utf-8")


bpy.context.preferences.view.show_splash = False
(FOLDER / "pictures").mkdir(exist_ok=True)
robot = Robot(FOLDER / "pictures")
robot.tell(story(robot), _done)
