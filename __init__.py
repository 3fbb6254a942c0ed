"""Descattering Gaussian splatting (DGS): a sharp 3D twin from blurred photos.

Blender calls `register` and `unregister`; everything that needs bpy is imported inside them, so
that tests and the engine can import this package where there is no Blender.
"""


def register() -> None:
    """Adds the add-on's operators, panels and properties to Blender."""
    from .panels import registration  # late: needs bpy

    registration.register()


def unregister() -> None:
    """Takes everything out again that `register` added."""
    from .panels import registration  # late: needs bpy

    registration.unregister()
