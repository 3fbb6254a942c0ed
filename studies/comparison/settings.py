"""What a study on a set with a known truth is asked to do."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

from ...core.devices import BackendName

#: Has rows made somewhere else, by their names, and comes back when their files are there.
Elsewhere = Callable[[Sequence[str]], None]
#: Every 8th view by sorted name is kept out of all trainings.
EVERY = 8


@dataclass(frozen=True)
class StudySettings:
    """What a comparison and a trade-off have in common.

    Attributes:
        dataset: folder with photos/ (or another name) and sharp/.
        out: folder for rows, tables and pictures.
        photos: name of the folder of blurred photos inside `dataset`; None: 'photos', else 'blur5'.
        psf: what blurred them; None for what the set's psf.json says.
        blur_space: where the blur acts; None for what psf.json says, else srgb.
        cameras: 'found' from the blurred photos, 'known' (the set's own), or a path.
        seeds: trainings of each method or knob.
        only: names of methods or of groups of knobs; empty for all.
        quick: few and small: the machinery is proved, the figures say little.
        resume: keep the rows that are there.
        rows: names of single rows, as those of their files in rows/; the table is not written then.
        threads: None for all cores.
        device: 'auto', 'cpu' or 'gpu'.
    """

    dataset: Path
    out: Path
    photos: str | None = None
    psf: str | None = None
    blur_space: Literal["srgb", "linear"] | None = None
    cameras: str = "found"
    seeds: int = 3
    only: tuple[str, ...] = ()
    quick: bool = False
    resume: bool = False
    rows: tuple[str, ...] = ()
    threads: int | None = None
    device: BackendName = "auto"

    #: Fields that decide which rows there are, not what stands in one.
    NOT_DECIDING: ClassVar[tuple[str, ...]] = ("dataset", "out", "seeds", "only", "resume", "rows", "threads")

    def deciding(self) -> dict[str, Any]:
        """What decides the figures of a row: rows of other settings differ in it."""
        return {name: value for name, value in asdict(self).items() if name not in self.NOT_DECIDING}


@dataclass(frozen=True)
class CompareSettings(StudySettings):
    """One comparison.

    Attributes:
        steps, max_gaussians: None for the product's own.
        mismatch: also what happens when the medium is not the one that was given.
    """

    steps: int | None = None
    max_gaussians: int | None = None
    mismatch: bool = False

    NOT_DECIDING: ClassVar[tuple[str, ...]] = (*StudySettings.NOT_DECIDING, "mismatch")
