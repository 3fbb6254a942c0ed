"""Half of the photos carry the structure; the others find their place in it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from dgs.core.camera import Camera
from dgs.core.evaluation.poses import pose_errors
from dgs.core.sfm import attempts, keyframes, mapping
from dgs.core.sfm.job import read_job, write_job
from dgs.core.sfm.keyframes import Matches, choose_keyframes
from dgs.core.sfm.settings import SfmSettings, recipes
from scipy.ndimage import gaussian_filter

from .test_find_cameras import SIGMA, cameras, kernel, photo, photographed, texture


def ring(count: int, reach: int, matches: int = 100) -> Matches:
    """Photos on a circle, each tied to `reach` neighbours on both sides; nearer ones share more."""
    pairs = {}
    for i in range(count):
        for step in range(1, reach + 1):
            first, second = sorted((i + 1, (i + step) % count + 1))
            pairs[first, second] = np.zeros((matches // step, 2), int)
    names = {i + 1: f"0/{i:04d}.png" for i in range(count)}
    return Matches(names, dict.fromkeys(names, 1), {i: np.zeros((0, 2)) for i in names}, pairs)


def partners(matches: Matches, of: str, among: list[str]) -> int:
    named = [{matches.names[a], matches.names[b]} for a, b in matches.pairs]
    return sum(of in pair and bool((pair - {of}) & set(among)) for pair in named)


def test_half_of_a_ring_is_enough_and_everyone_keeps_partners() -> None:
    matches = ring(60, 5)
    chosen = choose_keyframes(matches, 15)
    assert chosen is not None
    assert 30 <= len(chosen) <= 42
    assert (
        min(partners(matches, name, chosen) for name in matches.names.values()) >= keyframes.SETTINGS.minimum_partners
    )


def test_thousands_of_photos_are_chosen_from_in_seconds() -> None:
    began = time.perf_counter()
    chosen = choose_keyframes(ring(2000, 5), 15)
    assert chosen is not None and 1000 <= len(chosen) <= 1400
    assert time.perf_counter() - began < 20.0


def test_a_photo_that_shares_nothing_is_no_key_photo() -> None:
    matches = ring(60, 5)
    matches.names[99] = "0/blank.png"
    chosen = choose_keyframes(matches, 15)
    assert chosen is not None and "0/blank.png" not in chosen


def test_a_chain_keeps_all_its_photos() -> None:
    assert choose_keyframes(ring(60, 1), 15) is None


def test_weak_pairs_are_no_partners() -> None:
    assert choose_keyframes(ring(60, 5, matches=40), 30) is None


def test_two_rings_stay_tied_together() -> None:
    one = ring(40, 5)
    two = {(a + 40, b + 40): found for (a, b), found in one.pairs.items()}
    names = {i: f"0/{i:04d}.png" for i in range(1, 81)}
    bridge = {(20, 60): np.zeros((50, 2), int)}
    both = Matches(names, dict.fromkeys(names, 1), {i: np.zeros((0, 2)) for i in names}, one.pairs | two | bridge)
    chosen = choose_keyframes(both, 15)
    assert chosen is not None
    assert {names[20], names[60]} <= set(chosen)


def test_the_others_find_their_place(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """In this process, to see which way was taken; the photos left out come as close as the mapped ones."""
    textures = [texture(1), texture(2)]
    truth = cameras(16)
    blurred = [photo(name, gaussian_filter(photographed(c, textures), SIGMA, truncate=5)) for name, c in truth.items()]
    names = write_job(blurred, kernel(SIGMA), SfmSettings(many=12, many_features=3000, choose_pairs_from=100), tmp_path)
    job = read_job(tmp_path)
    mapped: list[list[str] | None] = []
    usual = mapping.map_incrementally

    def noted(*given: Any) -> list[Any]:
        mapped.append(given[-1] if len(given) == 7 else None)
        return usual(*given)

    monkeypatch.setattr(mapping, "map_incrementally", noted)
    joined: list[int] = []
    model, _ = attempts._try(
        job, attempts.lighter(recipes(True)[0], job), 0, lambda **said: joined.append(said.get("joined", 0))
    )
    assert len(mapped) == 1
    assert mapped[0] is not None
    assert len(mapped[0]) < 16
    assert model.num_reg_images() == 16
    assert max(joined) == 14  # the first two join at once
    found = {}
    for image in model.images.values():
        name, pose = names[image.name], image.cam_from_world()
        lens = model.cameras[image.camera_id]
        focal = lens.mean_focal_length()
        found[name] = Camera(
            name, lens.width, lens.height, focal, focal, 200, 150, pose.rotation.matrix(), pose.translation
        )
    errors = pose_errors(found, truth, np.zeros((1, 3)))
    key = np.array([name in {names[n] for n in mapped[0]} for name in errors.names])
    assert np.median(errors.centre_px[key]) < 0.1
    # By matches alone, without the patches, it is 0.17 px.
    assert np.median(errors.centre_px[~key]) < 0.13
