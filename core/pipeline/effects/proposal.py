"""From the inspection's evidence to effects that can be simulated."""

from __future__ import annotations

import math
from collections.abc import Iterable

import numpy as np
import torch

from ...imaging.formation.defocus import Defocus
from ...imaging.formation.effect import Effect
from ...imaging.formation.exposure import Exposure
from ...imaging.formation.field_blur import FieldBlur
from ...imaging.formation.haze import Haze
from ...imaging.formation.motion import Motion, motion_from
from ...imaging.formation.vignetting import Vignetting
from ...inspection.effects.motion import paths_of
from ...inspection.evidence import Evidence
from ...inspection.local_blur import fit_local_blur
from ...inspection.photo_set import PhotoSet
from ...training.scale import scene_scale

#: Which evidence speaks for an effect.
SPEAKS = {
    "exposure": ("exposure", "white_balance"),
    "vignetting": ("vignetting",),
    "haze": ("haze",),
    "saturation": ("saturation",),
    "defocus": ("defocus",),
    "field_blur": ("field_blur",),
    "motion": ("motion",),
}
#: A channel's gain that is less certain than this (natural log) is not taken.
LEAST_CERTAIN = 0.1
#: Least attenuation (per median depth) that a veil is divided by.
_THINNEST = 0.02
#: Effects whose size the tiles of the photos tell.
BLURS = ("defocus", "field_blur")


def proposed(found: Iterable[Evidence]) -> list[str]:
    """Effects that the evidence calls needed, the most certain first."""
    needed = {e.name: e.confidence for e in found if e.needed}
    sure = {name: max((needed[s] for s in speakers if s in needed), default=0.0) for name, speakers in SPEAKS.items()}
    return sorted((name for name in sure if sure[name] > 0), key=lambda name: -sure[name])


def build(name: str, photos: PhotoSet) -> Effect | None:
    """The effect with the parameters that the photos tell; None where they tell none."""
    if name in BLURS:
        return _blur(name, photos)
    if name == "motion":
        return _motion(photos)
    fit, tracks = photos.photometry, photos.tracks
    if fit is None or tracks is None:
        return None
    if name == "exposure":
        certain = fit.gains_draws.std(axis=0) < LEAST_CERTAIN
        # A channel that few points tell goes with the photo's others; a photo that none tell keeps gain 1.
        others = (fit.gains * certain).sum(axis=1, keepdims=True) / np.maximum(certain.sum(axis=1, keepdims=True), 1)
        gains = np.where(certain, fit.gains, others)
        exposure = Exposure(tracks.names, torch.tensor(gains, dtype=torch.float32))
        exposure.settle()
        return exposure
    if name == "vignetting":
        # One glass for all channels: their mean is three times as certain as each of them.
        return Vignetting(torch.full((3,), float(np.clip(fit.vignette.mean(), 0.0, 0.8))))
    if name == "haze":
        attenuation = np.maximum(fit.attenuation, _THINNEST)
        veil = np.clip(fit.backscatter / attenuation, 0.0, 1.0)
        as_float = [torch.tensor(v, dtype=torch.float32) for v in (attenuation, veil)]
        return Haze(*as_float)
    return None


def _blur(name: str, photos: PhotoSet) -> Effect | None:
    """What the tiles tell beyond the blur that they share, which is the medium's."""
    local = fit_local_blur(photos)
    if local is None:
        return None
    diagonal = math.hypot(*photos.greys[0].shape)
    if name == "field_blur":
        # What noise alone gives is taken off, so that nothing is simulated where nothing is seen.
        certain = 1.0 - min(1.0, (local.corner_error / max(abs(local.corner), 1e-9)) ** 2)
        corner = np.sign(local.corner) * np.sqrt(abs(local.corner) * certain)
        return FieldBlur(torch.tensor(float(corner) / diagonal))
    unit = depth_unit(photos)
    if not local.depth_known or unit is None:
        return None
    inverse = 1.0 / local.curve[0]
    focus = float(inverse[int(local.curve[1].argmin())])
    strength = local.defocus / float(np.abs(inverse - focus).max())
    # 1 / depth in the trainer's unit is that of the tracks over `unit`.
    return Defocus(torch.tensor(strength * unit / diagonal), torch.tensor(focus / unit))


def depth_unit(photos: PhotoSet) -> float | None:
    """Depths of the tracks times this are in the unit of a render's depth; None without tracks."""
    if photos.tracks is None or photos.cameras is None:
        return None
    cameras = list(photos.cameras.cameras().values())
    return photos.tracks.median_depth / scene_scale(cameras, photos.cameras.points).size


def _motion(photos: PhotoSet) -> Motion | None:
    """Every photo's own path, held-out ones too; None where none stands clear of its noise."""
    paths = paths_of(photos)
    if not any(path.length for path in paths.values()):
        return None
    return motion_from(list(paths), [p.length for p in paths.values()], [p.angle for p in paths.values()])
