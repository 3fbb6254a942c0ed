"""The table and what lies on it: blocks, letters and a card with bars of known periods."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .materials import plain, table_top
from .parts import add_mesh, box

#: Periods (metres) of the bar groups on the resolution card: about 20, 14, 10, 8 and 6 px.
BAR_PERIODS = (0.0133, 0.0093, 0.0067, 0.0053, 0.0040)


def build(scene: Any, seed: int) -> None:
    """Adds the table (its top at z = 0) and the small things on it."""
    generator = np.random.default_rng(seed + 1)
    add_mesh(scene, "table", *box((0, 0, -0.02), (8.0, 8.0, 0.04)), table_top())
    palette = [
        plain(f"paint {i}", colour)
        for i, colour in enumerate(
            [
                (0.6, 0.05, 0.04),
                (0.05, 0.25, 0.55),
                (0.75, 0.52, 0.05),
                (0.06, 0.35, 0.12),
                (0.8, 0.8, 0.76),
                (0.03, 0.03, 0.03),
            ]
        )
    ]
    _blocks(scene, generator, palette)
    _letters(scene, palette)
    _bar_card(scene, palette)


def _blocks(scene: Any, generator: np.random.Generator, palette: list[Any]) -> None:
    for index in range(26):
        angle = index * 2.399963 + generator.uniform(-0.3, 0.3)
        distance = generator.uniform(0.20, 0.52)
        x, y = distance * np.cos(angle) * 1.15, distance * np.sin(angle) + 0.02
        if abs(x) < 0.24 and -0.20 < y < 0.16:
            continue  # the ball, the letters and the card keep their places
        size = generator.uniform(0.008, 0.030, 3)
        vertices, faces = box((0, 0, size[2] / 2), tuple(size))
        turn = generator.uniform(0, np.pi)
        rotated = [
            (x + np.cos(turn) * a - np.sin(turn) * b, y + np.sin(turn) * a + np.cos(turn) * b, c)
            for a, b, c in vertices
        ]
        add_mesh(scene, f"block {index}", rotated, faces, palette[index % len(palette)])


def _letters(scene: Any, palette: list[Any]) -> None:
    for text, place, size, turn, paint in (
        ("SCATTER", (-0.230, -0.115, 0.0), 0.030, 8.0, 4),
        ("splat 0.42", (0.150, -0.085, 0.0), 0.022, -6.0, 4),
        ("DGS", (-0.02, 0.165, 0.0), 0.045, 3.0, 5),
        ("36.6", (0.20, 0.10, 0.0), 0.036, -20.0, 0),
        ("fine print 5 px", (0.155, -0.115, 0.0), 0.012, 2.0, 5),
    ):
        curve = bpy.data.curves.new(text, "FONT")
        curve.body, curve.size, curve.extrude = text, size, 0.0008
        curve.materials.append(palette[paint])
        letters = bpy.data.objects.new(text, curve)
        letters.location = place
        letters.rotation_euler = (0, 0, np.radians(turn))
        scene.collection.objects.link(letters)


def _bar_card(scene: Any, palette: list[Any]) -> None:
    """Five groups of four dark bars, each with the same light and dark width."""
    left, bottom, height = -0.060, -0.148, 0.024
    width = sum(4 * period for period in BAR_PERIODS) + 0.006 * (len(BAR_PERIODS) + 1)
    corner = (left + width / 2, bottom + height / 2, 0.0005)
    add_mesh(scene, "card", *box(corner, (width, height + 0.012, 0.001)), palette[4])
    x = left + 0.006
    for period in BAR_PERIODS:
        for _ in range(4):
            centre = (x + period / 4, bottom + height / 2, 0.0011)
            add_mesh(scene, "bar", *box(centre, (period / 2, height, 0.0004)), palette[5])
            x += period
        x += 0.006
