"""Where two pictures of the same view are shifted against each other, px by px (Lucas and Kanade 1981)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter, map_coordinates, uniform_filter

from ..numbers import number

Floats = NDArray[np.float64]

#: Share of red, green and blue in brightness (Rec. 601).
BRIGHTNESS = np.array([0.299, 0.587, 0.114])


@dataclass(frozen=True)
class ShiftSettings:
    """Of the search for shifts between two pictures of one view."""

    scales: tuple[tuple[float, int], ...] = number(
        ((6.0, 12), (3.0, 8), (1.5, 6), (1.0, 6)),
        "px",
        "smoothing (sigma) and half the side of the window, from coarse to fine: the first scale says how far off a"
        " photo may lie, the last how exactly it is found",
    )
    steps: int = number(2, "count", "Gauss-Newton steps at each scale")
    empty: float = number(
        1e-5, "1 / px^2", "squared gradient (pictures in [0, 1]) below which a window is taken for empty"
    )
    largest_gain: float = number(
        1.4, "factor", "by which contrast may differ between picture and photo; more is no gain but something else"
    )


SETTINGS = ShiftSettings()


@dataclass(frozen=True)
class Shifts:
    """What was found.

    Attributes:
        shift: [2, H, W] px (x, y): the photo shows at u + shift what the picture shows at u.
        error: [H, W] px, by the residual that is left, along the worse direction; large where there is no detail.
        detail: [H, W] how much there is to hold on to, in both directions.
    """

    shift: Floats
    error: Floats
    detail: Floats


def shifts_between(
    picture: NDArray[np.floating],
    photo: NDArray[np.floating],
    valid: NDArray[np.bool_] | None = None,
    settings: ShiftSettings = SETTINGS,
) -> Shifts:
    """Shifts that align `photo` with `picture`, both [3, H, W] in [0, 1]; only px that are `valid` [H, W] count."""
    still, moving = (np.tensordot(BRIGHTNESS, np.asarray(p, np.float64), 1) for p in (picture, photo))
    y, x = np.mgrid[: still.shape[0], : still.shape[1]].astype(np.float64)
    shift = np.zeros((2, *still.shape))
    count = np.ones(still.shape) if valid is None else valid.astype(np.float64)
    empty, gain_limit = settings.empty, settings.largest_gain
    for sigma, half in settings.scales:
        side = 2 * half + 1
        a, b = gaussian_filter(still, sigma, truncate=3.0), gaussian_filter(moving, sigma, truncate=3.0)
        a_off = a - uniform_filter(a, 2 * side)
        a_power = uniform_filter(a_off**2, 2 * side)
        for _ in range(settings.steps):
            moved = map_coordinates(b, [y + shift[1], x + shift[0]], order=1, mode="nearest")
            b_off = moved - uniform_filter(moved, 2 * side)
            power = np.maximum(uniform_filter(b_off**2, 2 * side), 1e-8)
            gain = np.sqrt(np.clip(a_power / power, gain_limit**-2, gain_limit**2))
            gradient_y, gradient_x = np.gradient(b_off)
            gradient_x, gradient_y, rest = (
                gradient_x * gain * count,
                gradient_y * gain * count,
                (a_off - b_off * gain) * count,
            )
            xx, xy, yy, right_x, right_y = (
                uniform_filter(p, side)
                for p in (gradient_x**2, gradient_x * gradient_y, gradient_y**2, gradient_x * rest, gradient_y * rest)
            )
            whole = (xx + empty) * (yy + empty) - xy**2
            step_x = ((yy + empty) * right_x - xy * right_y) / whole
            step_y = ((xx + empty) * right_y - xy * right_x) / whole
            # A step is true within the size of the detail it looks at.
            shift += np.clip(np.stack([step_x, step_y]), -sigma, sigma)
    least = np.maximum((xx + yy) / 2 - np.sqrt(((xx - yy) / 2) ** 2 + xy**2), 1e-9)
    error = np.sqrt(np.maximum(uniform_filter(rest**2, side), 1e-7) / least)
    return Shifts(shift, error, least)
