"""Image formation besides the point spread: what an effect can do, and the chain of them around the medium's blur.

    scene --(light)--> medium's blur (kernel) --(sensor)--> clipping --> file

The effects themselves are in `core.effects`. Off is free: a chain without effects calls nothing at all.
"""
