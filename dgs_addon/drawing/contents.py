"""What the picture server gets of a twin's mesh: its points that are not hidden, those that are selected tinted."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.constants import SH_C0, SH_COEFFICIENTS
from ...core.serving.messages import SharedTwin
from ..scene.known import KNOWN
from ..scene.reading import read_flags
from ..scene.twin import BASE, OWN_BASE, fields_of

#: Selected splats: an orange as Blender's own, and how much of it is in their colour.
_SELECTED, _TINT = np.array([1.0, 0.47, 0.05], np.float32), np.float32(0.65)


def content_of(
    mesh: Any, number: int, harmonics: int, tinted: bool = False, whole: bool = False
) -> tuple[SharedTwin, bytes] | None:
    """What `PictureServer.put` takes; None where the attributes are not those of a twin, or nothing is left to be seen.

    Args:
        mesh: of `readable`; number: the twin's mesh's own in this session, which the key begins with.
        harmonics: of a Gaussian.
        tinted: show which points are selected.
        whole: hidden points, too, in the twin's own colours where others are shown.
    """
    fields = fields_of(harmonics, OWN_BASE if whole and OWN_BASE in mesh.attributes else BASE)
    count = len(mesh.vertices)
    attributes = [mesh.attributes.get(name) for name, _, _ in fields]
    if harmonics not in SH_COEFFICIENTS or not count or any(a is None or len(a.data) != count for a in attributes):
        return None
    shape = SharedTwin("", count, harmonics)
    values = bytearray(shape.bytes)
    planes = shape.planes(memoryview(values))
    for plane, attribute, (_, field, _) in zip(planes, attributes, fields, strict=True):
        if not hasattr(attribute.data[0], field):
            return None
        attribute.data.foreach_get(field, plane.reshape(-1))
    if tinted:
        _tint(planes, read_flags(mesh, "select"))
    hidden = read_flags(mesh, "hide")
    if hidden.any() and not whole:
        shape = SharedTwin("", count - int(hidden.sum()), harmonics)
        if not shape.count:
            return None
        values = _part(planes, ~hidden, shape)
    content = bytes(values)
    return SharedTwin(f"{number}-{zlib.crc32(content)}", shape.count, harmonics), content


def guessed_of(mesh: Any, number: int, harmonics: int) -> tuple[SharedTwin, bytes] | None:
    """As `content_of`, in grey: black where photos fix a splat's colour, white where they say nothing.

    White, too, where nobody asked (see `scene.known`).
    """
    content = content_of(mesh, number, harmonics)
    if content is None:
        return None
    twin, values = content
    shape = SharedTwin("", twin.count, 1)
    grey = bytearray(values[: shape.bytes])
    known = np.zeros(len(mesh.vertices), np.float32)
    attribute = mesh.attributes.get(KNOWN)
    if attribute is not None and len(attribute.data) == len(known) and hasattr(attribute.data[0], "value"):
        attribute.data.foreach_get("value", known)
    known = known[~read_flags(mesh, "hide")]
    shape.planes(memoryview(grey))[3][:, :3] = ((0.5 - known.clip(0.0, 1.0)) / SH_C0)[:, None]
    return SharedTwin(f"guessed {number}-{zlib.crc32(grey)}", twin.count, 1), bytes(grey)


def _tint(planes: Sequence[NDArray[np.float32]], selected: NDArray[np.bool_]) -> None:
    base = planes[3]
    base[selected, :3] += _TINT * ((_SELECTED - 0.5) / np.float32(SH_C0) - base[selected, :3])
    for rest in planes[4:]:
        rest[selected] *= 1 - _TINT


def _part(planes: Sequence[NDArray[np.float32]], kept: NDArray[np.bool_], shape: SharedTwin) -> bytearray:
    values = bytearray(shape.bytes)
    for part, whole in zip(shape.planes(memoryview(values)), planes, strict=True):
        part[:] = whole[kept]
    return values
