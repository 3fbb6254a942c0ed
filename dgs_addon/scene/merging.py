"""Twins that are moved for good: transforms become part of the splats, and several twins one.

Centres, shapes and harmonics are turned, scaled and moved together, so that a picture shows what it showed before.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from mathutils import Matrix
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud, finite_rows, joined
from ...core.errors import FormatError
from ...core.formats.turning import moved
from ..axes import matrix_to_blender
from .hiding import hide
from .known import KNOWN, show_known
from .nodes import (
    COUNT_INPUT,
    CROP_INPUT,
    SIZE_INPUT,
    THRESHOLD_INPUT,
    UNLIMITED,
    set_splat_input,
    splat_input,
    splat_modifier,
    splat_nodes,
    splat_value,
)
from .reading import read_flags, read_integers, read_values
from .removal import remove_unused
from .shown import shown_rows, similarity
from .sources import Source, moved_sources, read_sources, rows_of, write_sources
from .twin import ROW, TWIN, glossy, read_twin, splat_mesh

_REST = matrix_to_blender(np.eye(4))
#: Row of a splat that came from no file that is known.
_NOWHERE = -1
#: Size of splats that a modifier shows at size 0: they are hidden.
_LEAST_SIZE = 1e-6


def apply_transform(twin: Any) -> None:
    """Makes where a twin stands, its turn and its size part of its splats; it stays as it is seen, as do its children.

    Args:
        twin: `bpy` object, in Object Mode. Linked duplicates keep their own mesh.

    Raises:
        FormatError: the twin is mirrored, or its axes are scaled differently.
    """
    part = _part(twin, np.linalg.inv(_REST) @ np.array(twin.matrix_world, np.float64))
    children = [(child, child.matrix_world.copy()) for child in twin.children]
    _show_parts(twin, [part])
    twin.matrix_world = Matrix(_REST.tolist())
    for child, world in children:
        _hang(child, twin, world)


def merge(target: Any, others: list[Any]) -> None:
    """Takes the splats of other twins into one, where they stand; what a twin does not show is hidden in it.

    Crop boxes, limits and sizes of splats become part of the splats, too. Cameras and all else that hangs on the others
    hangs on the target then; the others themselves stay, for whoever asks to take them out.

    Raises:
        FormatError: one of them is mirrored, or its axes are scaled differently against the target's.
    """
    twins = [target, *others]
    faintest = min(_input(twin, THRESHOLD_INPUT, 0.0) for twin in twins)
    back = np.linalg.inv(np.array(target.matrix_world, np.float64))
    parts = [_as_shown(_part(twin, back @ np.array(twin.matrix_world, np.float64)), twin, faintest) for twin in twins]
    _show_parts(target, parts)
    modifier = splat_modifier(target)
    for name, value in ((CROP_INPUT, False), (THRESHOLD_INPUT, faintest), (COUNT_INPUT, UNLIMITED), (SIZE_INPUT, 1.0)):
        if modifier is not None and splat_input(modifier, name) is not None:
            set_splat_input(modifier, name, value)
    for other in others:
        for child in other.children:
            _hang(child, target, child.matrix_world.copy())


@dataclass(frozen=True)
class _Part:
    """One twin's splats in the axes of all: N of them, and what belongs to each."""

    cloud: GaussianCloud
    hidden: NDArray[np.bool_]
    rows: NDArray[np.int32] | None
    known: NDArray[np.float32] | None
    sources: list[Source]


def _part(twin: Any, matrix: NDArray[np.float64]) -> _Part:
    show_known(twin, False)
    mesh = twin.data
    sources = read_sources(mesh) if ROW in mesh.attributes else []
    return _Part(
        moved(read_twin(twin), *similarity(twin, matrix)),
        read_flags(mesh, "hide"),
        read_integers(mesh, ROW) if sources else None,
        read_values(mesh, KNOWN, "value", 1)[:, 0] if KNOWN in mesh.attributes else None,
        moved_sources(sources, matrix),
    )


def _as_shown(part: _Part, twin: Any, faintest: float) -> _Part:
    """With what the twin does not show hidden, but for splats that are fainter than the limit that all have."""
    shown = np.zeros(len(part.cloud), bool)
    shown[shown_rows(twin, read_twin(twin))] = True
    faint = 1.0 / (1.0 + np.exp(-part.cloud.opacity_logits.astype(np.float64))) < faintest
    size = _input(twin, SIZE_INPUT, 1.0)
    larger = replace(part.cloud, log_scales=part.cloud.log_scales + np.float32(np.log(max(size, _LEAST_SIZE))))
    return replace(part, cloud=larger, hidden=part.hidden | ~(shown | faint))


def _show_parts(twin: Any, parts: list[_Part]) -> None:
    """Shows them instead of the twin's own mesh."""
    cloud = joined([part.cloud for part in parts])
    if not finite_rows(cloud).all():
        raise FormatError(f"Splats of '{twin.name}' would lie nowhere", "Give it another size or place")
    before, name = twin.data, twin.data.name
    mesh = splat_mesh(cloud, name)
    rows, sources = [], list[Source]()
    for part in parts:
        first = rows_of(sources)
        rows.append(np.full(len(part.cloud), _NOWHERE, np.int32) if part.rows is None else part.rows + np.int32(first))
        sources += [replace(source, first=source.first + first) for source in part.sources]
    mesh.attributes[ROW].data.foreach_set("value", np.concatenate(rows))
    write_sources(mesh, sources)
    known = [part.known for part in parts if part.known is not None]
    if len(known) == len(parts):
        mesh.attributes.new(KNOWN, "FLOAT", "POINT").data.foreach_set("value", np.concatenate(known))
    hide(mesh, np.concatenate([part.hidden for part in parts]))
    twin.data, twin[TWIN] = mesh, int(cloud.sh.shape[1])
    remove_unused(before)
    mesh.name = name
    modifier = splat_modifier(twin)
    if modifier is not None:
        modifier.node_group = splat_nodes(glossy(cloud))


def _input(twin: Any, name: str, default: float) -> float:
    modifier = splat_modifier(twin)
    value = None if modifier is None else splat_value(modifier, name)
    return default if value is None else float(value)


def _hang(child: Any, parent: Any, world: Any) -> None:
    """Makes something hang on a twin, and stand where it is meant to in the world."""
    child.parent = parent
    child.matrix_parent_inverse = parent.matrix_world.inverted()
    child.matrix_basis = world
