"""What stands in Blender's scene while a photo is taken: a lens, things that move, rough glass, fog.

Each is a context manager that takes itself away. They are `media.medium.Stage`.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

from ...core.camera import Camera
from ..axes import CAMERA_FLIP, camera_to_blender, place_camera

#: Times that light may scatter in fog before it is given up.
_FOG_BOUNCES = 4


@contextmanager
def lens(camera: Camera, aperture: float, focus: float) -> Iterator[None]:
    """A lens with a round hole.

    Args:
        camera: the frame that is rendered.
        aperture: diameter of the hole, in the scene's units.
        focus: depth along the axis that is sharp.
    """
    data = bpy.context.scene.camera.data
    dof = data.dof
    kept = dof.use_dof, dof.focus_object, dof.focus_distance, dof.aperture_fstop, dof.aperture_blades
    dof.use_dof, dof.focus_object, dof.aperture_blades, dof.focus_distance = True, None, 0, focus
    # Blender takes the hole as an f-number, of a lens before a sensor 36 mm wide.
    dof.aperture_fstop = camera_to_blender(camera).lens / 1000 / aperture
    try:
        yield
    finally:
        dof.use_dof, dof.focus_object, dof.focus_distance, dof.aperture_fstop, dof.aperture_blades = kept


@contextmanager
def moving(item: Any, step: NDArray[np.float64]) -> Iterator[None]:
    """`item` moves by `step` ([3], Blender's world) while the shutter is open, and is in its place half-way."""
    scene = bpy.context.scene
    kept, moment = item.location.copy(), scene.frame_current
    within = Vector(step)
    if item.parent is not None:
        within = (item.parent.matrix_world @ item.matrix_parent_inverse).to_3x3().inverted() @ within
    try:
        with _animated(item):
            for at, share in ((moment - 1, -0.5), (moment + 1, 0.5)):
                item.location = kept + share * within
                item.keyframe_insert("location", frame=at)
            # Blender eases between keys, but Cycles takes the open, middle and closed shutter and goes straight.
            scene.frame_set(moment)
            yield
    finally:
        item.location = kept


@contextmanager
def camera_path(camera: Camera, poses: NDArray[np.float64]) -> Iterator[None]:
    """The scene's camera goes through `poses` at even times while the shutter is open.

    Args:
        camera: its lens.
        poses: [2^n + 1, 3, 4] world to camera (R|t), the engine's axes; the first when the shutter opens.
    """
    scene = bpy.context.scene
    item, moment = scene.camera, scene.frame_current
    mode, steps = item.rotation_mode, item.cycles.motion_steps
    item.rotation_mode, item.cycles.motion_steps = "QUATERNION", (len(poses) - 1).bit_length() - 1
    try:
        with _animated(item):
            before = None
            for at, pose in zip(np.linspace(-1.0, 1.0, len(poses)), poses, strict=True):
                place_camera(item, camera.moved(pose[:, :3], pose[:, 3]))
                if before is not None and before.dot(item.rotation_quaternion) < 0:
                    item.rotation_quaternion.negate()
                before = item.rotation_quaternion.copy()
                for channel in ("location", "rotation_quaternion"):
                    item.keyframe_insert(channel, frame=moment + float(at))
            scene.frame_set(moment)
            yield
    finally:
        item.rotation_mode, item.cycles.motion_steps = mode, steps


@contextmanager
def _animated(item: Any) -> Iterator[None]:
    """`item` has an animation of its own, blurred, until the end."""
    animation = item.animation_data_create()
    action, animation.action = animation.action, None
    item.cycles.use_motion_blur = True
    try:
        yield
    finally:
        item.cycles.use_motion_blur = False
        made = animation.action
        animation.action = action
        if made is not None:
            bpy.data.actions.remove(made)


@contextmanager
def open_shutter(readout: float = 0.0) -> Iterator[None]:
    """Motion blur over the two frames around the present one, for nothing but what is animated inside.

    Args:
        readout: exposures from the first row to the last one; both together take the two frames.
    """
    scene = bpy.context.scene
    render = scene.render
    place = render if hasattr(render, "motion_blur_position") else scene.cycles  # Cycles' own before 4.2
    kept = render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position
    cycles = scene.cycles
    rolling = cycles.rolling_shutter_type, cycles.rolling_shutter_duration
    still = {item: item.cycles.use_motion_blur for item in scene.objects}
    for item in still:
        item.cycles.use_motion_blur = False
    render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position = True, 2.0, "CENTER"
    # Cycles means by the duration a row's share of the time that the shutter is open.
    cycles.rolling_shutter_type, cycles.rolling_shutter_duration = "TOP" if readout else "NONE", 1.0 / (1.0 + readout)
    try:
        yield
    finally:
        cycles.rolling_shutter_type, cycles.rolling_shutter_duration = rolling
        render.use_motion_blur, render.motion_blur_shutter, place.motion_blur_position = kept
        for item, was in still.items():
            item.cycles.use_motion_blur = was


@contextmanager
def sheet(corners: NDArray[np.float64], thickness: float, slope: float, index: float) -> Iterator[None]:
    """A sheet of glass before the scene's camera, which moves with it: smooth on its side, rough on the other.

    It is seen by the camera only, so that lamps light the object as they would without it: they stand on its side.

    Args:
        corners: [4, 3] in the camera's axes (the engine's), in order.
        thickness: in the scene's units.
        slope: standard deviation of the rough face's slopes along each axis.
        index: refractive index.
    """
    scene = bpy.context.scene
    away = np.cross(corners[1] - corners[0], corners[2] - corners[0])
    away *= thickness * np.sign(away[2]) / np.linalg.norm(away)
    with _pane(corners @ CAMERA_FLIP, away @ CAMERA_FLIP, slope, index) as item:
        item.parent = scene.camera
        item.cycles.use_motion_blur, item.cycles.motion_steps = True, scene.camera.cycles.motion_steps
        yield


@contextmanager
def standing_sheet(
    corners: NDArray[np.float64], away: NDArray[np.float64], slope: float, index: float
) -> Iterator[None]:
    """A sheet of glass that stands in the scene, seen by the camera only, as `sheet`.

    Args:
        corners: [4, 3] of its smooth side, Blender's world, in order.
        away: [3] from there to the rough side, Blender's world.
        slope, index: as of `sheet`.
    """
    with _pane(corners, away, slope, index):
        yield


@contextmanager
def _pane(
    corners: NDArray[np.float64], away: NDArray[np.float64], slope: float, index: float
) -> Iterator[bpy.types.Object]:
    """A sheet of glass: smooth at `corners` ([4, 3] in its own space), rough `away` ([3]) from there."""
    scene = bpy.context.scene
    both = np.concatenate([corners, corners + away])
    mesh = bpy.data.meshes.new("sheet")
    faces = [(0, 1, 2, 3), (7, 6, 5, 4)]
    outwards = np.cross(both[1] - both[0], both[2] - both[0]) @ away < 0
    mesh.from_pydata(both.tolist(), [], faces if outwards else [face[::-1] for face in faces])
    # Beckmann's width is sqrt(2) times the slopes' deviation, and Blender's roughness its root.
    materials = [_refracting("smooth", 0.0, index), _refracting("rough", float(np.sqrt(np.sqrt(2) * slope)), index)]
    for material in materials:
        mesh.materials.append(material)
    mesh.polygons[1].material_index = 1
    item = bpy.data.objects.new("sheet", mesh)
    item.visible_diffuse = item.visible_glossy = item.visible_volume_scatter = item.visible_shadow = False
    scene.collection.objects.link(item)
    cycles = scene.cycles
    kept = cycles.max_bounces, cycles.film_transparent_glass, cycles.film_transparent_roughness
    # Where objects stand alone, what the glass lets through has their alpha.
    cycles.max_bounces, cycles.film_transparent_glass, cycles.film_transparent_roughness = kept[0] + len(faces), True, 1
    try:
        yield item
    finally:
        cycles.max_bounces, cycles.film_transparent_glass, cycles.film_transparent_roughness = kept
        bpy.data.objects.remove(item, do_unlink=True)
        bpy.data.meshes.remove(mesh)
        for material in materials:
            bpy.data.materials.remove(material)


def _refracting(name: str, roughness: float, index: float) -> Any:
    material, nodes, links = _nodes(name)
    glass, output = nodes.new("ShaderNodeBsdfRefraction"), nodes.new("ShaderNodeOutputMaterial")
    glass.distribution = "BECKMANN"
    glass.inputs["Color"].default_value = (1.0, 1.0, 1.0, 1.0)
    glass.inputs["Roughness"].default_value, glass.inputs["IOR"].default_value = roughness, index
    links.new(glass.outputs[0], output.inputs["Surface"])
    return material


def _nodes(name: str) -> tuple[Any, Any, Any]:
    """A new material, its nodes (none yet) and its links."""
    material = bpy.data.materials.new(name)
    if material.node_tree is None:
        material.use_nodes = True
    material.node_tree.nodes.clear()
    return material, material.node_tree.nodes, material.node_tree.links


@contextmanager
def fog(density: float, anisotropy: float, middle: NDArray[np.float64], reach: float) -> Iterator[None]:
    """A box of fog of even density: light is scattered `density` times per unit of length, none is absorbed.

    Args:
        density: scattering coefficient, per unit of length.
        anisotropy: Henyey and Greenstein's g.
        middle: [3] of the box, Blender's world.
        reach: half its side.
    """
    cycles = bpy.context.scene.cycles
    kept = cycles.max_bounces, cycles.volume_bounces
    material, nodes, links = _nodes("fog")
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
