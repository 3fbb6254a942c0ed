"""From a twin to a mesh: what its cameras see, fused, meshed, cleaned, thinned out and coloured."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from ..camera import Camera
from ..compiled import run
from ..errors import Cancelled, DgsError
from ..gaussians import Gaussians
from ..numbers import number
from ..progress import Progress
from ..training.scale import twin_scale
from ..triangles import Mesh
from .cleaning import decimated, face_areas, without_crumbs
from .colour_kernels import gather_colours
from .marching import zero_surface
from .matching import Matching, matched_surfaces
from .surfaces import SeenSurface, seen_surfaces
from .texturing import Painted, painted
from .unwrapping import check_unwrapping, unwrapped
from .volume import Volume, flattened, fused, usual_voxel


@dataclass(frozen=True)
class MeshSettings:
    """What a user may ask of a mesh.

    Attributes:
        matching: where its depths come from, see `matched_surfaces`.
    """

    detail: float = number(1.0, "px", "side of a voxel: of a px on the surface, in the middle of all views")
    faces: int | None = number(None, "count", "at most; as many as there are if 0; the next two if not given")
    coloured_faces: int = number(500_000, "count", "whose corners carry the colours: detail of both is lost together")
    textured_faces: int = number(50_000, "count", "where a texture carries the colours, and faces the shape alone")
    views: int = number(60, "count", "cameras at most, evenly chosen: more of them hardly see anything else")
    texture: int = number(0, "texels", "side of the texture; 0: corners have colours, and there is none")
    matching: Matching = "filled"

    @property
    def most_faces(self) -> int:
        """What is left of the faces at most; 0: all."""
        usual = self.textured_faces if self.texture else self.coloured_faces
        return usual if self.faces is None else self.faces


@dataclass(frozen=True)
class TwinMesh:
    """A twin's surface.

    Attributes:
        mesh: with colours and deviations.
        voxel: side of a voxel, world units; pixel: size of a px on the surface, in the middle of all views.
        far: share of what cameras see that is too far off for voxels of this size.
        made: faces before they were thinned out.
        texel: side of a texel on the surface, world units; unseen: share of the texels that no view shows. 0 without.
        agreed: share of what cameras see where views agree on the surface; 1 where that was not asked.
    """

    mesh: Mesh
    voxel: float
    pixel: float
    far: float
    made: int
    texel: float = 0.0
    unseen: float = 0.0
    agreed: float = 1.0


def build_mesh(gaussians: Gaussians, cameras: Sequence[Camera], settings: MeshSettings, progress: Progress) -> TwinMesh:
    """A mesh of what the cameras see of a twin.

    Args:
        gaussians: on the CPU; cameras: that it was trained on, in the same world.

    Raises:
        DgsError: there is no surface. OutputError: nothing that makes textures is installed.
        Cancelled: the user asked to stop.
    """
    if settings.texture:
        check_unwrapping()
    if not len(gaussians):
        raise DgsError("The twin holds no Gaussians", "Reconstruct it first")
    chosen = np.unique(np.linspace(0, len(cameras) - 1, min(len(cameras), settings.views)).round().astype(int))
    scale = twin_scale(cameras, gaussians.means.detach().numpy())
    unit = [scale.camera_to_unit(cameras[index]) for index in chosen]
    surfaces = seen_surfaces(scale.to_unit(gaussians), unit, progress)
    pixel = usual_voxel(surfaces)
    surfaces, agreed = matched_surfaces(surfaces, settings.matching, progress)
    progress.stage("fuse")
    volume = fused(surfaces, settings.detail * pixel)
    _go_on(progress)
    progress.stage("mesh")
    whole = without_crumbs(zero_surface(volume), volume.voxel)
    if not len(whole.faces):
        raise DgsError("The cameras see no surface that hangs together", "Train longer, or give more photos")
    _go_on(progress)
    made = len(whole.faces)
    if settings.most_faces:
        whole = decimated(whole, settings.most_faces)
    _go_on(progress)
    progress.stage("colour")
    deviation = np.asarray(_deviations(whole, volume) * np.float32(scale.size))
    colours = _colours(whole, surfaces, volume)
    painting, texel = _texture(whole, surfaces, volume.voxel, settings.texture, progress)
    texture, unseen = (painting.texture, painting.unseen) if painting is not None else (None, 0.0)
    mesh = Mesh(whole.vertices * scale.size + scale.origin, whole.faces, colours, deviation, texture)
    voxel, pixel, texel = (length * scale.size for length in (volume.voxel, pixel, texel))
    return TwinMesh(mesh, voxel, pixel, volume.far, made, texel, unseen, agreed)


def _go_on(progress: Progress) -> None:
    if progress.cancelled():
        raise Cancelled("Stopped while the mesh was made; nothing was written")


def _texture(
    mesh: Mesh, surfaces: Sequence[SeenSurface], voxel: float, size: int, progress: Progress
) -> tuple[Painted | None, float]:
    """A texture of `size` texels, None if that is 0; and the side of a texel in the mesh's unit, in the mean."""
    if not size:
        return None, 0.0
    progress.stage("unwrap")
    charts = unwrapped(mesh, size)
    _go_on(progress)
    progress.stage("texture")
    covered = max(float(charts.areas().sum()), 1e-12) * size**2
    return painted(mesh, charts, size, surfaces, voxel), float(np.sqrt(face_areas(mesh).sum() / covered))


def _colours(mesh: Mesh, surfaces: Sequence[SeenSurface], volume: Volume) -> NDArray[np.uint8]:
    """[N, 3] what the views show at the corners; where none does, the nearest corner's that one shows."""
    views = flattened(surfaces)
    images = np.concatenate([s.image.reshape(3, -1).T for s in surfaces])
    colours, total = np.empty((len(mesh.vertices), 3), np.float32), np.empty(len(mesh.vertices), np.float32)
    near = np.full(len(mesh.vertices), 2.0 * volume.voxel)
    for _ in range(4):  # where surfaces disagree more, those that come nearest
        run(
            gather_colours,
            len(mesh.vertices),
            np.ascontiguousarray(mesh.vertices),
            views.depths,
            views.weights,
            images,
            views.starts,
            views.sizes,
            views.poses,
            views.lenses,
            near,
            colours,
            total,
            grain=256,
        )
        if (total > 0).all():
            break
        near = np.where(total > 0, near, near * 3.0)
    return np.round(colours.clip(0.0, 1.0) * 255).astype(np.uint8)


def _deviations(mesh: Mesh, volume: Volume) -> NDArray[np.float32]:
    """[N] standard deviation of the views' surfaces about the mesh at its corners, world units."""
    where = volume.places()
    voxel = np.round((mesh.vertices - volume.low) / volume.voxel - 0.5).astype(np.int64)
    block, inside = voxel // volume.side, voxel % volume.side
    limits = np.array(where.shape) - 1
    index = where[tuple(np.minimum(np.maximum(block, 0), limits).T)]
    at = (index, *inside.T)
    variance = volume.squares[at] - volume.values[at] ** 2
    known = (index >= 0) & (volume.weights[at] > 0)
    usual = float(np.median(variance[known])) if known.any() else 1.0
    spread = np.sqrt(np.maximum(np.where(known, variance, usual), 0.0))
    return np.asarray(spread * volume.voxel, np.float32)
