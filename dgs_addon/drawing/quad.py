"""A picture of the server as a rectangle over a 3D view, with the picture's depth."""

from __future__ import annotations

from typing import Any

import gpu
import numpy as np
from gpu_extras.batch import batch_for_shader

from .picture_server import Floats, Picture

_VERTEX = """
void main()
{
  place = pos;
  gl_Position = vec4(2.0 * pos - 1.0, 0.0, 1.0);
}
"""
#: A picture of the view's own size: px by px.
_EXACT = """
  ivec2 size = textureSize(picture, 0);
  ivec2 nearest = clamp(ivec2(place * vec2(size)), ivec2(0), size - 1);
  vec4 seen = texelFetch(picture, nearest, 0);
"""
#: A coarser one: between four px. Depths are the nearest px': a near and a far one have no middle.
_COARSE = """
  ivec2 size = textureSize(picture, 0);
  ivec2 nearest = clamp(ivec2(place * vec2(size)), ivec2(0), size - 1);
  vec2 at = place * vec2(size) - 0.5;
  vec2 part = at - floor(at);
  ivec2 low = clamp(ivec2(floor(at)), ivec2(0), size - 1);
  ivec2 high = clamp(ivec2(floor(at)) + 1, ivec2(0), size - 1);
  vec4 below = mix(texelFetch(picture, low, 0), texelFetch(picture, ivec2(high.x, low.y), 0), part.x);
  vec4 above = mix(texelFetch(picture, ivec2(low.x, high.y), 0), texelFetch(picture, high, 0), part.x);
  vec4 seen = mix(below, above, part.y);
"""
#: The depth in the window of a point at a depth before the camera, by OpenGL's projection of (z, w).
_DEPTH = """
  if (seen.a < 0.002) {
    discard;
  }
  float z = -(texelFetch(depths, nearest, 0).r - back);
  gl_FragDepth = clamp(0.5 + 0.5 * (projection.x * z + projection.y) / (projection.z * z + projection.w), 0.0, 1.0);
"""

_shaders: dict[tuple[bool, bool], Any] = {}


def _shader(deep: bool, exact: bool) -> Any:
    """The `gpu` shader, with depth or without, for a picture of the view's own size or a coarser one."""
    if (deep, exact) not in _shaders:
        between = gpu.types.GPUStageInterfaceInfo("descatter_place")
        between.smooth("VEC2", "place")
        info = gpu.types.GPUShaderCreateInfo()
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(between)
        info.sampler(0, "FLOAT_2D", "picture")
        if deep:
            info.sampler(1, "FLOAT_2D", "depths")
            info.push_constant("VEC4", "projection")
            info.push_constant("FLOAT", "back")
            if hasattr(info, "depth_write"):  # earlier Blenders take it as given
                info.depth_write("ANY")
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source(_VERTEX)
        body = (_EXACT if exact else _COARSE) + (_DEPTH if deep else "")
        info.fragment_source(f"void main()\n{{{body}  colour = seen;\n}}\n")
        _shaders[deep, exact] = gpu.shader.create_from_info(info)
    return _shaders[deep, exact]


class Quad:
    """Draws pictures; keeps the last one on the graphics card."""

    def __init__(self) -> None:
        self._picture: Picture | None = None
        self._colours: Any = None
        self._depths: Any = None

    def draw(self, picture: Picture, size: tuple[int, int], window: Any = None, back: float = 0.0) -> None:
        """Draws into what is bound, all over it.

        Args:
            picture: linear light; with depths it is drawn over the scene.
            size: (width, height) of the view in px.
            window: [4, 4] OpenGL's projection where depths count; None to draw over everything.
            back: how far behind Blender's the picture's camera stands.
        """
        deep = window is not None and picture.depth is not None
        if self._picture is not picture:
            self._picture, self._colours = picture, _texture(picture.pixels, "RGBA32F")
            self._depths = None if picture.depth is None else _texture(picture.depth, "R32F")
        shader = _shader(deep, size == (self._colours.width, self._colours.height))
        gpu.state.blend_set("ALPHA_PREMULT")
        gpu.state.depth_test_set("LESS_EQUAL" if deep else "NONE")
        gpu.state.depth_mask_set(deep)
        shader.bind()
        shader.uniform_sampler("picture", self._colours)
        if deep:
            shader.uniform_sampler("depths", self._depths)
            z, w = window[2], window[3]
            shader.uniform_float("projection", (z[2], z[3], w[2], w[3]))
            shader.uniform_float("back", back)
        corners = ((0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (1.0, 1.0))
        batch_for_shader(shader, "TRI_STRIP", {"pos": corners}).draw(shader)
        gpu.state.depth_mask_set(False)
        gpu.state.depth_test_set("NONE")
        gpu.state.blend_set("NONE")


def fill(colour: tuple[float, float, float]) -> None:
    """Fills what is bound with a colour in its own values, behind everything."""
    gpu.state.active_framebuffer_get().clear(color=(*colour, 1.0), depth=1.0)


def _texture(values: Floats, kind: str) -> Any:
    height, width = values.shape[:2]
    flat = np.ascontiguousarray(values).reshape(-1)
    return gpu.types.GPUTexture((width, height), format=kind, data=gpu.types.Buffer("FLOAT", len(flat), flat))


def forget_shaders() -> None:
    """Lets go of them, as when the add-on is switched off."""
    _shaders.clear()
