"""A wall with cracks of known widths and things on it that may move, as a .blend that `synthesize --scene` renders.

    python -m benchmarks.cracked_wall OUT.blend                            # first week
    python -m benchmarks.cracked_wall OUT.blend --out 4 --gone --wider 3   # second week

Sizes are mm; the wall is 1200 x 800 mm, and a px of 300 covers some 5 mm of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from dgs.dgs_addon.laboratory import surfaces
from dgs.dgs_addon.laboratory.parts import add_mesh, add_smooth, box, turned
from dgs.dgs_addon.laboratory.settings import OBJECT_INDEX
from dgs.dgs_addon.laboratory.sky import add_sky
from mathutils import Vector

#: Widths of the cracks, mm, and where they run: x of each point, up the wall.
CRACKS = {"fine": 30.0, "middle": 45.0, "wide": 70.0}
_WAYS = {"fine": (-0.42, -0.40, -0.43, -0.41), "middle": (-0.18, -0.21, -0.17, -0.20), "wide": (0.10, 0.07, 0.11, 0.09)}
#: The block that moves: its middle (x, z), its sides and how far it stands out, m.
BLOCK, BLOCK_SIZE, BLOCK_OUT = (0.36, 0.18), 0.22, 0.08


def built(out_mm: float, wider_mm: float, gone: bool, dim: float) -> None:
    """Makes the scene anew.

    Args:
        out_mm: how much farther the block stands out; wider_mm: how much wider the middle crack is.
        gone: without the knob. dim: factor on one of the lamps.
    """
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    plaster = surfaces.patchwork("plaster", 22.0, 0.9)
    add_mesh(scene, "wall", *box((0, 0.05, 0), (1.2, 0.1, 0.8)), plaster)
    black = surfaces.speckled("depth", (0.01, 0.01, 0.01), (0.02, 0.02, 0.02), 30.0, 1.0)
    for name, way in _WAYS.items():
        wide = (CRACKS[name] + (wider_mm if name == "middle" else 0.0)) / 1000.0
        _add_crack(scene, name, way, wide, black)
    stone = surfaces.patchwork("stone", 30.0, 0.8)
    deep = BLOCK_OUT + out_mm / 1000.0
    block = add_mesh(scene, "block", *box((0, 0, 0), (BLOCK_SIZE, 2 * BLOCK_OUT, BLOCK_SIZE)), stone)
    block.location = (BLOCK[0], BLOCK_OUT - deep, BLOCK[1])
    if not gone:
        half = np.linspace(0.0, np.pi / 2, 17)
        shape = [(0.09 * float(np.cos(a)), 0.09 * float(np.sin(a))) for a in half]
        knob = add_smooth(scene, "knob", turned(shape), surfaces.patchwork("knob", 35.0, 0.8))
        knob.location, knob.rotation_euler = (0.38, 0.0, -0.22), (np.pi / 2, 0.0, 0.0)
    for thing in scene.objects:
        thing.pass_index = OBJECT_INDEX
    add_sky(scene, "room", (0.9, 0.95, 1.0), 0.6)
    for spot, power in (((-1.5, -2.0, 1.5), 60.0 * dim), ((1.8, -1.8, 0.6), 30.0)):
        light = bpy.data.lights.new("lamp", "AREA")
        light.energy, light.size = power, 1.0
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = spot
        lamp.rotation_euler = (-lamp.location).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)


def _add_crack(scene: Any, name: str, way: tuple[float, ...], wide: float, material: Any) -> None:
    """A ribbon just before the wall, `wide` across its own way."""
    points = [Vector((x, -0.001, z)) for x, z in zip(way, np.linspace(-0.33, 0.33, len(way)), strict=True)]
    vertices, faces = [], []
    for first, last in zip(points, points[1:], strict=False):
        along = (last - first).normalized()
        beside = Vector((along.z, 0.0, -along.x)) * wide / 2
        start = len(vertices)
        vertices += [tuple(first - beside), tuple(first + beside), tuple(last + beside), tuple(last - beside)]
        faces.append((start, start + 1, start + 2, start + 3))
    add_mesh(scene, name, vertices, faces, material)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blend", type=Path)
    parser.add_argument("--out", type=float, default=0.0, help="mm that the block stands farther out")
    parser.add_argument("--wider", type=float, default=0.0, help="mm that the middle crack is wider")
    parser.add_argument("--gone", action="store_true", help="without the knob")
    parser.add_argument("--dim", type=float, default=1.0, help="factor on one of the lamps")
    options = parser.parse_args()
    built(options.out, options.wider, options.gone, options.dim)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.blend.resolve()))


if __name__ == "__main__":
    main()
