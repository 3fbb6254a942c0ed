"""Cameras: found from the photos (`find.find_cameras`), or read from a file (`given.load_cameras`).

Nothing is imported here: most modules run in a child process, the only one that loads pycolmap.
"""
