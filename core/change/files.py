"""What `change` writes. Needs no package: Blender reads it, too."""

from __future__ import annotations

#: What has changed as data, as a table, as a picture, and as a mesh of the first twin's surface in colours.
REPORT, TABLE, PICTURE, MESH = "change.json", "change.csv", "change.png", "change.glb"
FILES = (REPORT, TABLE, PICTURE, MESH)
