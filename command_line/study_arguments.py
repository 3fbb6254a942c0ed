"""What the commands that measure the method on a set with a known truth share: `compare` and `tradeoff`."""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..core.files import check_writable
from ..core.outputs import check_output_folder, claim_output_folder
from ..core.progress import Progress
from ..studies.comparison.settings import Elsewhere
from .arguments import add_machine, add_overwrite, add_progress, show_defaults, whole
from .workers import Task, add_workers, chosen, run_all, words_of


@dataclass(frozen=True)
class StudyWords:
    """What `--help` says of one study.

    Attributes:
        results: what its folder holds.
        found: what is to be said about cameras that are found.
        trained: what is trained with every seed.
        part: what `--only` names, in capitals; parts: how it is written.
        quick: what `--quick` leaves.
    """

    results: str
    found: str
    trained: str
    part: str
    parts: str
    quick: str


def add_study(parser: argparse.ArgumentParser, words: StudyWords) -> None:
    """The set, how its photos came about, and how much of the study is run."""
    show_defaults(parser)
    add = parser.add_argument
    add(
        "dataset",
        type=Path,
        metavar="DATASET",
        help="folder with photos/ (or blur5/) and sharp/, such as 'synthesize' writes",
    )
    add("--out", type=Path, required=True, metavar="DIR", help=f"folder for {words.results}")
    add("--photos", metavar="NAME", help="name of the folder of blurred photos inside DATASET")
    add("--psf", metavar="PSF", help="what blurred the photos; what DATASET/psf.json says if not given")
    add("--blur-space", choices=("srgb", "linear"), help="where the blur acts; what psf.json says if not given")
    add(
        "--cameras",
        default="found",
        metavar="WHICH",
        help=f"'found' {words.found}, 'known' (the set's own), or a camera model",
    )
    add(
        "--seeds",
        type=whole(1, 1000),
        metavar="N",
        help=f"trainings of each {words.trained}; 3, or 1 with --quick, if not given",
    )
    add(
        "--only",
        action="append",
        default=[],
        metavar=words.part,
        help=f"{words.parts}; may be repeated; all if not given",
    )
    add(
        "--row",
        action="append",
        default=[],
        metavar="NAME",
        help=f"make only this row, called {words.part}-SEED as its file in DIR/rows, and no table; may be repeated",
    )
    add("--quick", action="store_true", help=f"few {words.quick} and short trainings: proves the machinery only")
    add("--resume", action="store_true", help="keep the rows in DIR that belong to the same settings")
    add_overwrite(parser)
    add_machine(parser)
    add_workers(parser, "trainings run")
    add_progress(parser)


def asked_of_study(options: argparse.Namespace) -> dict[str, Any]:
    """Values for the fields of `studies.comparison.settings.StudySettings`."""
    seeds = options.seeds if options.seeds is not None else (1 if options.quick else 3)
    same = ("dataset", "out", "photos", "psf", "blur_space", "cameras", "quick", "resume", "threads", "device")
    return {
        **{name: getattr(options, name) for name in same},
        "seeds": seeds,
        "only": tuple(options.only),
        "rows": tuple(options.row),
    }


def elsewhere(options: argparse.Namespace, progress: Progress) -> Elsewhere | None:
    """What has rows of this study made by workers; None where it makes them itself."""
    workers = chosen(options)
    if workers is None or options.row:
        return None

    def make(names: Sequence[str]) -> None:
        threads = {"threads": workers.threads(options.threads)}
        leading = (options.command, str(options.dataset.absolute()))
        words = words_of(argparse.Namespace(**{**vars(options), **threads}), leading, ("dataset",))
        tasks = [Task(name, (*words, "--resume", "--row", name)) for name in names]
        run_all(workers, tasks, progress, "trainings")

    return make


def begin_in(folder: Path, marks: Sequence[str], overwrite: bool) -> None:
    """Makes sure that a study may write to its folder, and marks it as this program's.

    Args:
        marks: files that only such a study leaves.

    Raises:
        OutputError: it cannot be written, or holds files of others.
    """
    check_output_folder(folder, marks, overwrite)
    claim_output_folder(folder)
    check_writable(folder)
