"""Two twins' folders in, a folder with what has changed between them out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import FormatError
from ..files import check_writable, write_text
from ..formats.meshes import write_mesh
from ..machine import use_machine
from ..outputs import check_outputs, placing_outputs
from ..progress import Progress
from ..twin.opened import open_twin
from .compared import changes
from .findings import Changes
from .picture import coloured, draw
from .tables import csv_text, json_text, lines, sentence

__all__ = ["ChangeJob", "find_changes", "lines"]

#: What is written.
FILES = ("change.json", "change.csv", "change.png", "change.glb")


@dataclass(frozen=True)
class ChangeJob:
    """What is compared, and where it goes.

    Attributes:
        before, later: folders of two twins.
        out: folder that is written; overwrite: even in the place of somebody else's files.
        photos_before, photos_later: where their photos lie now, if they were moved.
        threads: all cores if None.
    """

    before: Path
    later: Path
    out: Path
    overwrite: bool = False
    photos_before: Path | None = None
    photos_later: Path | None = None
    threads: int | None = None


def find_changes(job: ChangeJob, progress: Progress) -> Changes:
    """Finds what has changed between two twins and writes it.

    Raises:
        FormatError: no twin folder, or damaged. NoOverlap: the twins share too little, or cannot be aligned.
        OutputError: it cannot be written. DgsError: there is no surface. Cancelled: the user asked to stop.
    """
    for folder in (job.before, job.later):
        if not folder.is_dir():
            raise FormatError(f"There is no folder '{folder}'", "Give the --out folders of two runs of 'reconstruct'")
    inputs = [folder / name for folder in (job.before, job.later) for name in ("twin.ply", "report.json")]
    check_outputs([job.out / name for name in FILES], inputs, job.overwrite)
    check_writable(job.out)
    threads = use_machine(job.threads)
    before = open_twin(job.before, progress, job.photos_before)
    later = open_twin(job.later, progress, job.photos_later)
    found, first, second = changes(before, later, threads, progress)
    mesh = coloured(found, first, second)
    progress.stage("save")
    with placing_outputs(job.out, "change", progress.note) as folder:
        write_text(folder / FILES[0], json_text(found))
        write_text(folder / FILES[1], csv_text(found))
        draw(folder / FILES[2], mesh, first.cameras, found, sentence(found))
        write_mesh(folder / FILES[3], mesh)
    return found
