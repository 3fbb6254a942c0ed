"""Cameras: found from the photos (structure from motion), or read from a file."""

from .find import find_cameras
from .known import load_cameras

__all__ = ["find_cameras", "load_cameras"]
