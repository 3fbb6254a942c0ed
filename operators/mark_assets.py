"""Offers a twin in Blender's asset browser, with the nodes and materials that show it."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import bpy
from bpy.app.translations import pgettext_rpt as rpt_

from ..dgs_addon.scene.nodes import splat_modifier
from ..dgs_addon.scene.twin import is_twin

#: What is found by in the asset browser.
_TAG = "Descatter"


class DGS_OT_mark_assets(bpy.types.Operator):
    """Offer the twin, its nodes and its materials in the asset browser; the file must be saved in an asset library"""

    bl_idname = "dgs.mark_assets"
    bl_label = "Mark as Assets"
    bl_options = {"REGISTER", "UNDO"}

    @classmethod
    def poll(cls, context: Any) -> bool:
        """A twin is active."""
        cls.poll_message_set("Select a twin first")
        return is_twin(context.object)

    def execute(self, context: Any) -> set[str]:
        """Marks them; what is one already stays as it is."""
        twin = context.object
        count = 0
        for data, words in _parts(twin):
            if not data.asset_data:
                data.asset_mark()
                asset = data.asset_data
                asset.description = words
                asset.tags.new(_TAG)
                count += 1
        if not bpy.app.background:  # (a preview is drawn by a window's own means)
            twin.asset_generate_preview()
        self.report({"INFO"}, rpt_("{count} assets marked").format(count=count))
        return {"FINISHED"}


def _parts(twin: Any) -> Iterator[tuple[Any, str]]:
    """The twin and what shows it, each with a description."""
    count = len(twin.data.vertices)
    yield twin, f"Twin of {count:,} splats"
    modifier = splat_modifier(twin)
    if modifier is None:
        return
    yield modifier.node_group, "Shows points with attributes of Gaussians as splats"
    for node in modifier.node_group.nodes:
        material = next((s.default_value for s in node.inputs if s.type == "MATERIAL"), None)
        if material is not None:
            yield material, "Material of splats"
