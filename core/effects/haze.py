"""Haze, smoke, water: the farther a point, the less of its own light and the more of the medium's."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

from ..imaging.formation.effect import Effect, Shot
from ..inspection.evidence import Evidence, judged, unknown
from ..numbers import NOT_RECORDED, number
from .spec import SMALLEST_CHECKED, SMALLEST_CHOSEN, EffectSpec, EffectWords, Switch

if TYPE_CHECKING:
    from torch import Tensor

    from ..inspection.photo_set import PhotoSet


@dataclass(frozen=True)
class HazeSettings:
    """Numbers of the evidence for haze, and of what is simulated."""

    smallest_visible: float = number(
        0.08, "optical depth", "at the median depth: 8 % of the contrast", SMALLEST_CHOSEN, SMALLEST_CHECKED
    )
    largest_error: float = number(
        0.35, "optical depth", "standard deviation beyond which no point is seen from distances different enough"
    )
    least_error: float = number(0.02, "optical depth", "what the law itself leaves uncertain")
    against: float = number(
        2.0, "standard errors", "below 0, from which on it is no haze that makes points differ with the distance"
    )
    darkest_veil: float = number(
        0.1,
        "linear light",
        "of a medium, as much of which farther points must show by two standard errors: contrast alone is lost to gloss"
        " and to blur, too",
        "a first choice, after drawn scenes 0 to 4: in clear air the added light is 0.02 per median depth at most, in"
        " haze of 0.16 0.10",
    )
    blur_share: float = number(
        0.5, "share", "of the share of a window's variance that another blur takes: as much contrast may go with it"
    )
    window_sigmas: float = number(1.3, "ratio", "of the window that colours are averaged over to the photos' blur")
    fewest_photos: int = number(4, "count", "photos whose blurs must be measured before their scatter counts")
    thinnest: float = number(
        0.02, "1 / median depth", "least attenuation that the veil is divided by", NOT_RECORDED, "no data: a guard"
    )


SETTINGS = HazeSettings()


class Haze(Effect):
    """light -> light exp(-beta d) + veil (1 - exp(-beta d)), beta and veil [3], d the depth in median depths.

    (Koschmieder 1924.) The depth is the sharp render's and taken as given: the gradient goes to light, beta and veil.
    """

    name = "haze"
    physics = "The medium absorbs and scatters away a share of the light with every metre, and adds light of its own."
    place = "light"
    by_depth = True

    def __init__(self, attenuation: Tensor, veil: Tensor) -> None:
        super().__init__({"attenuation": attenuation, "veil": veil})

    def _passed(self, shot: Shot, like: Tensor) -> tuple[Tensor, Tensor]:
        if shot.depth is None:
            raise ValueError("haze needs the render's depth")
        depth = shot.depth.to(like)
        return (-self.parameters["attenuation"].to(like)[:, None, None] * depth).exp(), depth

    def forward(self, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, _ = self._passed(shot, light)
        veil = self.parameters["veil"].to(light)[:, None, None]
        return veil + passed * (light - veil)

    def gradient(self, upstream: Tensor, light: Tensor, shot: Shot) -> Tensor:
        """See `Effect`."""
        passed, depth = self._passed(shot, light)
        veil = self.parameters["veil"].to(light)[:, None, None]
        through = upstream * passed
        self._add("attenuation", -(through * depth * (light - veil)).sum(dim=(1, 2)))
        self._add("veil", (upstream - through).sum(dim=(1, 2)))
        return through


def inspect(photos: PhotoSet) -> Evidence:
    """Attenuation and backscatter from the same points at different distances."""
    import numpy as np  # late: the command line's help reads this file

    from ..inspection.observations import SETTINGS as POINTS  # heavy: scipy

    unit, smallest = "optical depth", SETTINGS.smallest_visible
    fit = photos.haze
    if fit is None:
        return unknown("haze", unit, smallest, f"Not measured: {photos.no_observations}")
    value, error = float(fit.attenuation.mean()), fit.attenuation_error
    if error > SETTINGS.largest_error:
        return unknown("haze", unit, smallest, "Not measured: no point is seen from distances different enough")
    local = photos.local_blur
    if local is not None and local.defocus_significant:
        # Blur that grows with depth mixes a point with its surroundings, as haze does.
        error = float(np.hypot(error, SETTINGS.blur_share * local.defocus**2 / POINTS.window**2))
    # So does blur that differs from photo to photo; what motion adds, the colours were compared without.
    window = max(POINTS.window, SETTINGS.window_sigmas * photos.sigma)
    error = float(np.hypot(error, SETTINGS.blur_share * _scatter_of_blurs(photos) / window**2))
    if value + SETTINGS.against * error < 0:
        return unknown("haze", unit, smallest, "Not measured: points gain contrast with the distance, as in no haze")
    added, added_error = float(fit.backscatter.mean()), fit.backscatter_error
    seen = added - SETTINGS.against * added_error > SETTINGS.darkest_veil * max(value, smallest)
    # No medium gives light back, and none is brighter than white: it takes as much as it adds at least.
    error = float(np.hypot(error, SETTINGS.least_error))
    if seen and added > value:
        value, error = added, added_error
    value = max(value, 0.0)
    veil = fit.backscatter / np.maximum(fit.attenuation, 1e-6)
    text = (
        f"Points keep {100 * np.exp(-value):.0f} % of their contrast at the median distance "
        f"(optical depth {value:.2f} +- {error:.2f}), and the way adds {100 * added:.1f} +- {100 * added_error:.1f} % "
        f"of white{'' if seen else ': no haze adds so little'}"
    )
    details = {
        "attenuation": [round(float(v), 4) for v in fit.attenuation],
        "backscatter": [round(float(v), 4) for v in fit.backscatter],
        "veil": [round(float(np.clip(v, 0, 1)), 4) for v in veil],
    }
    found = judged("haze", value, error, smallest, unit, text, **details)
    if seen or not found.needed:
        return found
    excess = SETTINGS.darkest_veil * value - added
    none = 0.5 * (1.0 + math.erf(excess / max(added_error, 1e-9) / math.sqrt(2.0)))
    return replace(found, needed=False, confidence=max(none, 1.0 - found.confidence))


def _scatter_of_blurs(photos: PhotoSet) -> float:
    """Standard deviation (px^2) of the photos' variances beyond noise; 0 where motion is what differs."""
    import numpy as np  # late: the command line's help reads this file

    moved = photos.motion
    measured = [blur for blur in photos.blurs if blur is not None]
    if len(measured) < SETTINGS.fewest_photos or (moved is not None and moved.significant):
        return 0.0
    own = np.array([blur.variance for blur in measured])
    noise = float(np.mean([blur.variance_error**2 for blur in measured]))
    return math.sqrt(max(float(own.var()) - noise, 0.0))


def build(photos: PhotoSet) -> Haze | None:
    """Attenuation and veil of the points' fit."""
    import numpy as np  # late: the command line's help reads this file
    import torch  # heavy

    fit = photos.haze
    if fit is None:
        return None
    attenuation = np.maximum(np.maximum(fit.attenuation, fit.backscatter), SETTINGS.thinnest)
    veil = np.clip(fit.backscatter / attenuation, 0.0, 1.0)
    return Haze(*(torch.tensor(v, dtype=torch.float32) for v in (attenuation, veil)))


SPEC = EffectSpec(
    name="haze",
    physics=Haze.physics,
    words=EffectWords(
        label="Haze",
        tooltip="Fog, smoke or turbid water, which takes light away with the distance and adds its own",
        simulated="Haze: light that is lost with depth and light that the medium adds, in every step.",
        missing="Haze: light that the medium adds, absorbs or colours",
    ),
    inspect=inspect,
    switch=Switch(speakers=("haze",), trial_rank=3, simulation=Haze, build=build),
)
