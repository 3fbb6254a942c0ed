"""Optional effects of image formation besides the point spread: what the light meets between scene and file.

    scene --(haze, defocus, field blur)--> medium's blur (motion) --(vignetting, exposure)--> clipping --> file

An effect is one file here and one line in `registry`. Off is free: a chain without effects calls nothing at all.
"""
