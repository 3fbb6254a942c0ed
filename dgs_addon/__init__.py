"""The Blender side below its buttons and panels.

axes, paths, photos, window, translations, manual   what all packages here use
engine/       the engine's own Python: where it is, how it is installed, how it is started and asked
scene/        a twin as an object: attributes, geometry nodes, material, cameras, size and up
drawing/      what the engine sees, in Blender: the picture server, the render engine, live splats
job/          one run of the engine in a process beside Blender, and the settings that it reads
questions/    what the engine is asked besides jobs: inspection, estimate, exact view
laboratory/   Cycles renders photos of a known object through a known medium

Each package imports those above it in this list only. `operators` and `panels` stand on all of them;
`panels.registration` brings everything into Blender. Without Blender, the command line reads `laboratory`,
`engine.handover` and `scene.save_blend`.
"""
