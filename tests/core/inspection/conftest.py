"""A small synthetic scene, drawn once, and photos of it with known effects."""

import numpy as np
import pytest
from dgs.benchmarks import effects as validation
from dgs.benchmarks.effect_scenes import Truth, degrade, make_scene


@pytest.fixture(scope="session")
def scene():
    return make_scene(3, width=240, height=160, views=8, finer=2)


@pytest.fixture(scope="session")
def glossy_scene():
    return make_scene(3, gloss=0.6, width=240, height=160, views=8, finer=2)


@pytest.fixture(scope="session")
def taken(scene):
    """Photos of the scene, with true cameras: `taken(haze=0.3)` is a `PhotoSet`."""
    kept = {}

    def take(**effects):
        key = tuple(sorted(effects.items()))
        if key not in kept:
            kept[key] = validation.photo_set(scene, degrade(scene, Truth(**effects), seed=1))
        return kept[key]

    return take


def picture(size=(256, 320), seed=0):
    """A plane of discs in [0, 1], linear scale-invariant, sharp."""
    from dgs.benchmarks.effect_scenes import dead_leaves

    return dead_leaves(np.random.default_rng(seed))[: size[0], : size[1]].astype(float)
