"""Panels of the sidebar tab 'Descatter'; `CLASSES` in the order in which they are registered."""

from __future__ import annotations

from .cameras import DGS_PT_cameras
from .edit import DGS_PT_twin_edit
from .images import DGS_PT_images
from .main import DGS_PT_main
from .measure import DGS_PT_twin_measure, DGS_UL_measures
from .medium import DGS_PT_medium
from .optimize import DGS_PT_optimize
from .presets import DGS_PT_presets
from .render_settings import RENDER_PT_descatter, VIEWLAYER_PT_descatter_passes
from .thumbnails import forget_thumbnails
from .twin import DGS_PT_twin, DGS_PT_twin_look
from .validate import DGS_PT_validate

CLASSES: tuple[type, ...] = (
    DGS_PT_presets,
    DGS_PT_main,
    DGS_PT_images,
    DGS_PT_cameras,
    DGS_PT_medium,
    DGS_PT_optimize,
    DGS_PT_twin,
    DGS_PT_twin_look,
    DGS_PT_twin_measure,
    DGS_PT_twin_edit,
    DGS_PT_validate,
    RENDER_PT_descatter,
    VIEWLAYER_PT_descatter_passes,
)

#: Lists that panels draw.
LISTS: tuple[type, ...] = (DGS_UL_measures,)

__all__ = ["CLASSES", "LISTS", "forget_thumbnails"]
