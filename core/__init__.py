"""The engine: photos in, sharp Gaussians out. Nothing in here depends on Blender."""
