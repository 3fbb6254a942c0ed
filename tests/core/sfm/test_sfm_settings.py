"""What structure from motion is asked for: recipes in their order, settings that travel to the child."""

from __future__ import annotations

import json

import pytest
from dgs.core.sfm.settings import Recipe, RefineSettings, SfmSettings, recipes


@pytest.mark.parametrize(
    ("blurred", "wanted"),
    [
        (
            True,
            [
                ("filtered", 3e-4, 0.02 / 3, 0, 3000, 15, 100, 30, 0.25),
                ("relaxed filter", 1e-4, 0.004, 0, 4000, 10, 40, 15, 0.15),
                ("strong filter", 1e-3, 0.004, 0, 4000, 10, 40, 15, 0.15),
                ("unfiltered", 0.0, 0.0015, -1, 5000, 10, 40, 15, 0.15),
            ],
        ),
        (
            False,
            [
                ("plain", 0.0, 0.02 / 3, 0, 4000, 15, 100, 30, 0.25),
                ("faint", 0.0, 0.0015, 0, 4000, 12, 100, 30, 0.25),
                ("thorough", 0.0, 0.02 / 3, -1, 4000, 15, 100, 30, 0.25),
                ("relaxed", 0.0, 0.0015, -1, 5000, 10, 40, 15, 0.15),
            ],
        ),
    ],
)
def test_recipes_ask_for_less_and_less(blurred: bool, wanted: list[tuple[object, ...]]) -> None:
    """Changed together, on the sets that they were tried on."""
    found = [
        (r.name, r.noise_to_signal, r.peak_threshold, r.first_octave, r.max_features, r.min_inliers, r.init_inliers,
         r.pose_inliers, r.pose_ratio)
        for r in recipes(blurred)
    ]  # fmt: skip
    assert found == wanted
    assert all(r.guided and r.seed == 0 and r.image_size == 0 and r.reason for r in recipes(blurred))
    assert [r.name for r in recipes(blurred) if r.every_pair] == ([] if blurred else ["thorough"])
    assert [r.name for r in recipes(blurred) if r.for_missing] == ([] if blurred else ["faint", "thorough"])


def test_settings_travel_and_may_be_hurried_or_left_out() -> None:
    said = SfmSettings()
    assert (said.threads, said.lens_model, said.one_lens) == (2, "SIMPLE_RADIAL", True)
    assert said.refine == RefineSettings() and (said.refine_many.rounds, said.refine_many.observations_per_photo) == (
        1,
        400,
    )
    changed = SfmSettings(threads=5, one_lens=False, refine=RefineSettings(radius=9))
    assert SfmSettings.from_json(json.loads(json.dumps(changed.as_json()))) == changed
    hurried = said.hurried()
    assert hurried.refine.observations_per_photo == said.hurried_observations < said.refine.observations_per_photo
    assert hurried.refine_many == said.refine_many
    bare = said.unrefined()
    assert (bare.refine.rounds, bare.refine_many.rounds) == (0, 0) and bare.refine_many.observations_per_photo == 400
    assert Recipe("a", "b").guided and Recipe("a", "b").seed == 0
