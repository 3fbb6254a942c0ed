"""The engine: photos in, sharp Gaussians out. Nothing in here knows Blender."""
