"""A brass model of planets: thin wires and arms, toothed wheels, gloss, and nothing around it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np
from mathutils import Quaternion

from .. import ball, surfaces
from ..parts import add_mesh, add_smooth, box, circle, gear, tube, turned

#: Distance from the column, height, radius (m), and what it is covered with.
_PLANETS = (
    (0.052, 0.030, 0.011, "stone"),
    (0.078, 0.012, 0.015, "patches"),
    (0.102, 0.040, 0.018, "chrome"),
    (0.126, -0.004, 0.021, "bands"),
    (0.060, -0.035, 0.009, "sand"),
)


def build(seed: int) -> None:
    """The model, about 0.3 m wide around the origin."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    generator = np.random.default_rng(seed)
    brass = surfaces.metal("brass", (0.80, 0.52, 0.18), 0.3)
    steel = surfaces.metal("steel", (0.62, 0.62, 0.65), 0.22)
    _stand(scene, brass, steel)
    _planets(scene, generator, brass)
    _rings(scene, brass, steel)
    ball.add_lights(scene)
    ball.add_camera(scene)


def _stand(scene: Any, brass: Any, steel: Any) -> None:
    wooden = surfaces.wood("foot", (0.09, 0.03, 0.012), (0.33, 0.13, 0.045), 55.0)
    foot = [
        (0.0, -0.118),
        (0.092, -0.118),
        (0.095, -0.112),
        (0.088, -0.104),
        (0.082, -0.100),
        (0.05, -0.096),
        (0.0, -0.094),
    ]
    add_smooth(scene, "foot", turned(foot), wooden)
    add_smooth(scene, "rim", tube(circle(0.0915) + [0.0, 0.0, -0.108], 0.0022, closed=True), brass)
    column = [
        (0.012, -0.095),
        (0.006, -0.085),
        (0.004, -0.06),
        (0.009, -0.05),
        (0.004, -0.04),
        (0.0035, 0.05),
        (0.0, 0.052),
    ]
    add_smooth(scene, "column", turned(column, 24), steel)
    for teeth, radius, height, paint in (
        (36, 0.045, -0.078, brass),
        (24, 0.030, -0.070, steel),
        (16, 0.021, -0.062, brass),
    ):
        add_mesh(scene, "wheel", *gear(teeth, radius, 0.0032, 0.004), paint).location = (0.0, 0.0, height)
        shape = gear(12, 0.016, 0.0032, 0.004)
        add_mesh(scene, "pinion", *shape, steel).location = (radius + 0.0145, 0.0, height)
    for turn in np.radians((30, 150, 270)):
        line = [(0.08 * np.cos(turn), 0.08 * np.sin(turn), -0.104), (0.03 * np.cos(turn), 0.03 * np.sin(turn), -0.052)]
        add_smooth(scene, "strut", tube(np.linspace(line[0], line[1], 6), 0.0014), brass)


def _planets(scene: Any, generator: np.random.Generator, brass: Any) -> None:
    covers = {
        "stone": surfaces.speckled("stone", (0.12, 0.10, 0.09), (0.55, 0.48, 0.40), 110.0),
        "patches": surfaces.patchwork("patches", 130.0, 0.25),
        "chrome": surfaces.metal("chrome", (0.85, 0.86, 0.88), 0.16, 20.0),
        "bands": _bands(),
        "sand": surfaces.speckled("sand", (0.45, 0.16, 0.07), (0.72, 0.42, 0.22), 150.0, 0.3),
    }
    half = np.linspace(-np.pi / 2, np.pi / 2, 25)
    sun = [(0.024 * np.cos(a), 0.062 + 0.024 * np.sin(a)) for a in half]
    add_smooth(scene, "sun", turned(sun), surfaces.speckled("sun", (0.75, 0.22, 0.02), (0.95, 0.70, 0.15), 60.0, 0.2))
    for index, (distance, height, radius, cover) in enumerate(_PLANETS):
        angle = index * 2.4 + generator.uniform(-0.3, 0.3)
        outwards = np.array([np.cos(angle), np.sin(angle), 0.0])
        start, end = [0.0, 0.0, height - 0.02], distance * outwards + [0.0, 0.0, height - 0.02]
        line = np.concatenate([np.linspace(start, end, 12), end + np.linspace(0.0015, 0.02, 6)[:, None] * [0, 0, 1]])
        add_smooth(scene, "arm", tube(line, 0.0013), brass)
        shape = turned([(radius * np.cos(a), radius * np.sin(a)) for a in half], centre=(0.0, 0.0, 0.0))
        planet = add_smooth(scene, f"planet {index}", shape, covers[cover])
        planet.location = tuple(distance * outwards + [0.0, 0.0, height + radius])
        planet.rotation_euler = (0.4, 0.2 * index, 0.0)
        if cover == "bands":
            flat = turned([(1.35 * radius, 0.0), (2.0 * radius, 0.0002), (1.35 * radius, 0.0004)], 96)
            ring = add_smooth(scene, "ring", flat, _grooves())
            ring.location, ring.rotation_euler = planet.location, (0.45, 0.1, 0.0)


def _rings(scene: Any, brass: Any, steel: Any) -> None:
    """An armillary sphere of wires around it, with marks every five degrees."""
    for radius, turn, paint in (
        (0.150, (np.pi / 2, 0.0, 0.0), steel),
        (0.147, (np.pi / 2, 0.0, np.pi / 2), brass),
        (0.144, (0.41, 0.0, 0.0), brass),
    ):
        ring = add_smooth(scene, "hoop", tube(circle(radius), 0.0013, closed=True), paint)
        ring.rotation_euler = turn
    for angle in np.radians(np.arange(0, 360, 5)):
        mark = add_mesh(scene, "mark", *box((0.144, 0.0, 0.0), (0.006, 0.0009, 0.0009)), steel)
        mark.rotation_mode = "QUATERNION"
        tilt, spin = _about((1.0, 0.0, 0.0), 0.41), _about((0.0, 0.0, 1.0), float(angle))
        mark.rotation_quaternion = tilt @ spin


def _about(axis: tuple[float, float, float], angle: float) -> Any:
    return Quaternion(axis, angle)


def _bands() -> Any:
    graph = surfaces.Graph("bands")
    at = surfaces.place(graph, (0.2, 0.2, 1.0))
    stripes = surfaces.waves(graph, at, 60.0, 5.0)
    colour = graph.ramp(stripes, [(0.0, (0.55, 0.32, 0.16)), (0.5, (0.85, 0.75, 0.55)), (1.0, (0.40, 0.16, 0.07))])
    return surfaces.finished(graph, colour, 0.15)


def _grooves() -> Any:
    graph = surfaces.Graph("grooves")
    at = graph.node("ShaderNodeTexCoord").outputs["Object"]
    away = graph.node("ShaderNodeVectorMath", operation="LENGTH")
    graph.put(away.inputs[0], at)
    share = graph.math("FRACT", graph.math("MULTIPLY", away.outputs["Value"], 330.0))
    colour = graph.ramp(share, [(0.2, (0.20, 0.14, 0.09)), (0.5, (0.80, 0.70, 0.52))])
    return surfaces.finished(graph, colour, 0.4)
