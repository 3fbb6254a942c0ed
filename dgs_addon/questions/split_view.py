"""The exact view in the camera's frame of a 3D view, split against a photo or another picture of the same view."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import blf
import bpy
import gpu
from bpy.app.translations import pgettext_iface as iface_
from bpy_extras.view3d_utils import location_3d_to_region_2d
from gpu_extras.batch import batch_for_shader

from ...core.photos.kinds import SUFFIXES
from ..paths import absolute
from ..scene.scene_cameras import PHOTO
from ..scene.twin import scene_twin
from . import exact

#: What pictures that differ by so much are shown to differ by: 1 is white.
_TIMES = 4.0
#: Width of the line and radius of its handle, px at a scale of 1; height of the words.
_LINE, _HANDLE, _WORDS = 1.5, 9.0, 13.0

_VERTEX = """
void main()
{
  place = pos;
  gl_Position = projection * vec4(mix(frame.xy, frame.zw, pos), 0.0, 1.0);
}
"""
#: Images come as linear light; what is drawn over a view is shown by the curve 1 / 2.2 (found on screenshots, see
#: `drawing.live`).
_FRAGMENT = """
vec3 encoded(vec3 light)
{
  light = max(light, vec3(0.0));
  return mix(12.92 * light, 1.055 * pow(light, vec3(1.0 / 2.4)) - 0.055, step(vec3(0.0031308), light));
}

void main()
{
  vec2 size = frame.zw - frame.xy;
  vec3 left = encoded(texture(first, place).rgb);
  vec2 fitted = 0.5 + (place - 0.5) * fit;
  bool inside = all(lessThanEqual(abs(fitted - 0.5), vec2(0.5)));
  vec3 right = inside ? encoded(texture(second, fitted).rgb) : vec3(0.0);
  if (times > 0.0) {
    right = inside ? times * abs(encoded(texture(third, place).rgb) - right) : vec3(0.0);
  }
  vec2 away = abs(vec2(place.x - split, place.y - 0.5) * size);
  float line = min(away.x - width, length(away) - handle);
  vec3 shown = place.x < split ? left : right;
  shown = mix(shown, vec3(1.0), clamp(0.5 - line, 0.0, 1.0));
  colour = vec4(pow(clamp(shown, 0.0, 1.0), vec3(2.2)), 1.0);
}
"""

_handle: Any = None
_shader: Any = None


@dataclass(frozen=True)
class Sides:
    """What is shown.

    Attributes:
        left, right: `bpy` images; right is None where there is no such picture.
        words: what they are called.
        less: the image that the right one is compared with; None to show it as it is.
    """

    left: Any
    right: Any
    words: tuple[str, str]
    less: Any = None


def start() -> None:
    """Begins to draw, where there is a window."""
    global _handle
    if _handle is None and not bpy.app.background:
        _handle = bpy.types.SpaceView3D.draw_handler_add(_draw, (), "WINDOW", "POST_PIXEL")


def stop() -> None:
    """Ends it."""
    global _handle, _shader
    if _handle is not None:
        bpy.types.SpaceView3D.draw_handler_remove(_handle, "WINDOW")
    _handle = _shader = None


def sides(scene: Any) -> Sides | None:
    """What is compared in a scene; None where there is no exact view."""
    settings = scene.dgs
    left = settings.exact_view
    if left is None:
        return None
    other, blurred = settings.exact_other, settings.view_kind == "medium"
    kind = iface_("Through the Medium") if blurred else iface_("Sharp")
    photo, truth = photo_of(scene.camera), truth_of(scene)
    if settings.split_against == "photo":
        return Sides(left, photo, (kind, iface_("Photo")))
    if settings.split_against == "truth":
        return Sides(left, truth, (kind, iface_("Sharp Photo")))
    if settings.split_against == "medium":
        return Sides(left, other, (kind, iface_("Sharp") if blurred else iface_("Through the Medium")))
    sharp, seen = (other, left) if blurred else (left, other if other is not None else left)
    if truth is not None and sharp is not None:
        return Sides(left, truth, (kind, iface_("Difference from the Sharp Photo, Four Times")), sharp)
    return Sides(left, photo, (kind, iface_("Difference from the Photo, Four Times")), seen)


def photo_of(camera: Any) -> Any:
    """The `bpy` image of the photo behind a camera; None if it has none."""
    pictures = camera.data.background_images if camera is not None and camera.type == "CAMERA" else ()
    return next((picture.image for picture in pictures if picture.image is not None), None)


def truth_of(scene: Any) -> Any:
    """The `bpy` image of the photo without the medium that belongs to the scene's camera; None if there is none."""
    folder = absolute(scene.dgs.truth)
    name = None if scene.camera is None else scene.camera.get(PHOTO)
    if folder is None or not isinstance(name, str):
        return None
    for suffix in sorted(SUFFIXES):
        path = folder / f"{Path(name).stem}{suffix}"
        known = next((image for image in bpy.data.images if image.filepath == str(path)), None)
        if known is not None:
            return known
        if path.is_file():
            return bpy.data.images.load(str(path))
    return None


def frame_of(context: Any) -> tuple[float, float, float, float] | None:
    """Left, bottom, right, top (px of the region) of the camera's frame; None where the view looks through none."""
    scene, space, region = context.scene, context.space_data, context.region
    camera = scene.camera
    if space is None or space.type != "VIEW_3D" or space.region_3d is None or region is None:
        return None
    if space.region_3d.view_perspective != "CAMERA" or camera is None or camera.type != "CAMERA":
        return None
    if space.use_local_camera and space.camera != camera:
        return None
    world = camera.matrix_world.normalized()
    corners = [
        location_3d_to_region_2d(region, space.region_3d, world @ corner)
        for corner in camera.data.view_frame(scene=scene)
    ]
    if any(corner is None for corner in corners):
        return None
    across, up = [corner.x for corner in corners], [corner.y for corner in corners]
    return min(across), min(up), max(across), max(up)


def shown(context: Any) -> bool:
    """Whether a 3D view shows the comparison."""
    settings = context.scene.dgs
    return bool(settings.split_shown and settings.exact_view is not None and frame_of(context) is not None)


def _draw() -> None:
    context = bpy.context
    scene = context.scene
    if not scene.dgs.split_shown:
        return
    compared, frame = sides(scene), frame_of(context)
    if compared is None or frame is None:
        return
    scale = context.preferences.system.ui_scale
    _draw_pictures(compared, frame, scene.dgs.split_at, scale)
    _write(compared, frame, scale, exact.is_outdated(scene_twin(scene, context.object), scene))


def _draw_pictures(compared: Sides, frame: tuple[float, ...], split: float, scale: float) -> None:
    right = compared.left if compared.right is None or not all(compared.right.size) else compared.right
    missing = right is not compared.right
    less = compared.left if compared.less is None else compared.less
    shader = _made()
    shader.bind()
    for name, image in (("first", compared.left), ("second", right), ("third", less)):
        shader.uniform_sampler(name, gpu.texture.from_image(image))
    shader.uniform_float("projection", gpu.matrix.get_projection_matrix() @ gpu.matrix.get_model_view_matrix())
    shader.uniform_float("frame", frame)
    shader.uniform_float("fit", _fit(right.size, frame))
    shader.uniform_float("split", 1.0 if missing else split)
    shader.uniform_float("times", 0.0 if compared.less is None or missing else _TIMES)
    shader.uniform_float("width", -1e3 if missing else 0.5 * _LINE * scale)
    shader.uniform_float("handle", -1e3 if missing else _HANDLE * scale)
    corners = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
    batch_for_shader(shader, "TRI_STRIP", {"pos": corners}).draw(shader)


def _fit(size: Any, frame: tuple[float, ...]) -> tuple[float, float]:
    """How many times as large as the picture the frame is, along both axes: all of the picture is in the frame."""
    wide = (frame[2] - frame[0]) / max(frame[3] - frame[1], 1e-6) / (size[0] / size[1])
    return (wide, 1.0) if wide > 1.0 else (1.0, 1.0 / wide)


def _write(compared: Sides, frame: tuple[float, ...], scale: float, outdated: bool) -> None:
    """What the sides are, in their upper corners; below, what is wrong."""
    left, bottom, right, top = frame
    blf.size(0, _WORDS * scale)
    blf.enable(0, blf.SHADOW)
    blf.shadow(0, 5, 0.0, 0.0, 0.0, 0.9)
    edge, high = 8 * scale, top - (_WORDS + 7) * scale
    words = compared.words
    lines = [(words[0], left + edge, high, False)]
    if compared.right is None:
        text = iface_("There is no such picture: {words}").format(words=words[1])
        lines.append((text, left + edge, bottom + edge, False))
    else:
        lines.append((words[1], right - edge, high, True))
    if outdated:
        text = iface_("Outdated: the twin, the camera or what is to be shown has changed")
        lines.append((text, left + edge, bottom + edge + (_WORDS + 5) * scale, False))
    for text, across, up, to_the_left in lines:
        blf.color(0, 1.0, 1.0, 1.0, 1.0)
        blf.position(0, across - (blf.dimensions(0, text)[0] if to_the_left else 0.0), up, 0)
        blf.draw(0, text)
    blf.disable(0, blf.SHADOW)


def _made() -> Any:
    global _shader
    if _shader is None:
        between = gpu.types.GPUStageInterfaceInfo("descatter_split")
        between.smooth("VEC2", "place")
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(between)
        for number, name in enumerate(("first", "second", "third")):
            info.sampler(number, "FLOAT_2D", name)
        info.push_constant("MAT4", "projection")
        info.push_constant("VEC4", "frame")
        info.push_constant("VEC2", "fit")
        for name in ("split", "times", "width", "handle"):
            info.push_constant("FLOAT", name)
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source(_VERTEX)
        info.fragment_source(_FRAGMENT)
        _shader = gpu.shader.create_from_info(info)
    return _shader
