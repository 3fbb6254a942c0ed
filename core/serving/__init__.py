"""Pictures of twins for a program that draws them again and again, such as Blender.

shared_area   memory that both processes see, which is gone when both have ended
messages      what is asked and answered, one JSON object a line
shown_rows    which of a twin's splats are shown
stage         twins moved, turned, scaled and cropped, as one set of Gaussians
picture       a camera's view of the stage as rows of pixels
server        the loop of the process

`shared_area`, `messages` and `shown_rows` are read by Blender's own Python: they need numpy only.
"""
