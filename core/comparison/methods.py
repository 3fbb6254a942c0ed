"""The ways to a twin that are compared, and what each of them trains on.

    plain            Gaussian splatting of the blurred photos
    wiener N vW      Wiener's filter with noise-to-signal ratio N per photo, then splatting with total variation
                     W; N 'measured' is told by the photos' own spectra: the choice that needs no truth
    rl N vW          N iterations of Richardson-Lucy per photo, then splatting with total variation W
    paper            the paper's loss: MAE + SSIM on the degraded render
    dgs              ours
    oracle           Gaussian splatting of the sharp photos
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

from ..errors import DgsError
from ..imaging.medium import Medium
from ..photos.load import Photo
from ..progress import Progress
from ..training.settings import TrainingSettings
from . import deconvolution
from .dataset import Dataset

RATIOS = ("1e-5", "3e-5", "1e-4", "3e-4", "1e-3", "measured")
ITERATIONS = (50, 100, 200)
VARIATIONS = (0.0, 0.1, 0.3)
_QUICK_RATIOS, _QUICK_ITERATIONS = ("1e-4", "measured"), (10,)
_KINDS = ("plain", "paper", "dgs", "oracle", "wiener", "rl")


def methods(quick: bool = False) -> list[str]:
    """All rows, in the order in which they are run."""
    ratios, iterations = (_QUICK_RATIOS, _QUICK_ITERATIONS) if quick else (RATIOS, ITERATIONS)
    variations = (TrainingSettings().variation_weight,) if quick else VARIATIONS
    wiener = [f"wiener {ratio} v{weight:g}" for ratio in ratios for weight in variations]
    lucy = [f"rl {count} v{weight:g}" for count in iterations for weight in variations]
    return ["plain", "paper", "dgs", "oracle", *wiener, *lucy]


def without_truth(methods_run: list[str]) -> str | None:
    """The Wiener row that one could choose without knowing the truth: n as measured, our own method's W."""
    name = f"wiener measured v{TrainingSettings().variation_weight:g}"
    return name if name in methods_run else None


@dataclass(frozen=True)
class Ingredients:
    """What a method trains on.

    Attributes:
        photos: registered ones.
        medium: what the training knows of.
        settings: of the training.
        seconds: what the deconvolution took.
    """

    photos: list[Photo]
    medium: Medium
    settings: TrainingSettings
    seconds: float = 0.0


class Kitchen:
    """Prepares ingredients, and keeps the photos deconvolved last: seeds and TV weights share them."""

    def __init__(self, data: Dataset, progress: Progress) -> None:
        self._data, self._progress = data, progress
        self._kept: tuple[str, list[Photo], float] = ("", [], 0.0)

    def ingredients(self, method: str, base: TrainingSettings) -> Ingredients:
        """Of one method.

        Raises:
            DgsError: there is no such method.
        """
        photos, medium = self._data.photos, self._data.medium
        kind, *values = method.split()
        plain = replace(base, variation_weight=0.0)
        if kind not in _KINDS or len(values) != (2 if kind in ("wiener", "rl") else 0):
            raise DgsError(f"There is no method '{method}'", f"Choose among {', '.join(methods())}")
        if kind == "dgs":
            return Ingredients(photos, medium, base)
        if kind == "paper":
            return Ingredients(photos, medium, replace(plain, loss="paper"))
        if kind == "plain":
            return Ingredients(photos, Medium(None), plain)
        if kind == "oracle":
            sharp = [replace(p, pixels=self._data.truth.pixels(p.name)) for p in photos]
            return Ingredients(sharp, Medium(None), plain)
        try:
            varied = replace(base, variation_weight=float(values[1].removeprefix("v")))
            float(values[0] if values[0] != "measured" else 1)
        except ValueError as error:
            raise DgsError(f"There is no method '{method}'", "Write such as 'wiener 1e-4 v0.1'") from error
        made, seconds = self._deconvolved(f"{kind} {values[0]}", kind, values[0])
        return Ingredients(made, Medium(None), varied, seconds)

    def _deconvolved(self, key: str, kind: str, value: str) -> tuple[list[Photo], float]:
        if self._kept[0] != key:
            began = time.perf_counter()
            if self._data.medium.psf is None or self._data.medium.psf.is_identity:
                made = self._data.photos
            elif kind == "wiener":
                made = deconvolution.wiener(self._data.photos, self._data.medium, value)
            else:
                made = deconvolution.lucy(self._data.photos, self._data.medium, int(value), self._progress)
            self._kept = (key, made, time.perf_counter() - began)
        return self._kept[1:]
