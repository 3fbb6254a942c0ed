"""The manual: its pages on this disk, and Blender's own way to them (F1, or "Online Manual" in a context menu).

The extension brings docs/ as HTML (`tools/manual.py`); where the add-on is a clone and none were made, the texts
themselves are opened. Nothing of it needs a network.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path

import bpy

_ROOT = Path(__file__).resolve().parent.parent
_PAGES = _ROOT / "manual"
#: The page that a Blender user begins with.
FIRST = "blender"

#: The places that explain buttons, and the buttons, with wildcards. The first that fits counts.
_BUTTONS = {
    "blender#images": "choose_photos",
    "blender#cameras": "find_cameras import_cameras show_cameras",
    "effects#measure-psf": "measure_psf",
    "effects#inspect": "inspect_photos use_inspection",
    "blender#jobs": "cancel_job pause_job resume_job show_log add_results batch cancel_batch take_set",
    "blender#optimize": "optimize estimate add_preset show_tradeoff",
    "blender#arrival": "give_back prepare_scene dismiss",
    "twin#new-photos-update": "update_twin rollback_twin show_states",
    "twin#which-photo-to-take-next-next-view": "suggest_next_views show_next_views show_known",
    "blender#among-meshes": "composite_meshes",
    "blender#cleaning-up-a-twin": "edit_splats select_* delete_splats hide_splats show_splats restore_splats"
    " merge_twins apply_transform",
    "measure#a-marker-board": "scale_by_board",
    "measure#the-mesh": "make_mesh",
    "measure#change-between-two-twins": "compare_earlier show_changes",
    "measure#in-blender": "measure measure_again export_measures know_length forget_length remove_measure",
    "blender#beside-the-photos": "split_view",
    "report#what-a-reconstruction-writes": "open_report",
    "laboratory#sets-with-a-known-truth": "make_test_set",
    "blender#validate": "exact_view render_twin compare_truth",
    "blender#the-engine": "*_engine cancel_install open_preferences",
    "blender#twin": "*",
}
#: The same of the fields of all steps.
_FIELDS = {
    "blender#images": "photos frames masks out max_size",
    "usage#what-is-behind-the-object": "background",
    "blender#cameras": "cameras model",
    "effects#motion": "adjust_cameras",
    "twin#cameras-through-the-loss---refine-cameras": "refine_cameras",
    "usage#the-blur---psf": "medium sigma* angle psf_file blur_space",
    "effects#--effects": "effects",
    "twin#new-photos-update": "new_photos watching",
    "blender#twin": "known_length",
    "blender#beside-the-photos": "split_*",
    "measure#in-blender": "measure_*",
    "laboratory#sets-with-a-known-truth": "test_*",
    "blender#validate": "truth view_kind",
    "blender#optimize": "*",
}


def _patterns(prefix: str, explained: Mapping[str, str]) -> list[tuple[str, str]]:
    """(what Blender calls each of them, in small letters; the place that explains it)"""
    return [(prefix + name, place) for place, names in explained.items() for name in names.split()]


#: Patterns of all that can be looked up, and places as 'page#heading'.
PLACES: tuple[tuple[str, str], ...] = (
    *_patterns("bpy.ops.dgs.", _BUTTONS),
    *_patterns("bpy.types.dgs_pg_settings.", _FIELDS),
    ("bpy.types.dgs_pg_*", "measure#in-blender"),
    ("bpy.types.dgs_ap_*", "blender#the-engine"),
)


def address(place: str = FIRST) -> str:
    """The file: address of a place as `PLACES` has them, 'page' or 'page#heading'."""
    page, mark, heading = place.partition("#")
    made = _PAGES / f"{page}.html"
    file = made if made.is_file() else _ROOT / "docs" / f"{page}.md"
    return f"{file.as_uri()}{mark}{heading}"


def manual_map() -> tuple[str, Sequence[tuple[str, str]]]:
    """What Blender asks for: what stands before all addresses, and a pattern and the rest of the address for each."""
    return "", tuple((pattern, address(place)) for pattern, place in PLACES)


def register_manual() -> None:
    """Adds the manual to those in which Blender looks things up."""
    bpy.utils.register_manual_map(manual_map)


def unregister_manual() -> None:
    """Takes it out again."""
    bpy.utils.unregister_manual_map(manual_map)
