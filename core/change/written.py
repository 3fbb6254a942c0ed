"""Two twins' folders in, a folder with what has changed between them out."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from ..errors import FormatError
from ..files import check_writable, write_text
from ..formats.meshes import write_mesh
from ..machine import use_machine
from ..measure.known import LengthScale, length_scale, read_known_length
from ..measure.request import MeasureRequest
from ..outputs import check_outputs, placing_outputs
from ..progress import Progress
from ..twin.opened import open_twin
from .compared import changes
from .files import FILES, MESH, PICTURE, REPORT, TABLE
from .findings import Changes
from .picture import coloured, draw, legend
from .tables import csv_text, json_text, lines, sentence

__all__ = ["ChangeJob", "find_changes", "lines"]


@dataclass(frozen=True)
class ChangeJob:
    """What is compared, and where it goes.

    Attributes:
        before, later: folders of two twins.
        out: folder that is written; overwrite: even in the place of somebody else's files.
        photos_before, photos_later: where their photos lie now, if they were moved.
        threads: all cores if None.
        measures: file of places and measures, one of which is a known length; of the first twin, or `measured_later`.
        scale: that length as text, in the place of the file's.
    """

    before: Path
    later: Path
    out: Path
    overwrite: bool = False
    photos_before: Path | None = None
    photos_later: Path | None = None
    threads: int | None = None
    measures: Path | None = None
    measured_later: bool = False
    scale: str | None = None


def find_changes(job: ChangeJob, progress: Progress) -> Changes:
    """Finds what has changed between two twins and writes it.

    Raises:
        FormatError: no twin folder, or damaged; a file of measures without a known length. NoOverlap: the twins share
            too little, or cannot be aligned. OutputError: it cannot be written. DgsError: there is no surface, or the
            known length could not be measured. Cancelled: the user asked to stop.
    """
    for folder in (job.before, job.later):
        if not folder.is_dir():
            raise FormatError(f"There is no folder '{folder}'", "Give the --out folders of two runs of 'reconstruct'")
    known = _known_length(job)
    inputs = [folder / name for folder in (job.before, job.later) for name in ("twin.ply", "report.json")]
    inputs += [] if job.measures is None else [job.measures]
    check_outputs([job.out / name for name in FILES], inputs, job.overwrite)
    check_writable(job.out)
    threads = use_machine(job.threads)
    before = open_twin(job.before, progress, job.photos_before)
    later = open_twin(job.later, progress, job.photos_later)
    scale = None if known is None else length_scale(later if job.measured_later else before, known, progress)
    found, first, second = changes(before, later, threads, progress)
    found = replace(found, scale=_in_first(scale, found, job))
    mesh = coloured(found, first, second)
    progress.stage("save")
    with placing_outputs(job.out, "change", progress.note) as folder:
        write_text(folder / REPORT, json_text(found, legend(found, first)))
        write_text(folder / TABLE, csv_text(found))
        draw(folder / PICTURE, mesh, first, found, sentence(found))
        write_mesh(folder / MESH, mesh)
    return found


def _known_length(job: ChangeJob) -> MeasureRequest | None:
    if job.measures is not None:
        return read_known_length(job.measures, job.scale)
    if job.scale is not None:
        raise FormatError(
            f"'{job.scale}' names a measure, but there is no file of measures",
            "Give one that holds it: --measures FILE",
        )
    return None


def _in_first(scale: LengthScale | None, found: Changes, job: ChangeJob) -> LengthScale | None:
    """Of the first world, in which all lengths are."""
    if scale is None or not job.measured_later:
        return scale
    return scale.in_world(found.alignment.similarity.scale)
