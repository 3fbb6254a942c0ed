"""What a measurement of the trade-off is asked to do."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from ...core.devices import BackendName
from ..comparison.settings import CompareSettings


@dataclass(frozen=True)
class TradeoffSettings:
    """One measurement.

    Attributes:
        dataset: folder with photos/ (or blur5/) and sharp/; out: folder for rows, tables, chart and page.
        photos, psf, blur_space, cameras: as of a comparison (`CompareSettings`).
        seeds: trainings of each point.
        only: groups of knobs (`knobs.GROUPS`); empty for all.
        target: PSNR in dB whose time is reported; half a dB below the best point if None.
        quick: few and small: the machinery is proved, the figures say little.
        resume: keep the rows that are there.
        threads: None for all cores; device: 'auto', 'cpu' or 'cuda'.
    """

    dataset: Path
    out: Path
    photos: str | None = None
    psf: str | None = None
    blur_space: Literal["srgb", "linear"] | None = None
    cameras: str = "found"
    seeds: int = 3
    only: tuple[str, ...] = ()
    target: float | None = None
    quick: bool = False
    resume: bool = False
    threads: int | None = None
    device: BackendName = "auto"

    def comparison(self) -> CompareSettings:
        """The same for reading the set."""
        return CompareSettings(
            dataset=self.dataset,
            out=self.out,
            photos=self.photos,
            psf=self.psf,
            blur_space=self.blur_space,
            cameras=self.cameras,
            quick=self.quick,
            resume=self.resume,
            threads=self.threads,
            device=self.device,
        )
