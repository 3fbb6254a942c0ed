"""From photos with cameras to Gaussians: `run.train` is the door, `job.TrainingJob` and `settings` what it is given.

Nothing is imported here: whoever renders needs a few kernels of this folder, and not the trainer.
"""
