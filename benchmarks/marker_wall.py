"""A wall with a printed chessboard and loose markers of known sizes, as a .blend that `synthesize --scene` renders.

    python -m benchmarks.marker_wall OUT.blend

The wall is 1.2 x 0.8 m; a px of 400 covers some 4 mm of it. On it hangs a board of `CHESSBOARD`, and six markers of
`LOOSE` lie on it and on a block that stands out before it and is turned.
"""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from dgs.core.measure.boards import parsed_board
from dgs.core.measure.printed import Sheet, sheet_of
from dgs.dgs_addon.laboratory import surfaces
from dgs.dgs_addon.laboratory.parts import add_mesh, box
from dgs.dgs_addon.laboratory.settings import OBJECT_INDEX
from dgs.dgs_addon.laboratory.sky import add_sky
from mathutils import Euler, Matrix, Vector

#: What hangs on the wall.
CHESSBOARD, LOOSE = "charuco:4x4_50,4x3,140mm,112mm", "aruco:4x4_50,120mm,{number}"
#: Number, middle (m; y: before the wall) and turn about the upright (degrees) of each loose marker.
MARKERS = {
    20: ((0.16, -0.003, 0.26), 0.0),
    21: ((0.46, -0.003, 0.26), 0.0),
    22: ((0.16, -0.003, -0.28), 0.0),
    23: ((0.46, -0.003, -0.28), 0.0),
}
#: The block: its middle, sides and turn; two more markers are on its face.
BLOCK, BLOCK_SIZE, TURNED = (0.31, -0.10, -0.01), (0.44, 0.14, 0.22), -14.0
ON_BLOCK = {24: -0.1, 25: 0.1}


#: Photos, and the way of the camera: how far it stands off (m), and how far it goes aside and up (degrees).
PHOTOS, DISTANCE, ASIDE, UP = 24, 1.4, 28.0, 16.0


def built() -> None:
    """Makes the scene anew."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    add_mesh(scene, "wall", *box((0, 0.05, 0), (1.2, 0.1, 0.8)), surfaces.patchwork("plaster", 22.0, 0.9))
    paper = surfaces.speckled("paper", (0.75, 0.75, 0.75), (0.8, 0.8, 0.8), 30.0, 1.0)
    ink = surfaces.speckled("ink", (0.02, 0.02, 0.02), (0.03, 0.03, 0.03), 30.0, 1.0)
    _add_sheet(scene, sheet_of(parsed_board(CHESSBOARD)), _placed((-0.28, -0.003, 0.02), 0.0), (paper, ink))
    block = add_mesh(scene, "block", *box((0, 0, 0), BLOCK_SIZE), surfaces.patchwork("stone", 30.0, 0.8))
    block.matrix_world = _placed(BLOCK, TURNED)
    for number, (middle, turn) in MARKERS.items():
        _add_marker(scene, number, _placed(middle, turn), (paper, ink))
    for number, aside in ON_BLOCK.items():
        face = block.matrix_world @ Matrix.Translation((aside, -BLOCK_SIZE[1] / 2 - 0.001, 0.0))
        _add_marker(scene, number, face, (paper, ink))
    for thing in scene.objects:
        thing.pass_index = OBJECT_INDEX
    add_lamps(scene)
    add_moving_camera(scene)


def _placed(middle: tuple[float, float, float], turn: float) -> Any:
    return Matrix.Translation(middle) @ Euler((0.0, 0.0, np.radians(turn))).to_matrix().to_4x4()


def _add_marker(scene: Any, number: int, world: Any, materials: tuple[Any, Any]) -> None:
    _add_sheet(scene, sheet_of(parsed_board(LOOSE.format(number=number))), world, materials)


def _add_sheet(scene: Any, sheet: Sheet, world: Any, materials: tuple[Any, Any]) -> None:
    """A sheet in the plane y = 0 about its middle, seen from -y; what is painted later lies a little nearer."""
    corners = [
        (0.0, 0.0, sheet.width, sheet.height, False),
        *((b.x, b.y, b.width, b.height, b.black) for b in sheet.boxes),
    ]
    for black, material in zip((False, True), materials, strict=True):
        vertices: list[tuple[float, ...]] = []
        faces: list[tuple[int, ...]] = []
        for index, (x, y, width, height, is_black) in enumerate(corners):
            if is_black != black:
                continue
            near = 0.0 if index == 0 else -0.0003 if is_black else -0.0006
            start = len(vertices)
            for u, v in ((x, y + height), (x + width, y + height), (x + width, y), (x, y)):
                at = Vector((u - sheet.width / 2, 1000 * near, sheet.height / 2 - v)) / 1000
                vertices.append(tuple(world @ at))
            faces.append((start, start + 1, start + 2, start + 3))
        add_mesh(scene, "sheet", vertices, faces, material)


def add_lamps(scene: Any) -> None:
    """A room's sky, and two lamps before the wall."""
    add_sky(scene, "room", (0.9, 0.95, 1.0), 0.6)
    for spot, power in (((-1.5, -2.0, 1.5), 60.0), ((1.8, -1.8, 0.6), 30.0)):
        light = bpy.data.lights.new("lamp", "AREA")
        light.energy, light.size = power, 1.0
        lamp = bpy.data.objects.new("lamp", light)
        lamp.location = spot
        lamp.rotation_euler = (-lamp.location).to_track_quat("-Z", "Y").to_euler()
        scene.collection.objects.link(lamp)


def add_moving_camera(scene: Any) -> None:
    """A camera that looks at the wall's middle from another place in each frame."""
    camera = bpy.data.objects.new("camera", bpy.data.cameras.new("camera"))
    camera.data.lens, camera.data.sensor_width, camera.rotation_mode = 36.0, 36.0, "QUATERNION"
    scene.collection.objects.link(camera)
    scene.camera, scene.frame_start, scene.frame_end = camera, 1, PHOTOS
    for frame in range(1, PHOTOS + 1):
        turn = 2 * np.pi * frame / PHOTOS
        aside, up = np.radians(ASIDE * np.sin(turn)), np.radians(UP * np.sin(2 * turn + 0.5))
        way = Vector((np.sin(aside) * np.cos(up), -np.cos(aside) * np.cos(up), np.sin(up)))
        camera.location, camera.rotation_quaternion = DISTANCE * way, (-way).to_track_quat("-Z", "Y")
        camera.keyframe_insert("location", frame=frame)
        camera.keyframe_insert("rotation_quaternion", frame=frame)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("blend", type=Path)
    options = parser.parse_args()
    built()
    bpy.ops.wm.save_as_mainfile(filepath=str(options.blend.resolve()))


if __name__ == "__main__":
    main()
