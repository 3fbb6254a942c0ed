"""The twins of a scene as the picture server takes them."""

from __future__ import annotations

from typing import Any

import bpy
import numpy as np

from ...core.errors import FormatError
from ...core.serving.messages import PlacedTwin
from ..axes import matrix_to_engine
from ..scene.nodes import BOX_INPUT, COUNT_INPUT, CROP_INPUT, SIZE_INPUT, THRESHOLD_INPUT, splat_modifier, splat_value
from ..scene.reading import readable
from ..scene.twin import TWIN, is_twin
from .contents import content_of, guessed_of
from .edited import edited_key, final_key, note_change
from .held_twins import TwinStore
from .picture_server import PictureServer

#: Keys of the meshes that were read, by their number in this session: they hold until the mesh changes. '' where
#: nothing is to be seen.
_keys: dict[int, str] = {}


def placed_twins(depsgraph: Any, server: TwinStore, space: Any = None, fresh: bool = False) -> tuple[PlacedTwin, ...]:
    """The twins that are to be seen, handed over to whoever draws them.

    Args:
        depsgraph: of the picture; its mode says what is visible.
        server: who draws it.
        space: the 3D view that they are drawn in, which may hide some; None for a final picture.
        fresh: read meshes again even if nobody said that they had changed.
    """
    placed = []
    for thing in depsgraph.objects:
        if is_twin(thing) and (space is None or thing.original.visible_in_viewport_get(space)):
            twin = thing.original
            if not twin.data.is_editmode:
                key = _key(twin, server, fresh)
            elif space is None:
                key = final_key(twin, server)
            elif (key := edited_key(twin, server)) is None:
                key = _keys.get(twin.data.session_uid)  # as it was before, until it is read
            if key:
                placed.append(_placed(thing, key, depsgraph))
    return tuple(placed)


def whole_twin(twin: Any, server: PictureServer) -> PlacedTwin:
    """A twin in its own axes and colours, with all its splats, whatever the scene shows of it.

    Raises:
        FormatError: its attributes are not those of a twin.
    """
    with readable(twin) as mesh:
        content = content_of(mesh, twin.data.session_uid, int(twin[TWIN]), whole=True)
    if content is None:
        raise FormatError(f"'{twin.name}' cannot be read as splats", "Add the twin anew")
    server.put(*content)
    return PlacedTwin(content[0].key, _row(np.eye(4)))


def guessed_twins(depsgraph: Any, server: PictureServer) -> tuple[PlacedTwin, ...]:
    """The twins of a final picture in grey: black where photos fix a splat's colour, white where they say nothing.

    White, too, where nobody asked (see `scene.known`). Read anew each time.
    """
    placed = []
    for thing in depsgraph.objects:
        if not is_twin(thing):
            continue
        with readable(thing.original) as mesh:
            content = guessed_of(mesh, thing.original.data.session_uid, int(thing[TWIN]))
        if content is not None:
            server.put(*content)
            placed.append(_placed(thing, content[0].key, depsgraph))
    return tuple(placed)


def changed_twins(depsgraph: Any) -> bool:
    """Notes which meshes have changed; True if any twin did, or moved, or may be seen differently."""
    any_changed = False
    for update in depsgraph.updates:
        thing = update.id.original  # (what is evaluated has numbers of its own)
        if update.is_updated_geometry:
            mesh = getattr(thing, "data", thing)
            any_changed |= _keys.pop(getattr(mesh, "session_uid", 0), None) is not None
        if isinstance(thing, bpy.types.Mesh):
            note_change(thing.session_uid)  # what is selected changes no geometry
        any_changed |= is_twin(thing) if hasattr(thing, "type") else False
    return any_changed


def forget_twins() -> None:
    """Reads all meshes again, as when another file is loaded."""
    _keys.clear()


def _key(twin: Any, server: TwinStore, fresh: bool) -> str | None:
    """The key of a twin's present state; None where its attributes are not those of a twin."""
    mesh = twin.data
    known = _keys.get(mesh.session_uid)
    if known is not None and not fresh and (not known or server.has(known)):
        return known
    content = content_of(mesh, mesh.session_uid, int(twin[TWIN]))
    if content is None:
        _keys[mesh.session_uid] = ""
        return None
    server.put(*content)
    _keys[mesh.session_uid] = content[0].key
    return content[0].key


def _placed(thing: Any, key: str, depsgraph: Any) -> PlacedTwin:
    world = np.array(thing.matrix_world, np.float64)
    modifier = splat_modifier(thing)
    if modifier is None:
        return PlacedTwin(key, _row(matrix_to_engine(world)))
    most, box = splat_value(modifier, COUNT_INPUT), splat_value(modifier, BOX_INPUT)
    inside = None
    if splat_value(modifier, CROP_INPUT) and box is not None:
        cube = np.array(box.evaluated_get(depsgraph).matrix_world, np.float64)
        # (a box without volume holds nothing)
        inside = _row(np.linalg.inv(cube) @ world if abs(np.linalg.det(cube)) > 0 else np.diag([1e30, 1e30, 1e30, 1.0]))
    return PlacedTwin(
        key,
        _row(matrix_to_engine(world)),
        size=1.0 if (size := splat_value(modifier, SIZE_INPUT)) is None else float(size),
        faintest=float(splat_value(modifier, THRESHOLD_INPUT) or 0.0),
        most=None if most is None else max(0, int(most)),
        box=inside,
    )


def _row(matrix: Any) -> tuple[float, ...]:
    return tuple(float(value) for value in np.asarray(matrix).reshape(16))
