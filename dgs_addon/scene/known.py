"""What the photos determine of a twin and what is guessed, as an attribute and as colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.constants import SH_C0
from ...core.errors import FormatError
from ...core.npy import load_npy
from .twin import BASE, OWN_BASE

#: Point attribute: 1 where the photos fix a splat's colour, 0 where it is guessed.
KNOWN = "known"
#: sRGB colours of guessed, half determined and determined splats (colour-blind eyes distinguish them too).
RAMP = np.array([[0.84, 0.19, 0.15], [0.95, 0.90, 0.60], [0.13, 0.44, 0.71]], np.float32)


def add_known(twin: Any, path: Path) -> None:
    """Gives the twin's mesh the attribute `known` (float in 0..1 per point) from a file of `next-view`.

    Args:
        twin: `bpy` object of a twin; path: known.npy beside its twin.ply.

    Raises:
        FormatError: no such file, damaged, or of another twin.
    """
    if not path.is_file():
        raise FormatError(f"There is no '{path}'", "Press Suggest Next Views first")
    try:
        values = load_npy(path)
    except (OSError, ValueError) as error:
        raise FormatError(f"'{path}' is damaged", "Press Suggest Next Views again") from error
    if values.shape != (len(twin.data.vertices),):
        raise FormatError(f"'{path}' belongs to another state of the twin", "Press Suggest Next Views again")
    mesh = twin.data
    attribute = mesh.attributes.get(KNOWN) or mesh.attributes.new(KNOWN, "FLOAT", "POINT")
    attribute.data.foreach_set("value", np.ascontiguousarray(values, np.float32))
    mesh.update()


def show_known(twin: Any, on: bool) -> None:
    """Paints the splats by how far photos determine them (red guessed, blue determined), or in their own colours.

    The twin's own colours are kept beside; exports always write those.
    """
    mesh = twin.data
    count = len(mesh.vertices)
    base = _read(mesh, BASE, count)
    if on:
        if OWN_BASE not in mesh.attributes:
            mesh.attributes.new(OWN_BASE, "FLOAT_COLOR", "POINT").data.foreach_set("color", base.reshape(-1))
        known = np.empty(count, np.float32)
        mesh.attributes[KNOWN].data.foreach_get("value", known)
        ramp = [np.interp(known, [0.0, 0.5, 1.0], RAMP[:, channel]) for channel in range(3)]
        base[:, :3] = (np.stack(ramp, axis=1) - 0.5) / SH_C0
        mesh.attributes[BASE].data.foreach_set("color", base.reshape(-1))
    elif OWN_BASE in mesh.attributes:
        mesh.attributes[BASE].data.foreach_set("color", _read(mesh, OWN_BASE, count).reshape(-1))
        mesh.attributes.remove(mesh.attributes[OWN_BASE])
    mesh.update()


def _read(mesh: Any, name: str, count: int) -> NDArray[np.float32]:
    values = np.empty(count * 4, np.float32)
    mesh.attributes[name].data.foreach_get("color", values)
    return values.reshape(count, 4)
