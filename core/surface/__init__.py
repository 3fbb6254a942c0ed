"""A first surface where cameras are known: carved, swept by planes, checked between photos, and made one set of points.

`find.surface_points` is the door. The photos are looked at small; whatever a blur took is given back first.
"""
