"""Shaken photos, restored around the twin, and the part of a run that fits new Gaussians to them."""
