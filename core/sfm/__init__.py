"""Cameras: found from the photos (`find.find_cameras`), or read from a file (`known.load_cameras`).

Nothing is imported here: the file formats need `reconstruction`, and `find` needs the file formats.
"""
