"""A twin's folder and a file of measures in, values out."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from ..errors import FormatError
from ..files import check_writable, write_text
from ..json_shape import number
from ..machine import use_machine
from ..outputs import check_outputs, placing_output
from ..progress import Progress
from ..twin.folder import TwinFolder
from ..twin.opened import open_twin
from .measured import Findings, measure
from .request import read_request
from .rows import check_table_name
from .tables import as_text, lines

__all__ = ["MeasureJob", "as_text", "lines", "measure_twin"]


@dataclass(frozen=True)
class MeasureJob:
    """What is measured, and where it goes.

    Attributes:
        folder: of the twin; asked: file of places and measures.
        scale: known length as text, in the place of the file's; board: printed markers as text, likewise.
        photos: where the twin's photos lie now, if they were moved.
        out: file that is written as well, if any; overwrite: even if it is somebody else's.
        threads: all cores if None.
    """

    folder: Path
    asked: Path
    scale: str | None = None
    photos: Path | None = None
    out: Path | None = None
    overwrite: bool = False
    threads: int | None = None
    board: str | None = None


def measure_twin(job: MeasureJob, progress: Progress) -> Findings:
    """Measures what a file asks for, and writes it if a file is named.

    Raises:
        FormatError: no twin folder, a damaged file, or one that asks for what makes no sense. OutputError: it cannot be
            written. DgsError: the known length could not be measured, or the board not found. Cancelled: the user asked
            to stop.
    """
    if not job.folder.is_dir():
        raise FormatError(f"There is no folder '{job.folder}'", "Give the --out folder of 'reconstruct'")
    request = read_request(job.asked, job.scale, job.board)
    if job.out is not None:
        check_table_name(job.out)
        check_outputs([job.out], [job.asked, job.folder / "twin.ply", job.folder / "report.json"], job.overwrite)
        check_writable(job.out.parent)
    use_machine(job.threads)
    twin = open_twin(job.folder, progress, job.photos)
    findings = measure(twin, request, looking(TwinFolder(job.folder)), progress)
    if job.out is not None:
        with placing_output(job.out) as temporary:
            write_text(temporary, as_text(findings, job.out.suffix.lower()))
    return findings


def looking(folder: TwinFolder) -> float:
    """Standard deviation of where cameras look, px: the reprojection error where they were found, 0 where given."""
    cameras = folder.report().get("cameras")
    error = cameras.get("reprojection_error_px") if isinstance(cameras, dict) else None
    return max(0.0, float(error)) if isinstance(error, (int, float)) and number(error) else 0.0
