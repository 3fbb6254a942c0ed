"""The verdict on a twin, from scores whose answer is known."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from dgs.core.evaluation.view_scores import ViewScores
from dgs.core.report.verdict import verdict
from dgs.tests.core.report.scored_views import NAMES, ring_of, scored


def test_the_share_left_unexplained_is_the_error_over_the_variance() -> None:
    score = scored("a", 0.04, part=8)
    assert score.unexplained is not None and abs(score.unexplained - 0.04) < 1e-4
    assert score.parts is not None and score.parts[8] == 1.0 and sum(score.parts) == 1.0


def test_a_mask_keeps_errors_out_of_the_share() -> None:
    photo = np.random.default_rng(1).uniform(0, 1, (30, 30, 3))
    render, mask = photo.copy(), np.ones((30, 30), bool)
    render[:10], mask[:10] = 1.0, False
    score = ViewScores("a")
    score.add_photo(render, photo, mask, 20.0)
    assert score.unexplained == 0.0


def test_a_photo_of_one_colour_has_no_share() -> None:
    score = ViewScores("a")
    score.add_photo(np.full((9, 9, 3), 0.4), np.full((9, 9, 3), 0.5), None, 20.0)
    assert score.unexplained is None
    assert verdict([score], [score], ring_of(5.0), []).level == "unknown"


def test_as_good_on_unseen_photos_as_on_fitted_ones() -> None:
    found = verdict([scored("0.png", 0.03)], [scored("1.png", 0.02)], ring_of(5.0), [])
    assert found.level == "good" and found.help == () and found.views == ()
    assert "97.0 % of what unseen photos show" in found.sentence


def test_remembered_photos_are_no_scene() -> None:
    """Three dB worse is doubted; six dB worse is not believed, unless nine tenths are explained all the same."""
    fitted = [scored("1.png", 0.02)]
    assert verdict([scored("0.png", 0.05)], fitted, ring_of(5.0), []).level == "doubtful"
    found = verdict([scored("0.png", 0.09)], fitted, ring_of(5.0), [])
    assert found.level == "doubtful" and "less exact" in found.sentence
    found = verdict([scored("0.png", 0.12)], fitted, ring_of(5.0), [])
    assert found.level == "poor" and "not to be trusted" in found.sentence


def test_next_to_nothing_left_is_good_whatever_the_ratio() -> None:
    assert verdict([scored("0.png", 0.008)], [scored("1.png", 0.0001)], ring_of(5.0), []).level == "good"


def test_views_far_from_all_others_ask_for_photos_between() -> None:
    fitted = [scored(name, 0.01) for name in NAMES[1:]]
    found = verdict([scored("0.png", 0.2, part=0)], fitted, ring_of(40.0), [])
    assert "0.png" in found.views[0] and "upper left" in found.views[0] and "40° from" in found.views[0]
    assert found.help[0].startswith("Take photos between 1.png")


def test_what_else_would_help_is_said() -> None:
    rising = [{"step": i, "heldout_psnr": 20.0 + i} for i in range(8)]
    unseen, fitted = [scored("0.png", 0.5, matched_gain=2.0)], [scored("1.png", 0.3)]
    found = verdict(unseen, fitted, ring_of(5.0), rising)
    said = " ".join(found.help)
    assert "exposure" in said and "more time" in said and "--masks" in said


def test_without_photos_held_out_nothing_is_claimed() -> None:
    found = verdict([], [], ring_of(5.0), [])
    assert found.level == "unknown" and "--holdout-every" in found.help[0]


def test_photos_that_could_not_be_scored_are_not_called_none() -> None:
    found = verdict([scored("0.png", 0.03)], [], ring_of(5.0), [])
    assert found.level == "unknown" and "could be scored" in found.sentence and found.help == ()


def test_cameras_that_pairs_of_photos_contradict_are_named_first() -> None:
    ring = ring_of(5.0)
    doubted = replace(ring, figures=replace(ring.figures, doubted=0.16))
    found = verdict([scored("0.png", 0.6)], [scored("1.png", 0.5)], doubted, [])
    assert found.level == "poor" and found.help[0].startswith("The cameras may be wrong: 16 % of the pairs")
    assert not any("may be wrong" in line for line in verdict([scored("0.png", 0.6)], [], ring, []).help)
