"""One piece of work of the engine, run in a process of its own beside Blender.

properties   `scene.dgs`: the settings of all steps
request      what the engine is asked to do, as a command line
worker       the process and the thread that reads it; without Blender
state        where a job stands, event by event, and what its end means; without Blender
record       job.json beside the results: what a later Blender needs to go on
snapshot, preview   the twin so far and its picture, read on the worker's thread
job          all of these together
runner       the one job of this Blender: a timer that drains the worker's queue on the main thread
pictures     what the panel shows while it runs
results      what a finished job puts into the scene
steps        where each step of the panel stands, read from the results' folder
test_set     a job that renders photos with a known truth
watching     a folder whose new photos start an update
"""
