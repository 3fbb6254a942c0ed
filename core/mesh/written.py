"""A twin's folder in, the file of a mesh out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import FormatError
from ..files import check_writable
from ..formats.meshes import check_mesh_name, files_of, write_mesh
from ..machine import use_machine
from ..numbers import number
from ..outputs import check_outputs, placing_output, placing_outputs
from ..progress import Progress
from ..triangles import Mesh
from ..twin.seen_by import splats_and_cameras
from .build import MeshSettings, TwinMesh, build_mesh


@dataclass(frozen=True)
class NotingSettings:
    """When something is worth a note."""

    far: float = number(0.01, "share", "of what cameras see that may be too far off without a word")
    coarser: float = number(1.01, "factor", "by which voxels may be larger than asked for without a word")
    texel: float = number(2.0, "px", "on the surface that a texel may be wide without a word: it shows")
    agreed: float = number(0.5, "share", "of what cameras see that they must agree on, or else a word is due")
    unseen: float = number(0.01, "share", "of texels that no view shows that goes without a word")


NOTING = NotingSettings()


def write_twin_mesh(
    folder: Path, out: Path, settings: MeshSettings, *, overwrite: bool, threads: int | None, progress: Progress
) -> dict[str, Any]:
    """Makes the mesh and writes it; returns what is said of it.

    Raises:
        FormatError: no twin folder, damaged, or another ending. OutputError: the file cannot be written.
        DgsError: there is no surface. Cancelled: the user asked to stop.
    """
    if not folder.is_dir():
        raise FormatError(f"There is no folder '{folder}'", "Give the --out folder of 'reconstruct'")
    check_mesh_name(out, bool(settings.texture))
    check_outputs(files_of(out, bool(settings.texture)), [folder / "twin.ply"], overwrite)
    check_writable(out.parent)
    use_machine(threads)
    gaussians, cameras = splats_and_cameras(folder)
    made = build_mesh(gaussians, cameras, settings, progress)
    progress.stage("save")
    _place(out, made.mesh, progress)
    _note(made, settings, progress)
    return {
        "vertices": len(made.mesh.vertices),
        "faces": len(made.mesh.faces),
        "voxel px": round(made.voxel / made.pixel, 3),
        "open edges": len(made.mesh.open_edges()),
        **({} if settings.matching == "off" else {"agreed": f"{100 * made.agreed:.0f} %"}),
        **({"texel px": round(made.texel / made.pixel, 3)} if settings.texture else {}),
        "mesh": str(out),
    }


def _place(out: Path, mesh: Mesh, progress: Progress) -> None:
    """Writes it all or nothing."""
    if len(files_of(out, mesh.texture is not None)) == 1:
        with placing_output(out) as temporary:
            write_mesh(temporary, mesh)
        return
    with placing_outputs(out.parent, "mesh", progress.note) as folder:
        write_mesh(folder / out.name, mesh)


def _note(made: TwinMesh, settings: MeshSettings, progress: Progress) -> None:
    if made.far > NOTING.far:
        progress.note(f"{100 * made.far:.0f} % of what the cameras see is too far off for voxels of this size")
    if made.agreed < NOTING.agreed:
        rest = (
            "left out" if settings.matching == "agreed" else "filled from the twin's own depths, which are less exact"
        )
        progress.note(f"Cameras agree on {100 * made.agreed:.0f} % of the surface that they see; the rest is {rest}")
    if made.voxel > NOTING.coarser * settings.detail * made.pixel:
        progress.note(f"Voxels are {made.voxel / made.pixel:.2g} px wide: finer ones would not fit")
    if made.texel > NOTING.texel * made.pixel:
        progress.note(f"Texels are {made.texel / made.pixel:.2g} px wide: a larger texture would show more")
    if made.unseen > NOTING.unseen:
        progress.note(f"{100 * made.unseen:.0f} % of the texture is grey: no camera sees it")
