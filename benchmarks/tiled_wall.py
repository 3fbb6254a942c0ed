"""A wall of tiles, half of which move: how many `change` finds, how many it invents, and whether its intervals hold.

    python -m benchmarks.tiled_wall scene OUT.blend                      # first week, or the second of a repeated set
    python -m benchmarks.tiled_wall scene OUT.blend --moved 6 --way right    # second week: every second tile, by 6 mm
    python -m benchmarks.tiled_wall count BEFORE AFTER --moved 6 --way right # of the twins of both

The .blend is for `synthesize --scene`. The wall is 1200 x 800 mm; its tiles, 24 of 150 mm unless `--columns` says
otherwise, stand out 30 mm.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from dgs.core.change.compared import changes
from dgs.core.change.findings import Changes, Region
from dgs.core.change.surface import Surface
from dgs.core.machine import use_machine
from dgs.core.progress import Silent
from dgs.core.twin.opened import open_twin

#: How far tiles stand out, m; the wall that they fill, m; the share of their pitch that they are wide.
OUT, WALL, SHARE = 0.03, (1.14, 0.76), 0.79
#: Which way tiles move, in Blender's world: along the wall, up, or towards the cameras.
WAYS = {"right": (1.0, 0.0, 0.0), "up": (0.0, 0.0, 1.0), "out": (0.0, -1.0, 0.0)}
#: A tile is found if so much of its face, by places, lies in regions.
FOUND = 0.25


@dataclass(frozen=True)
class Tiles:
    """As on a chessboard, every second one moves; sizes in m."""

    columns: int

    @property
    def pitch(self) -> float:
        return WALL[0] / self.columns

    @property
    def width(self) -> float:
        return round(SHARE * self.pitch, 3)

    def places(self) -> list[tuple[float, float, bool]]:
        """Middle (x to the right, up) of each tile, m, and whether it is one that moves."""
        rows = int(WALL[1] / self.pitch + 1e-9)
        at = [
            ((column - (self.columns - 1) / 2) * self.pitch, (row - (rows - 1) / 2) * self.pitch)
            for row in range(rows)
            for column in range(self.columns)
        ]
        return [(x, up, sum(divmod(index, self.columns)) % 2 == 0) for index, (x, up) in enumerate(at)]


def build(blend: Path, tiles: Tiles, moved_mm: float, way: str) -> None:
    """Writes the scene, every second tile moved."""
    import bpy
    from dgs.dgs_addon.laboratory import surfaces
    from dgs.dgs_addon.laboratory.parts import add_mesh, box
    from dgs.dgs_addon.laboratory.settings import OBJECT_INDEX
    from dgs.dgs_addon.laboratory.sky import add_sky

    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_mesh(scene, "wall", *box((0, 0.05, 0), (1.2, 0.1, 0.8)), surfaces.patchwork("plaster", 22.0, 0.9))
    for index, (x, up, moves) in enumerate(tiles.places()):
        # Each tile is a cut of another part of the same stone, which goes with it.
        stone = surfaces.patchwork(f"stone {index}", 30.0 + index, 0.8)
        tile = add_mesh(scene, f"tile {index}", *box((0, 0, 0), (tiles.width, 2 * OUT, tiles.width)), stone)
        by = np.array(WAYS[way]) * moved_mm / 1000.0 * moves
        tile.location = (x + by[0], by[1], up + by[2])
    for thing in scene.objects:
        thing.pass_index = OBJECT_INDEX
    add_sky(scene, "room", (0.9, 0.95, 1.0), 1.0)
    light = bpy.data.lights.new("lamp", "AREA")
    light.energy, light.size = 60.0, 2.0
    lamp = bpy.data.objects.new("lamp", light)
    lamp.location = (-1.5, -2.0, 1.5)
    lamp.rotation_euler = (-lamp.location).to_track_quat("-Z", "Y").to_euler()
    scene.collection.objects.link(lamp)
    bpy.ops.wm.save_as_mainfile(filepath=str(blend.resolve()))


def counted(found: Changes, first: Surface, tiles: Tiles, moved_mm: float, way: str) -> list[str]:
    """What was found, in words."""
    at, held = first.places.at, found.held
    x, up, out = at[:, 0], -at[:, 1], -at[:, 2]
    regions = [region for region in found.regions if not region.after]
    called = np.zeros(len(at), bool)
    for region in regions:
        called[region.places] = True
    shares, still, sizes, hold = [], [], [], []
    for tile_x, tile_up, moves in tiles.places():
        inside = np.maximum(abs(x - tile_x), abs(up - tile_up)) < tiles.width / 2
        face = held & inside & (out > OUT / 2)
        share = float(called[face].mean()) if face.any() else 0.0
        if not moves:
            still.append(share)
            continue
        shares.append(share)
        largest = max((r for r in regions if face[r.places].any()), key=lambda r: face[r.places].sum(), default=None)
        if largest is not None and largest.value is not None and largest.deviation:
            truth = moved_mm / 1000.0 / largest.pixel
            sizes.append(largest.value / truth)
            hold.append(abs(largest.value - truth) < 1.96 * largest.deviation)
    pixel = float(np.median(first.places.pixel))
    true, invented = (sum(share >= FOUND for share in part) for part in (shares, still))
    return [
        f"{moved_mm:g} mm {way}, {moved_mm / 1000.0 / pixel:.2f} px-equivalents: {true} of {len(shares)} tiles found"
        f" (a quarter of the face and more); of the faces {100 * np.mean(shares):.0f} % in the mean",
        f"of {len(still)} tiles that stood still {invented}; of the faces {100 * np.mean(still):.0f} %;"
        f" {100 * found.changed:.2f} % of the surface is called changed",
        _sizes(sizes, hold),
        *(_line(region) for region in regions[:30]),
    ]


def _sizes(sizes: list[float], hold: list[bool]) -> str:
    """How large motions came out, over the truth."""
    if not sizes:
        return ""
    middle = np.median(sizes)
    return f"size of a tile's region over truth, median {middle:.2f}; {sum(hold)} of {len(hold)} intervals hold"


def _line(region: Region) -> str:
    value = "" if region.value is None else f" {region.value:.2f} +- {region.deviation or 0:.2f} px"
    return f"  {region.kind}{value} {region.direction}, {region.area:.0f} px^2 at {np.round(region.centre, 2).tolist()}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    doing = parser.add_subparsers(dest="doing", required=True)
    scene, count = doing.add_parser("scene"), doing.add_parser("count")
    scene.add_argument("blend", type=Path)
    count.add_argument("before", type=Path)
    count.add_argument("after", type=Path)
    for part in (scene, count):
        part.add_argument("--moved", type=float, default=0.0, help="mm that every second tile is moved by")
        part.add_argument("--columns", type=int, default=6, help="of tiles")
        part.add_argument("--way", choices=sorted(WAYS), default="right")
    options = parser.parse_args()
    if options.doing == "scene":
        build(options.blend, Tiles(options.columns), options.moved, options.way)
        return
    tiles = Tiles(options.columns)
    before, later = open_twin(options.before, Silent()), open_twin(options.after, Silent())
    found, first, _ = changes(before, later, use_machine(None), Silent())
    print("\n".join(line for line in counted(found, first, tiles, options.moved, options.way) if line))


if __name__ == "__main__":
    main()
