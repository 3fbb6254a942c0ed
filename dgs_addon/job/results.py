"""What a finished job puts into the scene: the twin with its provenance, and the cameras."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

from ...core.cloud import GaussianCloud
from ...core.errors import DgsError, FormatError
from ...core.files import read_json
from ...core.formats.ply import read_ply
from ...core.json_shape import anything, check_shape, text
from ..axes import matrix_to_blender
from ..paths import absolute
from ..scene.arrival import frame, hide_startup, stand_upright
from ..scene.cameras import add_cameras
from ..scene.changes import noting
from ..scene.comparison import CHANGED_MESH
from ..scene.compositing import leave_twins_scene
from ..scene.crop import crop_box
from ..scene.medium import PSF
from ..scene.next_views import ORDER, add_next_views
from ..scene.nodes import splat_nodes, splat_nodes_exist
from ..scene.points import POINTS, add_points
from ..scene.removal import replace_mesh, take_out
from ..scene.scene_cameras import PHOTO, SCENE_CAMERAS
from ..scene.setting_up import set_up_scene
from ..scene.sources import read_sources, remember_source, source_of, write_sources
from ..scene.twin import add_twin, glossy, is_twin, splat_mesh
from .job import Job

#: Object properties: where a twin comes from.
FOLDER, PHOTOS, SETTINGS, SCORE = "dgs_results", "dgs_photos", "dgs_settings", "dgs_score"
#: Object property: the scene was set up for this twin.
ARRIVED = "dgs_arrived"


def add_results(job: Job, scene: Any) -> Iterator[None]:
    """The twin of a job that has just ended, piece by piece, so that the window can be drawn in between.

    Its Gaussians were read beside the window.
    """
    yield from _pieces(job.request.home, scene, job.cloud)


def add_twin_of(out: Path, scene: Any, cloud: GaussianCloud | None = None) -> Any:
    """Puts OUT/twin.ply and OUT/cameras into the scene, in place of what came from there before.

    Args:
        out: folder of a finished run.
        scene: `bpy` scene.
        cloud: the twin's Gaussians, if they are read already.

    Returns:
        The twin, the active object now.

    Raises:
        FormatError: no twin there, or a damaged one.
    """
    for _ in _pieces(out, scene, cloud):
        pass
    return twin_of(out, scene)


def _pieces(out: Path, scene: Any, cloud: GaussianCloud | None) -> Iterator[None]:
    cloud = cloud if cloud is not None else read_ply(out / "twin.ply")
    if prepared(cloud):
        yield
    twin = _place(cloud, out, scene)
    _provenance(twin, out)
    # The twin alone is worth having; the Cameras step says what is wrong with its cameras.
    with noting(scene), contextlib.suppress(DgsError):
        add_cameras_of(out, absolute(str(twin.get(PHOTOS, ""))), scene)
    if ARRIVED not in twin:
        twin[ARRIVED] = True
        _arrive(twin, scene)


def _arrive(twin: Any, scene: Any) -> None:
    """What is done once for a twin: a later state of it finds the scene as the user has left it."""
    with noting(scene):
        set_up_scene(scene)
    hide_startup(scene)
    for layer in scene.view_layers:
        layer.update()  # else its cameras stand nowhere yet
    given = _given_cameras(twin)
    if given != "scene":  # the scene's own cameras say where the twin belongs
        stand_upright(twin, given == "file")
        for layer in scene.view_layers:
            layer.update()
    if not bpy.app.background:
        frame(twin, scene)


def _given_cameras(twin: Any) -> str:
    """'scene', 'file', or '' where the cameras were found from the photos."""
    try:
        text = json.loads(str(twin.get(SETTINGS, "{}")))["run"]["cameras"]
    except (ValueError, KeyError, TypeError):
        return ""
    if not isinstance(text, str) or not text:
        return ""
    return "scene" if SCENE_CAMERAS in Path(text).parts else "file"


def prepared(cloud: GaussianCloud) -> bool:
    """Makes the nodes that show this twin; False if they were there. A step of its own, for it takes a while."""
    if splat_nodes_exist(glossy(cloud)):
        return False
    splat_nodes(glossy(cloud))
    return True


def show_live(job: Job, scene: Any) -> None:
    """Shows the twin so far; the finished one takes its place."""
    _place(job.cloud, job.request.out, scene)


def twin_of(out: Path, scene: Any) -> Any:
    """The scene's twin that came from this folder, or None; of a twin and its duplicates, the one with cameras."""
    twins = [thing for thing in scene.objects if is_twin(thing) and thing.get(FOLDER) == str(out)]
    return max(twins, key=lambda twin: any(child.type == "CAMERA" for child in twin.children), default=None)


def is_edited(out: Path, scene: Any) -> bool:
    """Whether the scene's twin of this folder is in Edit Mode, where nothing may take its place."""
    twin = twin_of(out, scene)
    return twin is not None and bool(twin.data.is_editmode)


def _place(cloud: GaussianCloud, out: Path, scene: Any) -> Any:
    twin, file = twin_of(out, scene), out / "twin.ply"
    if twin is None:
        name = out.name.removesuffix("-twin") or "twin"
        twin = add_twin(cloud, f"{name} twin", scene.collection)
        twin[FOLDER] = str(out)
        remember_source(twin.data, file, cloud)
        _select(twin, scene)
        return twin
    if twin.data.is_editmode:
        raise FormatError(f"'{twin.name}' is in Edit Mode", "Leave it first")
    source = source_of(file, cloud, read_sources(twin.data))
    mesh = splat_mesh(source.placed(cloud), twin.data.name)
    write_sources(mesh, [source])
    replace_mesh(twin.data, mesh)
    return twin


def _select(twin: Any, scene: Any) -> None:
    """Where a window shows the scene; a timer has no context of its own."""
    for layer in scene.view_layers:
        layer.update()  # else it has no object of the twin yet
        if twin.name in layer.objects:
            for other in list(layer.objects.selected):
                other.select_set(False, view_layer=layer)
            # Active, not selected: outlines of thousands of splats hide what is between them.
            layer.objects.active = twin


#: What is kept of a report with a twin in a scene.
_PROVENANCE = {
    "photos": {"folder": text},
    "settings": anything,
    "medium": {"psf": text},
    "heldout": {"degraded": anything, "sharp": anything},
}


def _provenance(twin: Any, out: Path) -> None:
    try:
        report = read_json(out / "report.json")
    except (OSError, ValueError):
        return  # a twin without a report is still a twin
    try:
        check_shape(report, _PROVENANCE)
    except ValueError:
        return
    twin[PHOTOS] = report["photos"]["folder"]
    with contextlib.suppress(RecursionError):  # brackets in brackets, as no report has them
        twin[SETTINGS] = json.dumps(report["settings"])
    twin[PSF] = report["medium"]["psf"]
    twin[SCORE] = json.dumps({key: report["heldout"][key] for key in ("degraded", "sharp")})


def _cameras_name(out: Path) -> str:
    return f"{out.name.removesuffix('-twin') or 'twin'} cameras"


def add_cameras_of(out: Path, photos: Path | None, scene: Any) -> list[Any]:
    """Puts OUT/cameras into the scene, with the photos behind them and their points, in place of those there.

    Raises:
        FormatError: no cameras there, or damaged ones.
    """
    name, before = _cameras_name(out), _cameras_collection(out, scene)
    cameras = add_cameras(out / "cameras", photos if photos and photos.is_dir() else None, scene, before)
    collection = before or cameras[0].users_collection[0]
    if before is None:
        collection.name = name
    collection[FOLDER] = str(out)
    twin = twin_of(out, scene)
    with contextlib.suppress(DgsError):  # cameras are worth having without points
        points = _points(out / "cameras", f"{name} points", collection)
        if points is not None and twin is not None:
            points.hide_viewport |= points.parent != twin  # the twin shows more
            attach([points], twin)
    if twin is not None:
        attach(cameras, twin)
    return cameras


def _cameras_collection(out: Path, scene: Any) -> Any:
    """The scene's collection of the cameras that came from this folder, or None. Earlier versions did not mark it."""
    there = scene.collection.children_recursive
    marked = next((c for c in there if c.get(FOLDER) == str(out)), None)
    return marked or next((c for c in there if c.name == _cameras_name(out) and FOLDER not in c), None)


def _points(model: Path, name: str, collection: Any) -> Any:
    """The model's points in this collection, as an object that stays the same; None if it has none."""
    before = next((thing for thing in collection.objects if POINTS in thing), None)
    points = add_points(model, name, collection)
    if points is None:
        if before is not None:
            take_out(before, collection)
        return None
    if before is None:
        return points
    mesh = points.data
    before[POINTS] = points[POINTS]
    bpy.data.objects.remove(points)
    replace_mesh(before.data, mesh)
    return before


def attach(things: list[Any], twin: Any) -> None:
    """What scales, turns or moves the twin takes its cameras and points along.

    They were recovered with the twin where `add_twin` puts it; it may have been moved since.
    """
    at_rest = Matrix(matrix_to_blender(np.eye(4)).tolist())
    for thing in things:
        if thing.parent == twin:
            continue
        world = thing.matrix_world.copy()
        thing.parent = twin
        thing.matrix_parent_inverse = at_rest.inverted()
        thing.matrix_basis = world


def add_suggested(out: Path, scene: Any) -> list[Any]:
    """Puts the cameras that the engine suggests for the twin in `out` into the scene, tied to it.

    Raises:
        FormatError: there are none, or their file is damaged.
    """
    cameras = add_next_views(out / "next_views.json", f"{out.name.removesuffix('-twin')} next views", scene)
    twin = twin_of(out, scene)
    if twin is not None:
        attach(cameras, twin)
    return cameras


def remove_twin(twin: Any, scene: Any) -> None:
    """Takes a twin out of the scene with all that came with it: cameras, points, suggestions, changes, crop box.

    A duplicate of it keeps them. What the user has made stays: objects beside them, and those that hang on the twin.
    """
    out, box = Path(str(twin.get(FOLDER, ""))), crop_box(twin)
    others = [thing for thing in scene.objects if thing != twin and is_twin(thing) and thing.get(FOLDER) == str(out)]
    ours = [
        thing
        for thing in twin.children
        if thing == box or any(mark in thing for mark in (PHOTO, POINTS, ORDER, CHANGED_MESH))
    ]
    for thing in twin.children:
        if thing not in ours or (others and thing != box):
            world = thing.matrix_world.copy()
            thing.parent, thing.matrix_world = None, world
        else:
            _take_out_of(scene, thing)
    leave_twins_scene(twin, scene)
    _take_out_of(scene, twin)
    if others:
        attach([thing for thing in ours if thing != box], others[0])


def _take_out_of(scene: Any, thing: Any) -> None:
    """Out of all collections of this scene; those that held nothing else and are ours go along."""
    collections = [scene.collection, *scene.collection.children_recursive]
    for collection in [collection for collection in thing.users_collection if collection in collections]:
        last = len(thing.users_collection) == 1
        take_out(thing, collection)
        if collection.get(FOLDER) and not collection.objects and not collection.children:
            bpy.data.collections.remove(collection)
        if last:
            return
