"""Photos: files and movies in, pinhole views out (`undistort.undistorted_views`)."""
