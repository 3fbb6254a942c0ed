"""What the add-on puts into a Blender scene: twins, their look, and cameras."""
