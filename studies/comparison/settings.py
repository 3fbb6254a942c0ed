"""What a comparison is asked to do."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

from ...core.devices import BackendName

#: Every 8th view by sorted name is kept out of all trainings.
EVERY = 8


@dataclass(frozen=True)
class CompareSettings:
    """One comparison.

    Attributes:
        dataset: folder with photos/ (or another name) and sharp/.
        out: folder for rows, table and pictures.
        photos: name of the folder of blurred photos inside `dataset`; None: 'photos', else 'blur5'.
        psf: what blurred them; None for what the set's psf.json says.
        blur_space: where the blur acts; None for what psf.json says, else srgb.
        cameras: 'found' from the blurred photos, 'known' (the set's own), or a path.
        seeds: trainings of each method.
        steps, max_gaussians: None for the product's own.
        only: names of methods; empty for all.
        quick: few and small: the machinery is proved, the figures say little.
        mismatch: also what happens when the medium is not the one that was given.
        resume: keep the rows that are there.
        threads: None for all cores.
        device: 'auto', 'cpu' or 'cuda'.
    """

    dataset: Path
    out: Path
    photos: str | None = None
    psf: str | None = None
    blur_space: Literal["srgb", "linear"] | None = None
    cameras: str = "found"
    seeds: int = 3
    steps: int | None = None
    max_gaussians: int | None = None
    only: tuple[str, ...] = ()
    quick: bool = False
    mismatch: bool = False
    resume: bool = False
    threads: int | None = None
    device: BackendName = "auto"

    def deciding(self) -> dict[str, Any]:
        """What decides the figures of a row: rows of other settings differ in it."""
        values = asdict(self)
        for name in ("dataset", "out", "seeds", "only", "mismatch", "resume", "threads"):
            values.pop(name)
        return values
