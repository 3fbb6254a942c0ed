"""A texture of a mesh: each texel has the colour that the views show there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from ..compiled import run
from ..numbers import number
from ..triangles import Mesh, Texture
from .surfaces import SeenSurface
from .texture_kernels import draw_faces, draw_small_faces, paint
from .unwrapping import Charts
from .volume import flattened


@dataclass(frozen=True)
class TexturingSettings:
    """How texels get their colours."""

    near: float = number(2.0, "voxels", "that a texel may be before or behind what a view sees and yet be on it")
    growth: float = number(3.0, "factor", "that this grows by where no view shows a texel")
    attempts: int = number(4, "count", "of that; the last one takes views from behind, too, as for corners' colours")
    facing: float = number(0.1, "cosine", "between normal and view, at least: thin things have another colour behind")
    spread: float = number(0.1, "sRGB", "of views about their mean: those much farther off are of something else")
    rounds: int = number(3, "count", "of the robust mean, after the plain one")
    unseen: float = number(0.5, "sRGB", "of texels that no view shows: grey, as corners are")


SETTINGS = TexturingSettings()


@dataclass(frozen=True)
class Painted:
    """A texture, and the share of its charts' texels that no view shows."""

    texture: Texture
    unseen: float


def texel_owners(charts: Charts, size: int) -> NDArray[np.int32]:
    """[S, S] the face of each texel, first row on top; -1 between charts."""
    corners, owner = _in_texels(charts, size), np.full((size, size), -1, np.int32)
    drawn = np.zeros(len(corners), np.uint8)
    for kernel in (draw_faces, draw_small_faces):  # in one piece: which of two faces was first decides
        run(kernel, len(corners), corners, drawn, owner, grain=len(corners))
    return owner


def painted(
    mesh: Mesh,
    charts: Charts,
    size: int,
    surfaces: Sequence[SeenSurface],
    voxel: float,
    settings: TexturingSettings = SETTINGS,
) -> Painted:
    """Paints a texture of `size` x `size` texels; what is between charts continues them.

    Args:
        mesh: that was cut into `charts`, in the cameras' world; voxel: that it was made of, world units.
    """
    owner = texel_owners(charts, size)
    texels = np.flatnonzero(owner.reshape(-1) >= 0)
    picture = np.full((size * size, 3), settings.unseen, np.float32)
    seen, views = np.zeros(size * size, np.uint8), flattened(surfaces)
    near = settings.near * voxel * settings.growth ** np.arange(settings.attempts)
    facing = np.full(settings.attempts, settings.facing)
    facing[-1] = -1.0
    run(
        paint,
        len(texels),
        texels,
        owner,
        _in_texels(charts, size),
        np.ascontiguousarray(mesh.vertices[mesh.faces]),
        np.ascontiguousarray(mesh.normals()[mesh.faces]),
        near,
        facing,
        views.depths,
        views.weights,
        np.concatenate([s.image.reshape(3, -1).T for s in surfaces]),
        views.starts,
        views.sizes,
        views.poses,
        views.lenses,
        np.float32(settings.spread),
        settings.rounds,
        picture,
        seen,
        grain=256,
    )
    image = np.round(picture.clip(0.0, 1.0) * 255).astype(np.uint8).reshape(size, size, 3)
    texture = Texture(continued(image, owner >= 0), charts.places, charts.vertices, charts.faces)
    return Painted(texture, 1.0 - float(seen[texels].mean()) if len(texels) else 1.0)


def continued(image: NDArray[np.uint8], known: NDArray[np.bool_]) -> NDArray[np.uint8]:
    """[H, W, 3] with the colour of the nearest known texel where none is known: smaller pictures show no seams, too."""
    if known.all() or not known.any():
        return image
    rows, columns = distance_transform_edt(~known, return_distances=False, return_indices=True)
    return np.asarray(image[rows, columns])


def _in_texels(charts: Charts, size: int) -> NDArray[np.float64]:
    """[M, 3, 2] corners of the faces in texels from the upper left corner."""
    from_above = charts.places * [1.0, -1.0] + [0.0, 1.0]
    return np.ascontiguousarray(from_above[charts.faces] * size)
