"""All effects: a new one is a file beside this one, and one line here."""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

from .spec import EffectSpec, Switch

if TYPE_CHECKING:
    from ..imaging.formation.effect import Effect
    from ..inspection.photo_set import PhotoSet

#: In the order in which light meets them, but for one thing: the lens comes behind the medium that blurs. Its blur is
#: simulated in front of that one, where the frames have a margin and their depth; Gaussians commute where their widths
#: change slowly.
_FILES = (
    "gloss",
    "haze",
    "blur",
    "glass",
    "defocus",
    "field_blur",
    "kernels",
    "motion",
    "lens",
    "vignetting",
    "exposure",
    "white_balance",
    "noise",
    "saturation",
)

EFFECTS: tuple[EffectSpec, ...] = tuple(import_module(f".{file}", __package__).SPEC for file in _FILES)


def all_effects() -> tuple[EffectSpec, ...]:
    """Every effect, in the order in which light meets them."""
    return EFFECTS


def effect_named(name: str) -> EffectSpec | None:
    """The effect of this name; None where there is none (a report may be older or newer than this program)."""
    return next((spec for spec in EFFECTS if spec.name == name), None)


def switches() -> dict[str, Switch]:
    """Effects that a run can switch on and off, by name, in the order of the chain."""
    return {spec.name: spec.switch for spec in EFFECTS if spec.switch is not None}


def built(name: str, photos: PhotoSet) -> Effect | None:
    """An effect's simulation with the parameters that the photos show; None where they show none, or it has none."""
    switch = switches()[name]
    return None if switch.build is None else switch.build(photos)
