"""Runs inside Blender with a window: from an empty scene to a rendered twin, pressing the panel's buttons.

    blender --python story.py -- FOLDER

FOLDER/photos is the set; FOLDER/pictures gets the screenshots, FOLDER/story.json what was seen.
"""

from __future__ import annotations

import os
import random
import signal
import sys
import time
from pathlib import Path

import bpy
from bpy_extras.view3d_utils import location_3d_to_region_2d

sys.path.insert(0, str(Path(__file__).parent))  # Blender runs this file where no package is
from robot import Robot, Story, Tick
from stage import FOLDER, addon, in_german, play, seen, until

#: What Blender draws across a twin.
_ACROSS = ("relationship_lines", "floor", "axis_x", "axis_y")


def story(robot: Robot) -> Story:
    """The whole way."""
    yield from robot.open_tab("Descatter")
    yield from robot.picture("1-empty")
    yield from _photos_are_dropped(robot)
    yield from _a_twin_is_made(robot)
    yield from _it_is_viewed_and_rendered(robot)
    yield from _ended_early(robot)
    yield from _exact_view(robot)
    yield from _files(robot)
    yield from in_german(robot, "german", _in_words)
    yield from _test_set()
    yield from _another_file(robot)
    bpy.ops.dgs.open_preferences()
    yield 2.0
    yield from robot.picture("9-preferences")


def _photos_are_dropped(robot: Robot) -> Story:
    """One photo of the folder is dropped; then the panel is drawn as often as a job has it drawn, for comparison."""
    settings, redraw = bpy.context.scene.dgs, addon("dgs_addon.window").redraw
    _drop(robot, sorted((FOLDER / "photos").iterdir())[0])
    yield 1.0
    if not settings.photos:  # Blender has a use of its own for pictures, and asks
        yield from robot.picture("drop-menu", out_of_the_way=False)
        robot.key("c")  # Choose Photos
        yield 1.0
    seen["dropped"] = settings.photos
    settings.medium, settings.sigma, settings.preset = "gaussian", 1.5, "draft"
    settings.effects = "usual"  # (trials would double these minutes)
    redraw()  # a script has set them, which Blender does not show by itself
    yield 2.0
    yield from robot.picture("2-photos")
    robot.measure()
    for _ in range(12):
        redraw()
        yield addon("dgs_addon.job.job").REDRAW
    seen["idle"] = _figures(robot.ticks)


def _a_twin_is_made(robot: Robot) -> Story:
    runner = addon("dgs_addon.job.runner")
    yield from robot.press("dgs.optimize")
    first = robot.clicked
    yield from until(lambda: runner.running(), 60)
    yield from until(lambda: len(runner.current().state.marks) > 10, 500)
    addon("dgs_addon.job.pictures").refresh(runner.current())
    addon("dgs_addon.window").redraw()  # now, not when a slow window would be drawn: for the picture
    yield from robot.picture("3-optimizing")
    yield from until(lambda: not runner.running(), 600)
    seen["warm"] = addon("dgs_addon.drawing.process").draws()
    job, last = runner.current(), len(robot.ticks)
    yield from _first_picture(job.state.ended)
    seen["job"] = _figures(robot.ticks[first:])
    seen.update(phase=job.state.phase, error=job.state.error, seconds=job.state.seconds())
    yield from until(lambda: not runner.busy(), 20)
    yield 8.0
    seen["twin"] = _figures(robot.ticks[last:])
    seen["objects"] = sorted(thing.type for thing in bpy.context.scene.objects)
    seen["arrival"] = _arrival(robot)
    yield from robot.picture("4-twin")


def _first_picture(ended: float) -> Story:
    """When, after the job's end, the twin is in the scene, all is done, and its splats are drawn."""
    parts: dict[str, float] = {}
    events = {
        "placed": lambda: any("dgs_arrived" in thing for thing in bpy.context.scene.objects),
        "done": lambda: not addon("dgs_addon.job.runner").busy(),
        "drawn": _splats_are_drawn,
    }
    while len(parts) < len(events):
        for name, happened in events.items():
            if name not in parts and happened():
                parts[name] = time.monotonic() - ended
        if time.monotonic() - ended > 60:
            raise TimeoutError(f"no picture of the twin, but {parts}")
        yield 0.01
    seen["first"] = {**parts, "load": os.getloadavg()[0]}


def _splats_are_drawn() -> bool:
    """Whether the 3D view shows a picture of the twin that has splats in it."""
    shown = list(addon("dgs_addon.drawing.viewport")._views.values())
    return any(view.follower.picture is not None and view.follower.picture.pixels[..., 3].any() for view in shown)


def _arrival(robot: Robot) -> dict[str, object]:
    """Where the twin lies in the view that it came into, and what the panel says of the scene."""
    twin = next(thing for thing in bpy.context.scene.objects if "dgs_harmonics" in thing)
    region = next(region for region in robot.area().regions if region.type == "WINDOW")
    shown = robot.area().spaces.active.region_3d
    places = [twin.matrix_world @ vertex.co for vertex in list(twin.data.vertices)[::20]]
    seen_at = [location_3d_to_region_2d(region, shown, place) for place in places]
    inside = [at for at in seen_at if at and 0 <= at.x <= region.width and 0 <= at.y <= region.height]
    cameras = [child for child in twin.children if child.type == "CAMERA"]
    changes = addon("dgs_addon.scene.changes")
    return {
        "inside": len(inside) / len(places),
        "wide": (max((at.x for at in inside), default=0) - min((at.x for at in inside), default=0)) / region.width,
        "up": sum(camera.matrix_world.to_3x3().normalized().col[1].z for camera in cameras) / max(len(cameras), 1),
        "hidden": [thing.name for thing in changes.hidden_things(bpy.context.scene)],
        "changed": changes.changed_words(bpy.context.scene),
        "lines": any(getattr(robot.area().spaces.active.overlay, f"show_{name}") for name in _ACROSS),
    }


def _it_is_viewed_and_rendered(robot: Robot) -> Story:
    space = robot.area().spaces.active
    yield from robot.press("dgs.view_twin")
    yield 3.0
    yield from robot.picture("5-view")
    seen["viewed"] = [bpy.context.scene.render.engine, space.shading.type, space.region_3d.view_perspective]
    yield from robot.press("dgs.view_twin")
    seen["viewed again"] = [space.shading.type, space.region_3d.view_perspective, space.overlay.show_overlays]
    rendered: list[object] = []
    bpy.app.handlers.render_complete.append(lambda *_: rendered.append(1))
    yield from robot.press("dgs.render_twin")
    seen["clicks"] = robot.clicks
    yield from until(lambda: rendered, 400)
    yield 1.0
    yield from robot.picture("6-rendered")
    seen["rendered"] = True
    for window in bpy.context.window_manager.windows[1:]:  # the render's may cover the sidebar
        with bpy.context.temp_override(window=window):
            bpy.ops.wm.window_close()


def _exact_view(robot: Robot) -> Story:
    exact = addon("dgs_addon.questions.exact")
    yield from robot.press("dgs.exact_view")
    yield from until(lambda: exact.IMAGE in bpy.data.images or not exact.busy(), 300)
    seen["exact"] = exact.IMAGE in bpy.data.images
    yield 1.0
    yield from robot.picture("8-exact")


def _drop(robot: Robot, path: Path) -> None:
    """Drops a file onto the sidebar: Blender's own operator of a drop, which asks the file handlers."""
    window = bpy.context.window_manager.windows[0]
    with bpy.context.temp_override(window=window, area=robot.area(), region=robot.sidebar()):
        files = [{"name": path.name}]
        bpy.ops.wm.drop_import_file("INVOKE_DEFAULT", directory=str(path.parent), files=files)


def _files(robot: Robot) -> Story:
    """A twin leaves as SPZ and comes back by a drop; the menus have the entries."""
    before = set(bpy.data.objects)
    bpy.context.view_layer.objects.active = next(o for o in before if "dgs_harmonics" in o)
    bpy.ops.dgs.export_twin(filepath=str(FOLDER / "again.spz"), format=".spz")
    _drop(robot, FOLDER / "again.spz")
    yield 1.0
    added = [thing for thing in bpy.data.objects if thing not in before]
    seen["dropped_twin"] = [len(thing.data.vertices) for thing in added]
    for thing in added:
        bpy.data.objects.remove(thing)
    for name in ("import", "export"):
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[0], area=robot.area()):
            bpy.ops.wm.call_menu(name=f"TOPBAR_MT_file_{name}")
        yield from robot.picture(f"menu-{name}", out_of_the_way=False)
        robot.key("Escape")
        yield 0.5


def _in_words() -> None:
    """A button, and an error, as whoever reads German sees them."""
    seen["german"] = bpy.app.translations.pgettext_iface("Find Cameras", "Operator")
    try:
        bpy.ops.dgs.import_twin(filepath=str(FOLDER / "gone.ply"))
    except RuntimeError as error:  # (how Blender hands on what an operator reports)
        seen["german error"] = str(error)


def _test_set() -> Story:
    """Another Blender renders photos with a known truth; they become the photos of step 1."""
    settings, runner = bpy.context.scene.dgs, addon("dgs_addon.job.runner")
    settings.test_set, settings.test_views, settings.test_width = str(FOLDER / "made"), 3, 96
    bpy.ops.dgs.make_test_set()
    yield from until(lambda: not runner.busy(), 120)
    seen["made"] = [runner.current().state.phase, settings.photos, len(list((FOLDER / "made" / "sharp").glob("*.png")))]


def _another_file(robot: Robot) -> Story:
    """A question is asked, the file saved and opened again: the answer comes, and the exact view is still there."""
    inspection, settings = addon("dgs_addon.questions.inspection"), bpy.context.scene.dgs
    settings.photos, settings.out = str(FOLDER / "photos"), ""
    bpy.ops.dgs.inspect_photos()
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):
        bpy.ops.wm.save_as_mainfile(filepath=str(FOLDER / "work.blend"))
        bpy.ops.wm.open_mainfile(filepath=str(FOLDER / "work.blend"))
    yield 1.0
    yield from until(lambda: not inspection.effects.running and inspection.effects.answer, 300)
    seen["inspected"] = len(inspection.findings(inspection.effects.answer))
    image = bpy.context.scene.dgs.exact_view
    seen["kept"] = [image is not None and image.packed_file is not None, list(image.size) if image else []]
    name = addon("dgs_addon.questions.exact").icon_name(image) if image else ""
    seen["icon"] = addon("dgs_addon.job.pictures").icon(name) if image else 0
    yield from robot.open_tab("Descatter")
    yield from robot.picture("10-opened-again")


def _ended_early(robot: Robot) -> Story:
    """The job is cancelled, and its engine killed at random moments; the panel says so and has the way on."""
    settings, runner = bpy.context.scene.dgs, addon("dgs_addon.job.runner")
    settings.live, settings.preset, settings.max_gaussians = True, "fine", 5000  # long enough to be killed twice
    yield from robot.press("dgs.optimize")
    first = robot.clicked
    yield from until(lambda: runner.running() and len(runner.current().state.marks) > 3, 300)
    yield from robot.press("dgs.cancel_job", across=0.62)
    yield from until(lambda: not runner.running(), 60)
    seen["cancelled"] = runner.current().state.phase
    yield 1.0
    yield from robot.picture("7-cancelled")
    moments, killed = random.Random(), []
    for moment in (moments.uniform(0.0, 5.0), moments.uniform(0.0, 10.0)):
        yield from robot.press("dgs.resume_job")
        yield from until(lambda: runner.running() and runner.current().worker.pid is not None, 60)
        yield moment
        stage = runner.current().state.stage
        os.kill(runner.current().worker.pid, signal.SIGKILL)
        yield from until(lambda: not runner.running(), 20)
        killed.append([moment, stage, runner.current().state.error])
        yield 1.0
    seen["killed"] = killed
    yield from robot.picture("7-killed")
    yield from robot.press("dgs.resume_job")
    yield from until(lambda: runner.running(), 60)
    yield from until(lambda: not runner.busy(), 300)
    seen["live"] = _figures(robot.ticks[first:])
    seen["resumed"] = runner.current().state.phase
    yield 2.0


def _figures(ticks: list[Tick]) -> dict[str, object]:
    """What is said of the gaps: all of them, those in which nothing was drawn, and those that were not Blender's."""
    gaps, undrawn = sorted(tick.gap for tick in ticks), sorted(tick.gap for tick in ticks if not tick.drawn)
    late = [tick for tick in ticks if tick.gap > 0.1]
    return {
        "ticks": len(ticks),
        "usual": _usual(gaps),
        "worst": gaps[-1],
        "undrawn": len(undrawn) / len(gaps),
        "undrawn_usual": _usual(undrawn),
        "late": len(late),
        "load": os.getloadavg()[0],
        "waited": sum(tick.gap - tick.worked > 0.1 for tick in late),
    }


def _usual(ranked: list[float]) -> float:
    """The 99th percentile."""
    return ranked[int(0.99 * (len(ranked) - 1))] if ranked else 0.0


play(story)
