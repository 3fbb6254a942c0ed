"""Twins as the engine sees them, in Blender: final pictures, Rendered mode, live splats over the scene.

The engine draws in a process of its own (`core.serving`), which is started when it is first needed and kept warm.
Nothing here waits for it on the main thread, but a final picture does.
"""
