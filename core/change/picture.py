"""The surface coloured by what has become of it: for a mesh, and as a picture from a few cameras."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import PolyCollection
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Patch
from numpy.typing import NDArray

from ..camera import Camera
from ..evaluation.poses import Similarity
from ..triangles import Mesh
from .evidence import Array
from .findings import Changes, Region
from .settings import PICTURE
from .surface import Surface

#: sRGB of what has no size; motions have the colour bar's.
COLOURS = {"vanished": (214, 39, 40), "appeared": (44, 160, 44), "repainted": (148, 103, 189)}
_SIZES = colormaps["viridis"]


def coloured(found: Changes, first: Surface, second: Surface) -> Mesh:
    """The first surface in pale colours, changed places in strong ones, and what is new of the second beside it."""
    mesh = first.mesh
    colours = _pale(mesh)
    colours[~found.held] = PICTURE.unseen
    sizes, most = _sizes(found, first), largest(found, first)
    for region in found.regions:
        if not region.after:
            colours[region.places] = _colour(region, sizes[region.places], most)
    parts = [Mesh(mesh.vertices, mesh.faces, colours)]
    parts += [_new(second.mesh, region, found.alignment.similarity) for region in found.regions if region.after]
    return _joined(parts)


def largest(found: Changes, first: Surface) -> float:
    """The end of the colour bar, in the unit of lengths: what hardly a moved place exceeds."""
    sizes = _sizes(found, first)
    moved = [sizes[r.places] for r in found.regions if not r.after and r.kind not in COLOURS]
    return float(np.quantile(np.concatenate(moved), PICTURE.quantile)) if moved else 1.0


def legend(found: Changes, first: Surface) -> dict[str, Any]:
    """For JSON: sRGB of each kind and of what is unseen; those of the colour bar, from 0 to `up_to`."""
    bar = [_moved_colour(step).tolist() for step in np.linspace(0.0, 1.0, PICTURE.steps)]
    moved = {"up_to": largest(found, first), "unit": found.unit, "bar": bar}
    return {**{kind: list(colour) for kind, colour in COLOURS.items()}, "unseen": list(PICTURE.unseen), "moved": moved}


def _sizes(found: Changes, first: Surface) -> Array:
    """[N] how far each place has moved, in the unit of lengths."""
    return np.asarray(found.size * found.in_unit(first.places.pixel))


def _pale(mesh: Mesh) -> NDArray[np.uint8]:
    own = np.full((len(mesh.vertices), 3), 128.0) if mesh.colours is None else mesh.colours.astype(np.float64)
    grey = own.mean(axis=1, keepdims=True).repeat(3, axis=1)
    return np.asarray(np.round(255.0 - (255.0 - grey) * PICTURE.pale), np.uint8)


def _colour(region: Region, sizes: Array, most: float) -> NDArray[np.uint8]:
    if region.kind in COLOURS:
        return np.array(COLOURS[region.kind], np.uint8)
    return _moved_colour(sizes / most)


def _moved_colour(share: float | Array) -> NDArray[np.uint8]:
    """[..., 3] of the colour bar."""
    return np.asarray(np.round(255 * np.asarray(_SIZES(np.clip(share, 0.0, 1.0)))[..., :3]), np.uint8)


def _new(mesh: Mesh, region: Region, world: Similarity) -> Mesh:
    """A region of the second mesh in the first world."""
    inside = np.zeros(len(mesh.vertices), bool)
    inside[region.places] = True
    part = Mesh(world.points(mesh.vertices), mesh.faces).with_faces(mesh.faces[inside[mesh.faces].all(axis=1)])
    colours = np.tile(np.array(COLOURS[region.kind], np.uint8), (len(part.vertices), 1))
    return Mesh(part.vertices, part.faces, colours)


def _joined(parts: Sequence[Mesh]) -> Mesh:
    starts = np.cumsum([0, *(len(part.vertices) for part in parts)])
    faces = [part.faces + start for part, start in zip(parts, starts[:-1], strict=True)]
    colours = np.concatenate([part.colours for part in parts if part.colours is not None])
    return Mesh(np.concatenate([part.vertices for part in parts]), np.concatenate(faces), colours)


def draw(path: Path, mesh: Mesh, first: Surface, found: Changes, title: str) -> None:
    """Writes a PNG of the coloured mesh from some of the first twin's cameras, with a colour bar."""
    cameras = first.cameras
    chosen = [
        cameras[index] for index in np.unique(np.linspace(0, len(cameras) - 1, PICTURE.views).round().astype(int))
    ]
    figure = Figure(figsize=(5.0 * len(chosen) + 1.2, 4.4), layout="constrained")
    panels = figure.subplots(1, len(chosen), squeeze=False)[0]
    for panel, camera in zip(panels, chosen, strict=True):
        _panel(panel, mesh, camera)
    sizes = ScalarMappable(Normalize(0.0, largest(found, first)), _SIZES)
    figure.colorbar(sizes, ax=list(panels), label=f"moved by, {found.unit}", shrink=0.8)
    patches = [Patch(color=np.array(colour) / 255, label=kind) for kind, colour in COLOURS.items()]
    patches.append(Patch(color=np.array(PICTURE.unseen) / 255, label="not enough photos"))
    figure.legend(handles=patches, loc="outside lower center", ncols=len(patches), fontsize=8)
    figure.suptitle(title, fontsize=10)
    figure.savefig(path, dpi=100, format="png")


def _panel(panel: Any, mesh: Mesh, camera: Camera) -> None:
    """Faces as a camera sees them, the farthest first."""
    at, depth = camera.projected(mesh.vertices)
    faces = mesh.faces[(depth[mesh.faces] > 0).all(axis=1)]
    faces = faces[np.argsort(-depth[faces].mean(axis=1))]
    assert mesh.colours is not None
    shades = mesh.colours[faces].mean(axis=1) / 255.0
    panel.add_collection(PolyCollection(list(at[faces]), facecolors=shades, edgecolors=shades, linewidths=0.3))
    panel.set(xlim=(0, camera.width), ylim=(camera.height, 0), xticks=[], yticks=[], aspect="equal")
    panel.set_title(camera.name, fontsize=8)
