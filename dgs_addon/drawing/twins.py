"""The twins of a scene as the picture server takes them."""

from __future__ import annotations

import zlib
from typing import Any

import numpy as np

from ...core.constants import SH_C0, SH_COEFFICIENTS
from ...core.errors import FormatError
from ...core.serving.messages import PlacedTwin, SharedTwin
from ..axes import matrix_to_engine
from ..scene.known import KNOWN
from ..scene.nodes import BOX_INPUT, COUNT_INPUT, CROP_INPUT, SIZE_INPUT, THRESHOLD_INPUT, splat_modifier, splat_value
from ..scene.twin import BASE, OWN_BASE, ROTATION, SCALE, TWIN, harmonic, is_twin
from .picture_server import PictureServer

#: Where attributes keep their numbers, in the order of `SharedTwin.planes`.
_FIELDS = (("position", "vector"), (SCALE, "vector"), (ROTATION, "value"), (BASE, "color"))

#: Keys of the meshes that were read, by their number in this session: they hold until the mesh changes.
_keys: dict[int, str] = {}


def placed_twins(
    depsgraph: Any, server: PictureServer, space: Any = None, fresh: bool = False
) -> tuple[PlacedTwin, ...]:
    """The twins that are to be seen, handed over to the server where it has not got them.

    Args:
        depsgraph: of the picture; its mode says what is visible.
        space: the 3D view that they are drawn in, which may hide some; None for a final picture.
        fresh: read meshes again even if nobody said that they had changed.
    """
    placed = []
    for thing in depsgraph.objects:
        if is_twin(thing) and (space is None or thing.original.visible_in_viewport_get(space)):
            key = _key(thing.original, server, fresh)
            if key is not None:
                placed.append(_placed(thing, key, depsgraph))
    return tuple(placed)


def whole_twin(twin: Any, server: PictureServer) -> PlacedTwin:
    """A twin in its own axes and colours, with all its splats, whatever the scene shows of it.

    Raises:
        FormatError: its attributes are not those of a twin.
    """
    content = None if twin.data.is_editmode else _content(twin.data, int(twin[TWIN]), own_colours=True)
    if content is None:
        raise FormatError(f"'{twin.name}' cannot be read as splats", "Leave Edit Mode, or add the twin anew")
    server.put(*content)
    return PlacedTwin(content[0].key, _row(np.eye(4)))


def guessed_twins(depsgraph: Any, server: PictureServer) -> tuple[PlacedTwin, ...]:
    """The twins of a final picture in grey: black where photos fix a splat's colour, white where they say nothing.

    White, too, where nobody asked (see `scene.known`). Read anew each time.
    """
    placed = []
    for thing in depsgraph.objects:
        content = _guessed_content(thing.original.data, int(thing[TWIN])) if is_twin(thing) else None
        if content is not None:
            server.put(*content)
            placed.append(_placed(thing, content[0].key, depsgraph))
    return tuple(placed)


def changed_twins(depsgraph: Any) -> bool:
    """Notes which meshes have changed; True if any twin did, or moved, or may be seen differently."""
    any_changed = False
    for update in depsgraph.updates:
        thing = update.id
        if update.is_updated_geometry:
            mesh = getattr(thing, "data", thing)
            any_changed |= _keys.pop(getattr(mesh, "session_uid", 0), None) is not None
        any_changed |= is_twin(thing) if hasattr(thing, "type") else False
    return any_changed


def forget_twins() -> None:
    """Reads all meshes again, as when another file is loaded."""
    _keys.clear()


def _key(twin: Any, server: PictureServer, fresh: bool) -> str | None:
    """The key of a twin's present state; None where its attributes are not those of a twin."""
    mesh = twin.data
    known = _keys.get(mesh.session_uid)
    if mesh.is_editmode or (known is not None and not fresh and server.has(known)):
        return known  # (while it is edited its attributes cannot be read)
    content = _content(mesh, int(twin[TWIN]))
    if content is None:
        return None
    shared, values = content
    if not server.has(shared.key):
        server.put(shared, values)
    _keys[mesh.session_uid] = shared.key
    return shared.key


def _content(mesh: Any, harmonics: int, own_colours: bool = False) -> tuple[SharedTwin, bytes] | None:
    fields = [*_FIELDS[:-1], (OWN_BASE if own_colours and OWN_BASE in mesh.attributes else BASE, "color")]
    fields += [*((harmonic(index), "vector") for index in range(harmonics - 1))]
    count = len(mesh.vertices)
    attributes = [mesh.attributes.get(name) for name, _ in fields]
    if harmonics not in SH_COEFFICIENTS or not count or any(a is None or len(a.data) != count for a in attributes):
        return None
    shape = SharedTwin("", count, harmonics)
    values = bytearray(shape.bytes)
    for plane, attribute, (_, field) in zip(shape.planes(memoryview(values)), attributes, fields, strict=True):
        if not hasattr(attribute.data[0], field):
            return None
        attribute.data.foreach_get(field, plane.reshape(-1))
    content = bytes(values)
    return SharedTwin(f"{mesh.session_uid}-{zlib.crc32(content)}", count, harmonics), content


def _guessed_content(mesh: Any, harmonics: int) -> tuple[SharedTwin, bytes] | None:
    content = _content(mesh, harmonics)
    if content is None:
        return None
    twin, values = content
    shape = SharedTwin("", twin.count, 1)
    grey = bytearray(values[: shape.bytes])
    known = np.zeros(twin.count, np.float32)
    attribute = mesh.attributes.get(KNOWN)
    if attribute is not None and len(attribute.data) == twin.count and hasattr(attribute.data[0], "value"):
        attribute.data.foreach_get("value", known)
    shape.planes(memoryview(grey))[3][:, :3] = ((0.5 - known.clip(0.0, 1.0)) / SH_C0)[:, None]
    return SharedTwin(f"guessed {mesh.session_uid}-{zlib.crc32(grey)}", twin.count, 1), bytes(grey)


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
