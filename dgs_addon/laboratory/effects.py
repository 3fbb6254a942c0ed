"""Media that Cycles renders itself: a lens with an aperture, motion during the exposure, fog.

Nothing here is a convolution: rays start on a disc, objects move while light arrives, light scatters in a
volume. The sharp truth beside such photos is the same scene through a pinhole, at the middle of the
exposure, in clear air.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import camera_to_blender, place_camera, points_to_blender
from .settings import OBJECT_INDEX, SynthesizeSettings

#: Half the side of the box of fog, in viewing distances: the cameras stand inside.
FOG_REACH = 1.5
#: Times that light may scatter in fog before it is given up.
_FOG_BOUNCES = 4


@contextmanager
def rendered_medium(settings: SynthesizeSettings, cameras: list[Camera], target: NDArray[np.float64]) -> Iterator[None]:
    """Inside, pictures are rendered through what the settings ask for; `frame` prepares each of them.

    Args:
        target: [3] middle of the object in Blender's world; the lens focuses there if `settings.focus` is 0.
    """
    with ExitStack() as stack:
        if settings.fog > 0:
            distance = float(np.median([np.linalg.norm(_place(camera) - target) for camera in cameras]))
            stack.enter_context(_fog(settings.fog, settings.fog_anisotropy, target, FOG_REACH * distance))
        if settings.moves:
            stack.enter_context(_open_shutter())
        yield


@contextmanager
def frame(
    settings: SynthesizeSettings, camera: Camera, along: NDArray[np.float64], target: NDArray[np.float64]
) -> Iterator[None]:
    """Sets the lens and the motion of one photo, and takes them back.

    Args:
        along: [3] unit vector in Blender's world in which the camera travels.
    """
    scene = bpy.context.scene
    place_camera(scene.camera, camera, scene.render)
    with ExitStack() as stack:
        if settings.aperture > 0:
            stack.enter_context(_lens(scene.camera.data, settings, camera, target))
        if settings.camera_motion > 0:
            stack.enter_context(_moving(scene.camera, along * settings.camera_motion / 1000))
        if any(settings.object_motion):
            step = np.array(settings.object_motion) / 1000
            for item in scene.objects:
                if item.pass_index == OBJECT_INDEX and (item.parent is None or item.parent.pass_index != OBJECT_INDEX):
                    stack.enter_context(_moving(item, step))
        yield


def travel(cameras: list[Camera]) -> NDArray[np.float64]:
    """[V, 3] unit vectors in Blender's world along the path of the cameras; to the right where there is none."""
    places = np.array([_place(camera) for camera in cameras])
    steps = np.gradient(places, axis=0) if len(places) > 1 else np.zeros((1, 3))
    lengths = np.linalg.norm(steps, axis=1, keepdims=True)
    right = np.array([points_to_blender(camera.rotation[0]) for camera in cameras])
    return np.where(lengths > 1e-9, steps / np.maximum(lengths, 1e-9), right)


def focus_distance(settings: SynthesizeSettings, camera: Camera, target: NDArray[np.float64]) -> float:
    """Depth (along the camera's axis, in the scene's units) that is sharp."""
    if settings.focus > 0:
        return settings.focus
    forward = points_to_blender(camera.rotation[2])
    return float((target - _place(camera)) @ forward)


@contextmanager
def _lens(data: Any, settings: SynthesizeSettings, camera: Camera, target: NDArray[np.float64]) -> Iterator[None]:
    lens = data.dof
    kept = lens.use_dof, lens.focus_object, lens.focus_distance, lens.aperture_fstop, lens.aperture_blades
    lens.use_dof, lens.focus_object, lens.aperture_blades = True, None, 0
    lens.focus_distance = focus_distance(settings, camera, target)
    # The frame with overscan is a larger sensor behind a shorter lens in Blender's terms; the hole stays as large.
    wide = camera_to_blender(camera.with_margin(settings.overscan)).lens
    lens.aperture_fstop = settings.aperture * wide / camera_to_blender(camera).lens
    try:
        yield
    finally:
        lens.use_dof, lens.focus_object, lens.focus_distance, lens.aperture_fstop, lens.aperture_blades = kept


@contextmanager
def _moving(item: Any, step: NDArray[np.float64]) -> Iterator[None]:
    """`item` moves by `step` ([3], Blender's world) while the shutter is open, and is in its place half-way."""
    scene = bpy.context.scene
    kept, moment = item.location.copy(), scene.frame_current
    within = Vector(step)
    if item.parent is not None:
        within = (item.parent.matrix_world @ item.matrix_parent_inverse).to_3x3().inverted() @ within
    animation = item.animation_data_create()
    action, animation.action = animation.action, None
    for at, share in ((moment - 1, -0.5), (moment + 1, 0.5)):
        item.location = kept + share * within
        item.keyframe_insert("location", frame=at)
    # Blender eases between keys, but Cycles takes the open, middle and closed shutter and goes straight between.
    scene.frame_set(moment)
    item.cycles.use_motion_blur = True
    try:
        yield
    finally:
        item.cycles.use_motion_blur = False
        made = animation.action
        animation.action = action
        if made is not None:
            bpy.data.actions.remove(made)
        item.location = kept


@contextmanager
def _open_shutter() -> Iterator[None]:
    """Motion blur over the two frames around the present one, for nothing but what `_moving` moves."""
    scene = bpy.context.scene
    render = scene.render
    place = render if hasattr(render, "motion_blur_position") else scene.cycles  # Cycles' own before 4.2
    kept = render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position
    still = {item: item.cycles.use_motion_blur for item in scene.objects}
    for item in still:
        item.cycles.use_motion_blur = False
    render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position = True, 2.0, "CENTER"
    try:
        yield
    finally:
        render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position = kept
        for item, was in still.items():
            item.cycles.use_motion_blur = was


@contextmanager
def _fog(density: float, anisotropy: float, middle: NDArray[np.float64], reach: float) -> Iterator[None]:
    """A box of fog of even density: light is scattered `density` times per unit of length, none is absorbed."""
    cycles = bpy.context.scene.cycles
    kept = cycles.max_bounces, cycles.volume_bounces
    material = bpy.data.materials.new("fog")
    if material.node_tree is None:
        material.use_nodes = True
    nodes, links = material.node_tree.nodes, material.node_tree.links
    nodes.clear()
    scatter, output = nodes.new("ShaderNodeVolumeScatter"), nodes.new("ShaderNodeOutputMaterial")
    scatter.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    scatter.inputs["Density"].default_value, scatter.inputs["Anisotropy"].default_value = density, anisotropy
    links.new(scatter.outputs["Volume"], output.inputs["Volume"])
    signs = np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    mesh = bpy.data.meshes.new("fog")
    faces = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    mesh.from_pydata((middle + reach * signs).tolist(), [], faces)
    mesh.materials.append(material)
    box = bpy.data.objects.new("fog", mesh)
    bpy.context.scene.collection.objects.link(box)
    cycles.max_bounces, cycles.volume_bounces = cycles.max_bounces + _FOG_BOUNCES, _FOG_BOUNCES
    try:
        yield
    finally:
        cycles.max_bounces, cycles.volume_bounces = kept
        bpy.data.objects.remove(box, do_unlink=True)
        bpy.data.meshes.remove(mesh)
        bpy.data.materials.remove(material)


def _place(camera: Camera) -> NDArray[np.float64]:
    return np.asarray(points_to_blender(camera.centre))
