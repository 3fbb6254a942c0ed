"""What else lies between the scene and each photo: exposure, focus, frosted glass, a kernel: learned with the twin."""
