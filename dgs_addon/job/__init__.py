"""One piece of work of the engine, run in a process of its own beside Blender.

request   what the engine is asked to do, as a command line
worker    the process and the thread that reads it; knows no Blender
state     what is known of a job, event by event; knows no Blender
ending    what an exit status means, in a sentence
record    job.json beside the results: what a later Blender needs to go on
runner    the one job of this Blender: a timer that drains the worker's queue on the main thread
pictures, curve   what the panel shows while it runs
test_set  a job that renders photos whose truth is known
results   what a finished job puts into the scene
"""
