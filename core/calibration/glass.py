"""Distance and angle of frosted glass, from the widths of points or edges photographed at several distances."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch

from ..errors import PsfError
from ..imaging.formation.glass import oblique
from ..numbers import number
from .light import read_light
from .measure import measure_psf


@dataclass(frozen=True)
class GlassCalibrationSettings:
    """Numbers of the calibration."""

    least_change: float = number(
        0.1,
        "share",
        "that 1 / distance must change by between the photos: with less, errors of widths decide",
        "judgement",
    )
    least_error: float = number(
        0.005, "share", "of a width, its error at least: the formula is not exact for rough glass", "judgement"
    )


SETTINGS = GlassCalibrationSettings()


@dataclass(frozen=True)
class WidthAt:
    """What one calibration photo shows.

    Attributes:
        depth: of the point or edge along the camera's axis, in any unit.
        sigma, error: px, standard deviation of the blur there, and its standard error.
        off_axis: px between it and the photo's middle.
    """

    depth: float
    sigma: float
    error: float
    off_axis: float = 0.0


@dataclass(frozen=True)
class MeasuredGlass:
    """A glass, with standard errors.

    Attributes:
        distance: in the unit of the depths; angle: rad, standard deviation along each axis.
    """

    distance: float
    distance_error: float
    angle: float
    angle_error: float

    @property
    def setting(self) -> str:
        """As `--glass` takes it."""
        return f"{self.distance:.5g},{math.degrees(self.angle):.4g}"


def glass_of(widths: Sequence[WidthAt], focal: float) -> MeasuredGlass:
    """The glass whose blur is f s (1 - z_d / z): a line in 1 / z, fitted by least squares.

    Args:
        focal: length in px.

    Raises:
        PsfError: distances are alike, or the blur does not grow with them; it says what to do.
    """
    depth, sigma, error, off = (
        np.array([getattr(w, k) for w in widths]) for k in ("depth", "sigma", "error", "off_axis")
    )
    if len(widths) < 2 or (depth <= 0).any():
        raise PsfError("Glass takes two distances to be measured", "Give two photos or more, each with its distance")
    inverse = 1.0 / depth
    if np.ptp(inverse) < SETTINGS.least_change * inverse.max():
        raise PsfError(
            "The distances are too much alike to say where the glass stands",
            "Photograph the point again at one and a half times the distance, or more",
        )
    wider = oblique(torch.from_numpy((off / focal) ** 2)[None])[0].numpy()
    sigma, error = sigma / wider, np.hypot(error / wider, SETTINGS.least_error * sigma)
    rows = np.stack([np.ones(len(widths)), -inverse], axis=1) / error[:, None]
    covariance = np.linalg.inv(rows.T @ rows)
    far, slope = covariance @ (rows.T @ (sigma / error))
    distance = slope / far
    in_distance = np.array([-distance, 1.0]) / far
    distance_error = float(np.sqrt(in_distance @ covariance @ in_distance))
    if far <= 0 or distance <= 1e-9 * depth.min():  # (rounding leaves a little of a blur that does not grow)
        raise PsfError(
            f"The blur does not grow with the distance (the glass would be at {distance:.3g})",
            "Use --psf with the kernel of measure-psf: the glass is close to the camera, or something else blurs",
        )
    if distance >= depth.min():
        raise PsfError(
            f"The glass would stand at {distance:.3g}, behind the nearest point",
            "Check that the distances are from the camera, along its axis",
        )
    angle_error = float(np.sqrt(covariance[0, 0])) / focal
    return MeasuredGlass(float(distance), distance_error, float(far / focal), angle_error)


def glass_from_photos(
    photos: Sequence[Path], depths: Sequence[float], focal: float
) -> tuple[MeasuredGlass, list[WidthAt]]:
    """The glass, and the width that each photo shows of a point or edge at its depth.

    Raises:
        PhotoError: a photo cannot be read. PsfError: there is nothing to measure, or see `glass_of`.
    """
    if len(photos) != len(depths):
        raise PsfError(
            f"{len(photos)} photos and {len(depths)} distances do not fit together",
            "Give --distances one for each photo",
        )
    if focal <= 0:
        raise PsfError(f"A focal length of {focal:g} px is none", "Give --focal in px, as cameras files have it")
    widths = []
    for photo, depth in zip(photos, depths, strict=True):
        found, shape = measure_psf(photo), read_light(photo, linear=True).values.shape
        off = math.hypot(found.place[0] - shape[1] / 2, found.place[1] - shape[0] / 2)
        widths.append(WidthAt(depth, found.sigma, found.sigma_uncertainty, off))
    return glass_of(widths, focal), widths
