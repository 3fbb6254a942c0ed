"""Shaders that draw splats on the graphics card, as `core.rasterizer.projection` and `reference` specify it.

One quad an instance, around the ellipse where a splat is seen at all; the instance's number is its place in the order,
far to near. Numbers are those of `core.constants`.
"""

from __future__ import annotations

from typing import Any

import gpu

from ...core.constants import (
    ALPHA_MAXIMUM,
    ALPHA_MINIMUM,
    FRUSTUM_MARGIN,
    LOW_PASS_VARIANCE,
    SH_C0,
    SH_C1,
    SH_C2,
    SH_C3,
)

#: Texels of a splat, and of a twin.
SPLAT_TEXELS, TWIN_TEXELS = 4, 6

_LOOKUP = """
vec4 texel_of(sampler2D rows, int number)
{
  int width = textureSize(rows, 0).x;
  return texelFetch(rows, ivec2(number % width, number / width), 0);
}
"""
_HARMONICS = """
/* Value k of the harmonics behind the zeroth, as they are packed. */
float packed_value(int splat, int k)
{
  return texel_of(harmonics, splat * texels + k / 4)[k % 4];
}

vec3 harmonic(int splat, int k)
{
  return vec3(packed_value(splat, 3 * k), packed_value(splat, 3 * k + 1), packed_value(splat, 3 * k + 2));
}
"""
_PROJECTION = """
void main()
{
  int splat = int(texel_of(order, gl_InstanceID).r + 0.5);
  vec4 place = texel_of(splats, splat * SPLAT_TEXELS);
  vec4 turn = normalize(texel_of(splats, splat * SPLAT_TEXELS + 1));
  vec4 shape = texel_of(splats, splat * SPLAT_TEXELS + 2);
  vec4 base = texel_of(splats, splat * SPLAT_TEXELS + 3);
  int twin = int(place.w + 0.5) * TWIN_TEXELS;
  vec4 first = texel_of(twins, twin), second = texel_of(twins, twin + 1), third = texel_of(twins, twin + 2);
  vec4 side = texel_of(twins, twin + 3), up = texel_of(twins, twin + 4), on = texel_of(twins, twin + 5);

  vec4 at = vec4(place.xyz, 1.0);
  vec3 point = vec3(dot(first, at), dot(second, at), dot(third, at));
  vec2 mean = lens.xy * point.xy / point.z + lens.zw;

  float w = turn.x, x = turn.y, y = turn.z, z = turn.w;
  vec3 scale = shape.xyz * side.w;
  vec3 one = vec3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y)) * scale.x;
  vec3 two = vec3(2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x)) * scale.y;
  vec3 three = vec3(2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y)) * scale.z;

  /* The direction of the Jacobian is clamped to the frame and a margin. */
  vec2 beyond = FRUSTUM_MARGIN * frame.xy + frame.zw;
  vec2 most = (frame.xy - lens.zw + beyond) / lens.xy, least = -(lens.zw + beyond) / lens.xy;
  vec2 towards = clamp(point.xy / point.z, least, most);
  vec3 along = lens.x / point.z * (first.xyz - towards.x * third.xyz);
  vec3 down = lens.y / point.z * (second.xyz - towards.y * third.xyz);
  vec3 ux = vec3(dot(along, one), dot(along, two), dot(along, three));
  vec3 uy = vec3(dot(down, one), dot(down, two), dot(down, three));

  /* In units of its own size no covariance overflows. */
  vec3 largest = max(abs(ux), abs(uy));
  float unit = max(1.0, max(largest.x, max(largest.y, largest.z)));
  ux /= unit;
  uy /= unit;
  float low_pass = LOW_PASS / unit / unit;
  float xx = dot(ux, ux), xy = dot(ux, uy), yy = dot(uy, uy);
  vec3 area = cross(ux, uy) * unit;
  float determinant = dot(area, area) + LOW_PASS * (xx + yy) + LOW_PASS * low_pass;
  xx += low_pass;
  yy += low_pass;
  shown_conic = vec4(vec3(yy, -xy, xx) / determinant, shape.w);

  /* Axes of the ellipse, and how far it is seen. */
  float half_difference = 0.5 * (xx - yy);
  float root = sqrt(half_difference * half_difference + xy * xy);
  vec2 axis = half_difference >= 0.0 ? vec2(half_difference + root, xy) : vec2(xy, root - half_difference);
  axis = root > 1e-12 ? normalize(axis) : vec2(1.0, 0.0);
  float wide = 0.5 * (xx + yy) + root, narrow = max(0.5 * (xx + yy) - root, low_pass);
  float reach = sqrt(max(2.0 * log(shape.w / ALPHA_LEAST), 0.0)) * unit * 1.001;
  vec2 away = pos.x * reach * sqrt(wide) * axis + pos.y * reach * sqrt(narrow) * vec2(-axis.y, axis.x);
  vec2 corner = (mean + away) / frame.xy * 2.0 - 1.0;
  gl_Position = shape.w > ALPHA_LEAST ? vec4(corner.x, -corner.y, 0.0, 1.0) : vec4(2.0, 2.0, 2.0, 1.0);

  vec3 seen_from = normalize(point);
  vec3 d = vec3(dot(side.xyz, seen_from), dot(up.xyz, seen_from), dot(on.xyz, seen_from));
  vec3 colour = SH_C0 * base.rgb;
#if COEFFICIENTS > 1
  colour += SH_C1 * (-d.y * harmonic(splat, 0) + d.z * harmonic(splat, 1) - d.x * harmonic(splat, 2));
#endif
#if COEFFICIENTS > 4
  vec3 s = d * d;
  colour += SH_C20 * d.x * d.y * harmonic(splat, 3) + SH_C21 * d.y * d.z * harmonic(splat, 4);
  colour += SH_C22 * (2.0 * s.z - s.x - s.y) * harmonic(splat, 5) + SH_C23 * d.x * d.z * harmonic(splat, 6);
  colour += SH_C24 * (s.x - s.y) * harmonic(splat, 7);
#endif
#if COEFFICIENTS > 9
  colour += SH_C30 * d.y * (3.0 * s.x - s.y) * harmonic(splat, 8) + SH_C31 * d.x * d.y * d.z * harmonic(splat, 9);
  colour += SH_C32 * d.y * (4.0 * s.z - s.x - s.y) * harmonic(splat, 10);
  colour += SH_C33 * d.z * (2.0 * s.z - 3.0 * s.x - 3.0 * s.y) * harmonic(splat, 11);
  colour += SH_C34 * d.x * (4.0 * s.z - s.x - s.y) * harmonic(splat, 12);
  colour += SH_C35 * d.z * (s.x - s.y) * harmonic(splat, 13) + SH_C36 * d.x * (s.x - 3.0 * s.y) * harmonic(splat, 14);
#endif
  shown_colour = vec4(max(colour + 0.5, vec3(0.0)), point.z);
  shown_mean = mean;
}
"""
_BLENDING = """
void main()
{
  vec2 d = vec2(gl_FragCoord.x, frame.y - gl_FragCoord.y) - shown_mean;
  float power = shown_conic.x * d.x * d.x + 2.0 * shown_conic.y * d.x * d.y + shown_conic.z * d.y * d.y;
  float alpha = min(shown_conic.w * exp(-0.5 * power), ALPHA_MOST);
  if (!(alpha >= ALPHA_LEAST)) {
    discard;
  }
  colours = vec4(shown_colour.rgb * alpha, alpha);
#if DEEP
  depths = vec4(shown_colour.w * alpha, 0.0, 0.0, alpha);
#endif
}
"""

_shaders: dict[tuple[int, bool], Any] = {}


def splat_shader(coefficients: int, deep: bool) -> Any:
    """The shader for splats of so many harmonics; `deep`: into a second target, depths multiplied by alpha."""
    key = coefficients, deep
    if key not in _shaders:
        between = gpu.types.GPUStageInterfaceInfo(f"descatter_splat_{coefficients}_{int(deep)}")
        between.flat("VEC4", "shown_conic")
        between.flat("VEC4", "shown_colour")
        between.flat("VEC2", "shown_mean")
        info = gpu.types.GPUShaderCreateInfo()
        for name, value in _numbers(coefficients, deep).items():
            info.define(name, value)
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(between)
        for slot, name in enumerate(("splats", "twins", "order", *(["harmonics"] if coefficients > 1 else []))):
            info.sampler(slot, "FLOAT_2D", name)
        info.push_constant("VEC4", "lens")
        info.push_constant("VEC4", "frame")
        if coefficients > 1:
            info.push_constant("INT", "texels")
        info.fragment_out(0, "VEC4", "colours")
        if deep:
            info.fragment_out(1, "VEC4", "depths")
        info.vertex_source(_LOOKUP + (_HARMONICS if coefficients > 1 else "") + _PROJECTION)
        info.fragment_source(_BLENDING)
        _shaders[key] = gpu.shader.create_from_info(info)
    return _shaders[key]


def _numbers(coefficients: int, deep: bool) -> dict[str, str]:
    numbers = {
        "LOW_PASS": LOW_PASS_VARIANCE,
        "FRUSTUM_MARGIN": FRUSTUM_MARGIN,
        "ALPHA_LEAST": ALPHA_MINIMUM,
        "ALPHA_MOST": ALPHA_MAXIMUM,
        "SH_C0": SH_C0,
        "SH_C1": SH_C1,
        **{f"SH_C2{k}": value for k, value in enumerate(SH_C2)},
        **{f"SH_C3{k}": value for k, value in enumerate(SH_C3)},
    }
    words = {name: f"({value!r})" for name, value in numbers.items()}
    words |= {"COEFFICIENTS": str(coefficients), "DEEP": str(int(deep))}
    return words | {"SPLAT_TEXELS": str(SPLAT_TEXELS), "TWIN_TEXELS": str(TWIN_TEXELS)}


_VERTEX = """
void main()
{
  place = pos;
  gl_Position = vec4(2.0 * pos - 1.0, 0.0, 1.0);
}
"""
#: sRGB multiplied by alpha, or over a background, becomes light; depths as in `quad`.
_SHOWN = """
float light_of(float value)
{
  if (power > 0.0) {
    return pow(value, power);
  }
  return value <= 0.04045 ? value / 12.92 : pow((value + 0.055) / 1.055, 2.4);
}

void main()
{
  ivec2 size = textureSize(picture, 0);
  ivec2 nearest = clamp(ivec2(place * vec2(size)), ivec2(0), size - 1);
  vec4 seen = texelFetch(picture, nearest, 0);
  float over = behind.a > 0.0 ? 1.0 : seen.a;
  if (over < 1.0 / 65535.0) {
    discard;
  }
#if DEEP
  if (seen.a < 0.002) {
    discard;
  }
  float z = -(texelFetch(depths, nearest, 0).r / seen.a - back);
  gl_FragDepth = clamp(0.5 + 0.5 * (projection.x * z + projection.y) / (projection.z * z + projection.w), 0.0, 1.0);
#endif
  vec3 value = max((seen.rgb + (over - seen.a) * behind.rgb) / over, vec3(0.0));
  colour = vec4(vec3(light_of(value.r), light_of(value.g), light_of(value.b)) * over, over);
}
"""

_screens: dict[bool, Any] = {}


def screen_shader(deep: bool) -> Any:
    """The shader that brings a drawn picture into a view as light; `deep`: with its depths."""
    if deep not in _screens:
        between = gpu.types.GPUStageInterfaceInfo(f"descatter_screen_{int(deep)}")
        between.smooth("VEC2", "place")
        info = gpu.types.GPUShaderCreateInfo()
        info.define("DEEP", str(int(deep)))
        info.vertex_in(0, "VEC2", "pos")
        info.vertex_out(between)
        info.sampler(0, "FLOAT_2D", "picture")
        info.push_constant("VEC4", "behind")
        info.push_constant("FLOAT", "power")
        if deep:
            info.sampler(1, "FLOAT_2D", "depths")
            info.push_constant("VEC4", "projection")
            info.push_constant("FLOAT", "back")
            if hasattr(info, "depth_write"):  # earlier Blenders take it as given
                info.depth_write("ANY")
        info.fragment_out(0, "VEC4", "colour")
        info.vertex_source(_VERTEX)
        info.fragment_source(_SHOWN)
        _screens[deep] = gpu.shader.create_from_info(info)
    return _screens[deep]


def forget_splat_shaders() -> None:
    """Lets go of them, as when the add-on is switched off."""
    _shaders.clear()
    _screens.clear()
