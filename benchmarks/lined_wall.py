"""A wall with painted lines of known widths on four grounds, as a .blend that `synthesize --scene` renders.

    python -m benchmarks.lined_wall OUT.blend [--seed 1]

writes OUT.json, too: the lines as a set's lines.json has them (`core.evaluation.lines`). The wall is 1.2 x 0.8 m; a px
of 480 covers some 2.9 mm of it, so that lines are 4 to 14 px wide.
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from dgs.dgs_addon.axes import points_to_engine
from dgs.dgs_addon.laboratory import surfaces
from dgs.dgs_addon.laboratory.parts import add_mesh, box
from dgs.dgs_addon.laboratory.settings import OBJECT_INDEX

from .marker_wall import add_lamps, add_moving_camera

#: Widths of the lines of each ground, mm, and how long they are (m) and lean at most (degrees).
WIDTHS, LENGTH, LEAN = (11.7, 14.6, 17.5, 20.4, 23.4, 29.2, 35.0, 41.0), 0.17, 12.0
#: Grounds from the top: what is on them, and the line's grey.
GROUNDS = (("paper", 0.02), ("board", 0.7), ("plaster", 0.02), ("mosaic", 0.01))
HEIGHT, SIDE = 0.2, 1.2


def built(seed: int) -> list[dict[str, Any]]:
    """Makes the scene anew, and says where its lines are."""
    random = np.random.default_rng(seed)
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene, lines = bpy.context.scene, []
    grounds = {
        "paper": surfaces.speckled("paper", (0.6, 0.6, 0.58), (0.8, 0.79, 0.76), 4.0, 1.0),
        "board": surfaces.speckled("board", (0.08, 0.1, 0.12), (0.12, 0.13, 0.15), 6.0, 1.0),
        "plaster": surfaces.speckled("plaster", (0.3, 0.25, 0.2), (0.7, 0.65, 0.6), 22.0, 1.0),
        "mosaic": surfaces.patchwork("mosaic", 22.0, 0.9),
    }
    for row, (ground, grey) in enumerate(GROUNDS):
        up = (1.5 - row) * HEIGHT
        add_mesh(scene, ground, *box((0, 0.05, up), (SIDE, 0.1, HEIGHT)), grounds[ground])
        paint = surfaces.speckled(f"paint {ground}", (grey,) * 3, (1.1 * grey,) * 3, 30.0, 1.0)
        order = random.permutation(WIDTHS)
        for slot, width in enumerate(order):
            across = (slot - 0.5 * (len(order) - 1)) * SIDE / len(order) + random.uniform(-0.01, 0.01)
            lean = np.radians(random.uniform(-LEAN, LEAN))
            name = f"{ground} {width} mm"
            lines.append(_add_line(scene, name, (across, up), float(lean), width / 1000.0, paint))
    for thing in scene.objects:
        thing.pass_index = OBJECT_INDEX
    add_lamps(scene)
    add_moving_camera(scene)
    return lines


def _add_line(scene: Any, name: str, at: tuple[float, float], lean: float, width: float, paint: Any) -> dict[str, Any]:
    """A ribbon just before the wall."""
    along = np.array([np.sin(lean), 0.0, np.cos(lean)])
    across = np.array([np.cos(lean), 0.0, -np.sin(lean)])
    middle = np.array([at[0], -0.0005, at[1]])
    ends = middle - along * LENGTH / 2, middle + along * LENGTH / 2
    corners = [ends[0] - across * width / 2, ends[0] + across * width / 2]
    corners += [ends[1] + across * width / 2, ends[1] - across * width / 2]
    add_mesh(scene, name, [tuple(corner) for corner in corners], [(0, 1, 2, 3)], paint)
    points = middle + np.linspace(-0.5, 0.5, 33)[:, None] * LENGTH * along
    turned = points_to_engine(np.stack([np.zeros(3), across, (0.0, -1.0, 0.0)]))
    return {
        "name": name,
        "width_m": width,
        "points": points_to_engine(points).tolist(),
        "across": np.repeat(turned[1:2] - turned[:1], len(points), axis=0).tolist(),
        "normals": np.repeat(turned[2:3] - turned[:1], len(points), axis=0).tolist(),
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blend", type=Path)
    parser.add_argument("--seed", type=int, default=0, help="of where the lines are and how they lean")
    options = parser.parse_args()
    lines = built(options.seed)
    bpy.ops.wm.save_as_mainfile(filepath=str(options.blend.resolve()))
    options.blend.with_suffix(".json").write_text(json.dumps(lines), "utf-8")


if __name__ == "__main__":
    main()
