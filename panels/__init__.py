"""Panels of the sidebar tab 'Descatter'; `CLASSES` in the order in which they are registered."""

from __future__ import annotations

from .twin import DGS_PT_twin, DGS_PT_twin_look

CLASSES: tuple[type, ...] = (DGS_PT_twin, DGS_PT_twin_look)
