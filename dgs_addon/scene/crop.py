"""The box that limits which splats of a twin are shown."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from .nodes import BOX_INPUT, CROP_INPUT, set_splat_input, splat_modifier, splat_value

#: A new box holds this share of the splats along each axis: the stray ones around a twin lie outside.
_SHARE = 0.98


def crop_box(twin: Any) -> Any:
    """The twin's box, a `bpy` object; None if it has none."""
    modifier = splat_modifier(twin)
    return splat_value(modifier, BOX_INPUT) if modifier is not None else None


def add_crop_box(twin: Any, collection: Any) -> Any:
    """An empty cube around nearly all of a twin, as its child, that limits what is shown.

    Args:
        twin: `bpy` object with the splats' modifier.
        collection: `bpy` collection for the cube.

    Raises:
        KeyError: the twin's modifier is of an older version, which has no input for a box.
    """
    modifier = splat_modifier(twin)
    mesh = twin.data
    places = np.empty(len(mesh.vertices) * 3, np.float32)
    mesh.attributes["position"].data.foreach_get("vector", places)
    edge = (1.0 - _SHARE) / 2
    low, high = np.quantile(places.reshape(-1, 3).astype(np.float64), (edge, 1.0 - edge), axis=0)
    box = bpy.data.objects.new(f"{twin.name} crop", None)
    box.empty_display_type, box.empty_display_size = "CUBE", 1.0
    collection.objects.link(box)
    box.parent = twin
    box.location = (low + high) / 2
    box.scale = np.maximum((high - low) / 2, 1e-6)
    set_splat_input(modifier, BOX_INPUT, box)
    set_splat_input(modifier, CROP_INPUT, True)
    return box
