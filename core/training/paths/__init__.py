"""The way a camera went in each exposure, and what follows from it of the camera itself: learned with the twin."""
