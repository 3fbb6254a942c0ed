"""Which pairs of photos are worth matching, from a few features each."""

from __future__ import annotations

from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ..colmap_library import pycolmap
from ..numbers import BY_DEFINITION, number
from .features import UNIT
from .settings import SfmSettings


@dataclass(frozen=True)
class PairSettings:
    """Of the choice of pairs; more of them are in `SfmSettings` (votes and partners)."""

    distinct: float = number(
        0.85,
        "ratio",
        "a vote must be nearer than the second best by this; Lowe 2004 takes 0.8 for matches, and votes may be vaguer",
    )
    neighbours: tuple[int, ...] = number(
        (1, 2, 4),
        "places in the order of names",
        "photos that are matched in any case: they are usually taken in this order",
    )
    worthwhile: float = number(
        0.7, "share", "of all pairs; if more were chosen, all are matched: choosing then saves no time", BY_DEFINITION
    )


SETTINGS = PairSettings()


def choose_pairs(database: Path, settings: SfmSettings) -> list[tuple[str, str]] | None:
    """Pairs that look as if they overlap.

    Every photo's largest features (they survive blur and change of distance) are matched against
    those of every other photo by one matrix product; mutual nearest neighbours are votes. Each
    photo keeps its best partners, and some spread over the rest of those that clearly beat chance,
    so that a long row of photos is tied together over wide baselines as well.

    Returns:
        Pairs of image names, or None if nearly all pairs were chosen anyway.
    """
    names, features = _largest_features(database, settings.vote_features)
    votes = _votes(features, settings.threads)
    count = len(names)
    chance = float(np.median(votes[np.triu_indices(count, 1)]))
    chosen: set[tuple[int, int]] = set()
    partners = settings.partners if count < settings.many else settings.many_partners
    near = partners // 2
    for i in range(count):
        order = [int(j) for j in np.argsort(-votes[i], kind="stable") if j != i]
        better = [j for j in order[near:] if votes[i, j] > max(chance, settings.minimum_votes)]
        spread = [better[k] for k in np.linspace(0, len(better) - 1, partners - near).astype(int)] if better else []
        for j in order[:near] + spread:
            chosen.add((min(i, j), max(i, j)))
    # Photos are usually taken in the order of their names.
    chosen |= {(i, i + step) for step in SETTINGS.neighbours for i in range(count - step)}
    if len(chosen) > SETTINGS.worthwhile * count * (count - 1) / 2:
        return None
    return [(names[i], names[j]) for i, j in sorted(chosen)]


def _largest_features(database: Path, keep: int) -> tuple[list[str], list[NDArray[np.float32]]]:
    names, features = [], []
    with pycolmap.Database.open(database) as store:
        for image in sorted(store.read_all_images(), key=lambda i: i.name):
            points = store.read_keypoints(image.image_id)
            descriptors = np.asarray(store.read_descriptors(image.image_id).data, np.float32)
            size = np.hypot(points[:, 2], points[:, 4]) if points.shape[1] >= 6 else points[:, 2]
            largest = np.argsort(-size, kind="stable")[:keep]
            chosen = descriptors[largest] / UNIT
            names.append(image.name)
            features.append(chosen)
    return names, features


def _votes(features: list[NDArray[np.float32]], threads: int) -> NDArray[np.float64]:
    """[V, V] number of mutual nearest neighbours with a distinct similarity."""
    count = len(features)
    votes = np.zeros((count, count))

    def row(i: int) -> None:
        for j in range(i + 1, count):
            a, b = features[i], features[j]
            if len(a) < 2 or len(b) < 2:
                continue
            similar = a @ b.T
            best = similar.argmax(1)
            rows = np.arange(len(a))
            mutual = similar.argmax(0)[best] == rows
            top = similar[rows, best].copy()
            similar[rows, best] = -1.0
            second = similar.max(1)
            distance, rival = np.sqrt(np.maximum(2 - 2 * top, 0)), np.sqrt(np.maximum(2 - 2 * second, 0))
            votes[i, j] = votes[j, i] = float((mutual & (distance < SETTINGS.distinct * rival)).sum())

    with ThreadPoolExecutor(threads) as pool:
        list(pool.map(row, range(count)))
    return votes
