"""The laboratory: photographs through a known medium of scenes that are known exactly.

Cycles renders a sharp scene; a point spread function then degrades the pictures as the medium
would. `dataset.synthesize` does both; importing it needs no bpy, running it does.
"""
