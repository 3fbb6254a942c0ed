"""The medium between scene and camera: which point spread, for which photo, in which colour space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cache
from typing import Literal

import numpy as np

from ..errors import PsfError
from .psf import PointSpread

BlurSpace = Literal["srgb", "linear"]


@dataclass(frozen=True)
class Medium:
    """What degrades a sharp view into a photo.

    Attributes:
        psf: point spread of every photo that has none of its own; None for no blur.
        blur_space: 'srgb' blurs display values (as the paper's virtual blur most likely did),
            'linear' blurs light (as physics does): sRGB -> linear -> blur -> sRGB.
        per_view: point spreads by photo name.
    """

    psf: PointSpread | None = None
    blur_space: BlurSpace = "srgb"
    per_view: Mapping[str, PointSpread | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.blur_space not in ("srgb", "linear"):
            raise PsfError(f"There is no blur space '{self.blur_space}'", "Choose srgb or linear")

    def psf_for(self, view_name: str) -> PointSpread | None:
        """The point spread of one photo; None if it is not blurred."""
        return self.per_view.get(view_name, self.psf)

    @property
    def blurs(self) -> bool:
        """Whether any photo is blurred at all."""
        return any(p is not None and not p.is_identity for p in (self.psf, *self.per_view.values()))

    def mean_sigma(self, names: Sequence[str]) -> float:
        """Standard deviation (px) of the photos' blur, root mean square over photos and directions; 0 for none."""
        spreads = [self.psf_for(name) for name in names]
        variances = [0.0 if psf is None else float(np.trace(psf.covariance)) / 2.0 for psf in spreads]
        return float(np.sqrt(np.mean(variances)))

    def on_grid(self, s: float, low_pass: float = 0.0) -> Medium:
        """The medium for photos area-averaged by `s`; see `PointSpread.on_grid`."""

        @cache  # photos that share a point spread still do
        def coarse(psf: PointSpread | None) -> PointSpread | None:
            return None if psf is None or psf.is_identity else psf.on_grid(s, low_pass)

        return replace(self, psf=coarse(self.psf), per_view={name: coarse(psf) for name, psf in self.per_view.items()})

    def at_scales(self, scales: Mapping[str, float]) -> Medium:
        """The medium for photos that were shrunk from their files, whose px it is in.

        Args:
            scales: size as used over size in the file, by photo name; the first one's is that of the shared `psf`.
        """
        grids = {s: self if s == 1.0 else self.on_grid(1.0 / s) for s in set(scales.values())}
        if len(grids) == 1:
            return next(iter(grids.values()))
        spreads = {name: grids[s].psf_for(name) for name, s in scales.items()}
        return replace(self, psf=grids[next(iter(scales.values()))].psf, per_view=spreads)
