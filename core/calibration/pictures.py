"""A picture of a measured point spread: the kernel, its profiles, and the contrast that passes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from ..files import replacing
from .measured import MeasuredPsf, mtf50


def draw_psf(path: Path, measured: MeasuredPsf, title: str) -> None:
    """Writes a PNG with kernel, profiles and MTF.

    Raises:
        OutputError: it cannot be written.
    """
    from matplotlib.figure import Figure  # heavy: matplotlib

    figure = Figure(figsize=(11.5, 3.9), dpi=110, layout="constrained")
    left, middle, right = figure.subplots(1, 3)
    kernel = measured.kernel
    reach = kernel.shape[0] // 2
    extent = (-reach - 0.5, reach + 0.5, reach + 0.5, -reach - 0.5)
    shown = left.imshow(np.sqrt(kernel / kernel.max()), extent=extent, cmap="magma", interpolation="nearest")
    figure.colorbar(shown, ax=left, shrink=0.85, label="square root of kernel / peak")
    turn = np.linspace(0, 2 * math.pi, 200)
    c, s = math.cos(math.radians(measured.angle)), math.sin(math.radians(measured.angle))
    u, v = measured.sigma_x * np.cos(turn), measured.sigma_y * np.sin(turn)
    left.plot(u * c - v * s, u * s + v * c, color="white", linewidth=1, label="1 sigma of the Gaussian fit")
    left.legend(loc="lower left", fontsize=7, framealpha=0.4)
    left.set(title=f"{kernel.shape[1]} x {kernel.shape[0]} px", xlabel="px", ylabel="px")

    t = np.arange(-reach, reach + 1)
    fine = np.linspace(-reach, reach, 400)
    covariance = _covariance(measured)
    precision = np.linalg.inv(covariance)
    peak = kernel.max()
    top = 1.0 / (2 * math.pi * math.sqrt(np.linalg.det(covariance)))
    for label, row, entry, colour in (("across x", kernel[reach], 0, "C0"), ("across y", kernel[:, reach], 1, "C3")):
        middle.plot(t, row / peak, "o", markersize=3, color=colour, label=label)
        gaussian = top * np.exp(-0.5 * precision[entry, entry] * fine**2)
        middle.plot(fine, gaussian / peak, color=colour, linewidth=0.9)
    middle.set(title="Profiles (lines: Gaussian fit)", xlabel="px", ylabel="relative to the peak")
    middle.legend(fontsize=8)

    right.plot(measured.frequencies, measured.mtf, color="C2", label="measured")
    f = measured.frequencies
    right.plot(f, np.exp(-2 * np.pi**2 * measured.sigma**2 * f**2), "k--", linewidth=0.8, label="Gaussian fit")
    half = mtf50(f, measured.mtf)
    if half is not None:
        right.axvline(half, color="grey", linewidth=0.8)
        right.text(half, 0.93, f" MTF50 {half:.3f}", fontsize=8)
    right.set(title="Contrast that passes (MTF)", xlabel="cycles/px", ylim=(0, 1.05), xlim=(0, 0.5))
    right.legend(fontsize=8)
    figure.suptitle(
        f"{title}: sigma {measured.sigma:.3f} ± {measured.sigma_uncertainty:.3f} px, FWHM {measured.fwhm:.2f} px, "
        f"{'linear light' if measured.space == 'linear' else 'values as they stand'}",
        fontsize=11,
    )
    with replacing(path) as temporary:
        figure.savefig(temporary)


def _covariance(measured: MeasuredPsf) -> np.ndarray:
    c, s = math.cos(math.radians(measured.angle)), math.sin(math.radians(measured.angle))
    axes = np.array([[c, -s], [s, c]])
    return np.asarray(axes @ np.diag([measured.sigma_x**2, measured.sigma_y**2]) @ axes.T)
