"""How gracefully it fails when the medium is not what it was said to be.

The sharp photos are blurred anew by media of other widths and families, with noise or JPEG; plain
splatting, Wiener and DGS are given a Gaussian of the nominal width. The border that the blur reaches is
cut away afterwards, so that what is left was lit as a camera would see it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.devices import choose_device
from ...core.errors import DgsError
from ...core.files import write_json, write_text
from ...core.imaging.kernel_samples import disc
from ...core.machine import use_machine
from ...core.photos.load import Photo
from ...core.progress import Progress
from . import degrade, table
from .dataset import Dataset, load_dataset, point_spread
from .measure import Measure
from .methods import WIENER_MEASURED
from .runs import Comparison, training_settings
from .settings import CompareSettings

#: Wrong by so many per cent: what DGS is given against what blurred the photos.
WRONG_SIGMAS = (-20, -10, 10, 20)
METHODS = ("plain", WIENER_MEASURED, "dgs")
#: Where not the width but the family, the noise or the coding differs, the question is whether DGS still helps.
PAIR = ("plain", "dgs")


@dataclass(frozen=True)
class Mismatch:
    """One way in which photos and what is said of them differ.

    Attributes:
        name: as the table calls it.
        given: standard deviation (px) of the Gaussian that the methods are given.
        kernel: what blurs the photos, [K, K].
        noise: standard deviation on encoded values in [0, 1].
        jpeg: quality, or None.
    """

    name: str
    given: float
    kernel: NDArray[np.float64]
    noise: float = 0.0
    jpeg: int | None = None


def cases(sigma: float, quick: bool = False) -> list[Mismatch]:
    """All cases around a Gaussian of `sigma` px; a few of them if `quick`."""
    true = degrade.gaussian(sigma)
    found = [Mismatch("as given", sigma, true)]
    found += [Mismatch(f"sigma given {wrong:+d} %", sigma * (1 + wrong / 100), true) for wrong in WRONG_SIGMAS]
    found += [
        Mismatch("Moffat of the same width", sigma, degrade.moffat(sigma)),
        Mismatch("disc of the same variance", sigma, disc(2 * sigma)),
        Mismatch("two Gaussians, a tail of 15 %", sigma, degrade.two_gaussians(sigma)),
        Mismatch("noise 1 %", sigma, true, noise=0.01),
        Mismatch("noise 3 %", sigma, true, noise=0.03),
        Mismatch("JPEG, quality 90", sigma, true, jpeg=90),
    ]
    if quick:
        keep = ("as given", "sigma given -20 %", "sigma given +20 %", "disc of the same variance", "noise 3 %")
        found = [case for case in found if case.name in keep]
    return found


def degraded(data: Dataset, case: Mismatch, border: int) -> Dataset:
    """The set with photos made anew from the sharp ones; `border` px are cut from every side."""
    index = {photo.name: number for number, photo in enumerate(data.photos)}

    def again(photo: Photo) -> Photo:
        sharp = data.truth.pixels(photo.name)
        pixels = degrade.photographed(sharp, case.kernel, case.noise, case.jpeg, (17, index[photo.name]))
        return replace(photo, pixels=pixels, alpha=None)

    psf = f"gaussian:{case.given:g}"
    given = replace(data, medium=replace(data.medium, psf=point_spread(psf), blur_space="srgb"), psf=psf)
    return given.cropped(border, again)


def study(settings: CompareSettings, progress: Progress) -> dict[str, Any]:
    """Runs every case with plain splatting, Wiener and DGS; writes mismatch.json and mismatch.md.

    Raises:
        DgsError: the set's medium is not one round Gaussian, or the set cannot be used.
        Cancelled: finished rows stay; --resume goes on from them.
    """
    threads, device = use_machine(settings.threads), choose_device(settings.device)
    data = load_dataset(settings, threads, progress)
    psf = data.medium.psf
    if psf is None or psf.kind != "gaussian" or psf.sigma_x != psf.sigma_y or psf.is_identity:
        raise DgsError(f"The mismatch study starts from one round Gaussian, not '{data.psf}'", "Use --psf gaussian:5")
    chosen = cases(psf.sigma_x, settings.quick)
    border = max(case.kernel.shape[0] // 2 for case in chosen)
    width, height = data.photos[0].size
    if min(width, height) - 2 * border < 48:
        raise DgsError(
            f"Photos of {width} x {height} px leave too little without a border of {border} px", "Use larger photos"
        )
    results: dict[str, Any] = {}
    for case in chosen:
        progress.note(f"Mismatch: {case.name}")
        own = degraded(data, case, border)
        methods = METHODS[1:] if case.given != psf.sigma_x else METHODS if case is chosen[0] else PAIR
        base = training_settings(settings, own, threads, device)
        folder = f"mismatch/{_folder(case.name)}"
        rows = Comparison(settings, own, Measure(own), base, progress, folder).rows(methods)
        results[case.name] = table.summarised(rows)["each"]
    for case in chosen:  # plain splatting takes no sigma: one run serves all that were given
        results[case.name].setdefault("plain", results["as given"]["plain"])
    content = {"psf": data.psf, "border": border, "seeds": settings.seeds, "quick": settings.quick, "cases": results}
    write_json(settings.out / "mismatch.json", content)
    write(settings.out / "mismatch.md", content)
    return content


def table_lines(content: dict[str, Any]) -> list[str]:
    """One row per case: PSNR of each method, what DGS has over plain splatting, and the red line."""
    head = [
        "case",
        "plain",
        "Wiener (n measured)",
        "DGS",
        "DGS - plain (dB)",
        "DGS: red line's concordance",
        "DGS: 10-7 px gain / corr.",
    ]
    out = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    for name, each in content["cases"].items():
        dgs, plain = each["dgs"]["median"], each["plain"]["median"]
        lead = dgs["psnr"] - plain["psnr"] if dgs["psnr"] is not None and plain["psnr"] is not None else math.nan
        gain, true = dgs.get("10-7 gain"), dgs.get("10-7 correlation")
        cells = [
            name,
            *(table.cell(each[m], "psnr", 2) if m in each else "" for m in METHODS),
            f"{lead:+.2f}",
            table.cell(each["dgs"], "red concordance", 1),
            "-" if gain is None or true is None else f"{gain:.2f} / {true:.2f}",
        ]
        out.append("| " + " | ".join(cells) + " |")
    return out


def explanation(content: dict[str, Any]) -> str:
    """What the table shows."""
    return (
        f"PSNR (dB) of held-out sharp renders when the photos were made otherwise than the methods were given"
        f" ({content['psf']}, unless the case says otherwise). Photos are made from the sharp ones and cut by"
        f" {content['border']} px on every side, so figures are not those of the main table."
        f" {content['seeds']} seed{'s' if content['seeds'] > 1 else ''}. Wiener was run for wrong widths only."
    )


def reading(content: dict[str, Any]) -> str:
    """What to learn from it."""
    leads = {
        name: each["dgs"]["median"]["psnr"] - each["plain"]["median"]["psnr"]
        for name, each in content["cases"].items()
        if None not in (each["dgs"]["median"]["psnr"], each["plain"]["median"]["psnr"])
    }
    below = [f"{name} ({lead:+.1f} dB)" for name, lead in leads.items() if lead < 0]
    where = (
        f"DGS falls below plain splatting here: {', '.join(below)}."
        if below
        else ("DGS stays above plain splatting in every case.")
    )
    return (
        f"{where} A blur given too wide, or of a kind that lets less through than the true one, is the dangerous error:"
        " its inverse lifts what should not be lifted. Where the photos hold more fine detail than the blur could have"
        " let through (`core/imaging/contradiction.py`), what contradicts it is not inverted, and a note says so;"
        " smaller errors may pass unnoticed. Measure the point spread (`measure-psf`); in doubt, give less."
    )


def write(path: Path, content: dict[str, Any]) -> None:
    """Writes the study as Markdown."""
    parts = ["# Mismatch", explanation(content), "\n".join(table_lines(content)), reading(content)]
    write_text(path, "\n\n".join(parts) + "\n")


def _folder(name: str) -> str:
    kept: Sequence[str] = [letter if letter.isalnum() or letter in "+-" else "_" for letter in name]
    return "".join(kept).strip("_")
