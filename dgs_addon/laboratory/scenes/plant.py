"""A plant in a glazed pot: thin stems, sixty bent leaves of a mottled green, berries, and nothing around it."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .. import ball, surfaces
from ..parts import add_copy, add_mesh, add_smooth, leaf, lump, tube, turned


def build(seed: int) -> None:
    """The plant, about 0.3 m high around the origin."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    _pot(scene)
    _stems(scene, np.random.default_rng(seed))
    ball.add_lights(scene)
    ball.add_camera(scene)


def _pot(scene: Any) -> None:
    glaze = surfaces.Graph("glaze")
    at = surfaces.place(glaze)
    runs = surfaces.noise(glaze, surfaces.place(glaze, (1.0, 1.0, 0.25)), 45.0, 6.0)
    colour = glaze.ramp(runs, [(0.3, (0.03, 0.09, 0.16)), (0.5, (0.08, 0.26, 0.33)), (0.7, (0.55, 0.62, 0.52))])
    band = glaze.ramp(surfaces.waves(glaze, at, 90.0, 2.0), [(0.3, (0.5,) * 3), (0.6, (1.0,) * 3)])
    pot = [
        (0.0, -0.148),
        (0.042, -0.148),
        (0.046, -0.142),
        (0.062, -0.085),
        (0.068, -0.068),
        (0.072, -0.064),
        (0.072, -0.054),
    ]
    inside = [(0.064, -0.054), (0.062, -0.066), (0.0, -0.066)]
    add_smooth(
        scene, "pot", turned(pot + inside), surfaces.finished(glaze, glaze.mix(0.5, colour, band, "MULTIPLY"), 0.12)
    )
    soil = lump(3, 0.0605, 0.05, 4)
    soil.materials.append(surfaces.speckled("soil", (0.02, 0.012, 0.008), (0.16, 0.10, 0.06), 130.0, 0.9))
    earth = bpy.data.objects.new("soil", soil)
    earth.location, earth.scale = (0.0, 0.0, -0.066), (1.0, 1.0, 0.22)
    scene.collection.objects.link(earth)


def _stems(scene: Any, generator: np.random.Generator) -> None:
    bark = surfaces.speckled("bark", (0.05, 0.09, 0.02), (0.22, 0.26, 0.10), 160.0)
    green = surfaces.foliage("leaf", (0.03, 0.13, 0.02), (0.24, 0.42, 0.06), 130.0)
    red = surfaces.speckled("berry", (0.45, 0.02, 0.02), (0.80, 0.12, 0.05), 200.0, 0.15)
    blades = [
        add_mesh(scene, "leaf", *leaf(0.075, width, bend), green)
        for width, bend in ((0.022, 0.9), (0.030, 1.3), (0.017, 1.7))
    ]
    half = np.linspace(-np.pi / 2, np.pi / 2, 13)
    berry = add_smooth(scene, "berry", turned([(0.0055 * np.cos(a), 0.0055 * np.sin(a)) for a in half], 20), red)
    for index in range(9):
        azimuth = index * 2.4 + generator.uniform(-0.3, 0.3)
        lean, height = generator.uniform(0.03, 0.10), generator.uniform(0.11, 0.19)
        share = np.linspace(0.0, 1.0, 14)
        away = 0.012 + lean * share**1.7
        line = np.stack([away * np.cos(azimuth), away * np.sin(azimuth), -0.06 + height * share], -1)
        add_smooth(scene, "stem", tube(line, 0.0016), bark)
        for place in range(5, 14, 2):
            for side in (-1.0, 1.0):
                spin = azimuth - np.pi / 2 + side * generator.uniform(0.5, 1.4)
                rise = generator.uniform(0.2, 0.8)
                blade = blades[int(generator.integers(len(blades)))]
                add_copy(scene, blade, tuple(line[place]), (rise, 0.0, spin), generator.uniform(0.6, 1.0))
        add_copy(scene, berry, tuple(line[-1] + [0.0, 0.0, 0.005]))
        add_copy(scene, berry, tuple(line[-3] + generator.normal(0.0, 0.005, 3)), size=0.7)
    for first in (*blades, berry):
        bpy.data.objects.remove(first)
