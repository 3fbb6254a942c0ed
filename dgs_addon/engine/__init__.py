"""The engine's own Python: where it is, how it gets there, whether it works. Never Blender's own."""
