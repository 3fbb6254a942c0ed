"""Photos: read, and turned into pinhole views."""

from .undistort import undistorted_views

__all__ = ["undistorted_views"]
