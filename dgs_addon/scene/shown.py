"""A twin's Gaussians as they are seen in the scene: what its box and limits leave of them, and where it stands."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.cloud import GaussianCloud, cloud_part
from ...core.errors import FormatError
from ...core.formats.turning import moved
from ..axes import matrix_to_blender, matrix_to_engine
from .crop import crop_box
from .nodes import COUNT_INPUT, CROP_INPUT, FAINTEST, SIZE_INPUT, THRESHOLD_INPUT, splat_modifier, splat_value
from .reading import read_flags, readable

#: Scales along the axes that differ by no more than this share are one: Blender's matrices have 32 bits.
_EVEN = 1e-4
#: A twin that stands no farther than this from where it came from has not been moved: the same reason.
_STILL = 1e-5


def shown_part(twin: Any, cloud: GaussianCloud) -> GaussianCloud:
    """What a final render shows of a twin's Gaussians, at the size that it shows them: as `nodes` has it.

    Args:
        twin: `bpy` object; its modifier says what is shown.
        cloud: its Gaussians, as `read_twin` reads them.

    Raises:
        FormatError: nothing is shown.
    """
    kept = shown_rows(twin, cloud)
    modifier = splat_modifier(twin)
    size = splat_value(modifier, SIZE_INPUT) if modifier is not None else None
    if not len(kept) or size == 0.0:
        raise FormatError(f"'{twin.name}' shows no splat", "Change its display, or export all of it")
    part = cloud_part(cloud, kept)
    return part if size is None else replace(part, log_scales=part.log_scales + np.float32(np.log(size)))


def shown_rows(twin: Any, cloud: GaussianCloud) -> NDArray[np.intp]:
    """[M] which of a twin's Gaussians a final render shows, whatever their size."""
    kept = np.flatnonzero(~_hidden(twin) & _inside(twin, cloud))
    modifier = splat_modifier(twin)
    if modifier is None:
        return kept
    most = splat_value(modifier, COUNT_INPUT)
    share = min(most / len(kept), 1.0) if most is not None and len(kept) else 1.0
    index = np.arange(len(kept))
    kept = kept[np.floor((index + 1) * share) > np.floor(index * share)]
    return kept[_opacity(cloud)[kept] >= (splat_value(modifier, THRESHOLD_INPUT) or 0.0)]


def placed(twin: Any, cloud: GaussianCloud) -> GaussianCloud:
    """The Gaussians where the twin stands in Blender's world, at its size, in the engine's axes: -y is up.

    Raises:
        FormatError: the twin is mirrored, or its axes are scaled differently.
    """
    return moved(cloud, *similarity(twin, matrix_to_engine(_world(twin))))


def similarity(twin: Any, matrix: NDArray[np.float64]) -> tuple[NDArray[np.float64], float, NDArray[np.float64]]:
    """The rotation [3, 3], the size and the place [3] that a matrix [4, 4] gives a twin.

    Raises:
        FormatError: the matrix mirrors, or scales axes differently.
    """
    left, sizes, right = np.linalg.svd(matrix[:3, :3])
    if sizes[0] - sizes[-1] > _EVEN * sizes[0] or np.linalg.det(matrix[:3, :3]) <= 0.0:
        raise FormatError(
            f"'{twin.name}' is mirrored, or not scaled alike along all axes", "Set its scale to one positive number"
        )
    return left @ right, float(sizes.mean()), matrix[:3, 3]


def is_limited(twin: Any, cloud: GaussianCloud) -> bool:
    """Whether a final render shows less than all Gaussians, or shows them larger or smaller."""
    modifier = splat_modifier(twin)
    if _hidden(twin).any():
        return True
    if modifier is None:
        return False
    most, faintest = splat_value(modifier, COUNT_INPUT), splat_value(modifier, THRESHOLD_INPUT) or 0.0
    return (
        not _inside(twin, cloud).all()
        or bool((faintest > FAINTEST) & (_opacity(cloud) < faintest).any())
        or splat_value(modifier, SIZE_INPUT) not in (None, 1.0)
        or (most is not None and most < len(cloud))
    )


def is_moved(twin: Any) -> bool:
    """Whether the twin got a size, an up direction or another place in the scene."""
    return not np.allclose(_world(twin), matrix_to_blender(np.eye(4)), rtol=0.0, atol=_STILL)


def _hidden(twin: Any) -> NDArray[np.bool_]:
    with readable(twin) as mesh:
        return read_flags(mesh, "hide")


def _inside(twin: Any, cloud: GaussianCloud) -> NDArray[np.bool_]:
    """[N] whether each centre lies in the twin's box, if it has one that counts."""
    modifier, box = splat_modifier(twin), crop_box(twin)
    if modifier is None or box is None or not splat_value(modifier, CROP_INPUT):
        return np.ones(len(cloud), bool)
    cube = np.array(box.matrix_world, dtype=np.float64)
    if abs(np.linalg.det(cube)) == 0.0:
        return np.zeros(len(cloud), bool)
    into = np.linalg.inv(cube) @ _world(twin)
    places = cloud.means.astype(np.float64) @ into[:3, :3].T + into[:3, 3]
    inside: NDArray[np.bool_] = (np.abs(places) <= 1.0).all(axis=1)
    return inside


def _opacity(cloud: GaussianCloud) -> NDArray[np.float64]:
    opacity: NDArray[np.float64] = 1.0 / (1.0 + np.exp(-cloud.opacity_logits.astype(np.float64)))
    return opacity


def _world(twin: Any) -> NDArray[np.float64]:
    return np.array(twin.matrix_world, dtype=np.float64)
