"""Media that Cycles renders as they are: shaken cameras, lenses, rough glass, fog. One file each, and `registry`.

A medium says for each photo what is true of it (`Medium.plan`, numpy only, written into the manifest), and sets
the scene for it (`Medium.standing` for all photos, `Medium.photo` for one). Nothing here is a convolution.
"""
