"""Effects: one file each, with its simulation, its evidence, how it is built from photos, and its words.

    light --(haze, defocus, field blur)--> medium's blur (motion) --(vignetting, exposure)--> clipping --> file

A new effect is a file here, its test, and a line in `registry` (docs/extending.md). A simulation alone (what a training
needs) is an `imaging.formation.effect.Effect`; the training and the forward model know no more than that.
These files load neither numpy nor torch, so that the command line's help and Blender's panel can list them.
"""
