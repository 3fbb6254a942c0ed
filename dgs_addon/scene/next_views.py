"""Cameras that `next-view` suggests, as camera objects that carry their expected gain."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ...core.camera import Camera
from ...core.errors import FormatError
from ...core.files import read_json
from ..axes import place_camera
from .removal import take_out

#: Custom properties of a suggested camera.
ORDER, GAIN = "dgs_take", "dgs_gain_bits"


def add_next_views(path: Path, name: str, scene: Any) -> list[Any]:
    """Adds the chosen cameras in a collection of their own, in place of those there.

    Args:
        path: a twin's next_views.json; name: of the collection; scene: `bpy` scene.

    Returns:
        The camera objects in the order in which to take their photos.

    Raises:
        FormatError: no such file, or damaged.
    """
    if not path.is_file():
        raise FormatError(f"There is no '{path}'", "Press Suggest Next Views first")
    try:
        views = read_json(path)["views"]
        chosen = sorted((v for v in views if v["order"]), key=lambda v: int(v["order"]))
        cameras = [
            Camera(
                str(v["name"]),
                int(v["width"]),
                int(v["height"]),
                float(v["fx"]),
                float(v["fy"]),
                float(v["cx"]),
                float(v["cy"]),
                np.array(v["rotation"], float).reshape(3, 3),
                np.array(v["translation"], float).reshape(3),
            )
            for v in chosen
        ]
        gains = [float(v["bits"]) for v in chosen]
    except (OSError, ValueError, KeyError, TypeError, OverflowError) as error:
        raise FormatError(f"'{path}' is damaged ({type(error).__name__})", "Press Suggest Next Views again") from error
    collection = next((c for c in scene.collection.children_recursive if c.name == name), None)
    if collection is None:
        collection = bpy.data.collections.new(name)
        scene.collection.children.link(collection)
    for thing in [thing for thing in collection.objects if ORDER in thing]:
        take_out(thing, collection)
    out = []
    for index, (camera, gain) in enumerate(zip(cameras, gains, strict=True), start=1):
        label = f"{index}. {camera.name} ({gain:.0f} bits)"
        thing = bpy.data.objects.new(label, bpy.data.cameras.new(label))
        collection.objects.link(thing)
        place_camera(thing, camera, None)
        thing[ORDER], thing[GAIN] = index, gain
        thing.show_name = True
        out.append(thing)
    return out
