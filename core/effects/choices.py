"""What `--effects` and the panel offer, read from the registry."""

from __future__ import annotations

from zlib import crc32

from .registry import all_effects, switches

#: What the panel offers besides single effects: identifier, label, tooltip. Files keep their number, the place.
_GROUPS = (
    ("none", "None", "Only the blur of the medium"),
    ("auto", "As the Photos Need", "Those that the photos show and a short training confirms; the report says why"),
    ("all", "All", "All whose size can be estimated from the photos, without a short training"),
    ("usual", "Exposure If It Differs", "Each photo's exposure is learned where the same points show that it differs"),
)


def effects_help() -> str:
    """The help of `--effects`."""
    return (
        "besides the blur: usual (each photo's exposure, where photos show that it differs) | auto (what the photos "
        "call for and a short trial confirms) | none | all | names with "
        f"commas out of {', '.join(switches())} (auto,haze forces one on, auto,-haze off)"
    )


def effect_items() -> list[tuple[str, str, str, str, int]]:
    """Items of the panel's choice: identifier (as `--effects` takes it), label, tooltip, icon and number.

    Blender keeps the number in its files, so an effect's follows from its name: another effect changes none.
    """
    items = [(*group, "NONE", number) for number, group in enumerate(_GROUPS)]
    items += [
        (spec.name, spec.words.label, spec.words.tooltip, "NONE", crc32(spec.name.encode()) >> 1)
        for spec in all_effects()
        if spec.switch is not None
    ]
    return items
