"""How often the panel is drawn, and what the worker's thread prepares for it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("bpy")

from dgs.core.cloud import GaussianCloud
from dgs.core.twin.begun import RUN
from dgs.dgs_addon.job.preview import ABOVE, read_preview
from dgs.dgs_addon.job.snapshot import SnapshotReader, thinned
from dgs.dgs_addon.window import Pace


def drawings(cost: float, seconds: float = 60.0) -> int:
    """How many drawings a window that takes `cost` seconds for each gets in a minute."""
    pace, now, count = Pace(least=0.5, most=5.0, share=0.05), 0.0, 0
    while now < seconds:
        if pace.due(now):
            pace.asked(now)
            count += 1
            now += cost
            pace.drawn(now)
        now += 0.1
    return count


def test_fast_windows_are_drawn_often_and_slow_ones_seldom() -> None:
    assert 90 <= drawings(0.002) <= 120  # twice a second
    assert 25 <= drawings(0.1) <= 31  # a twentieth of the time
    assert 11 <= drawings(2.0) <= 13  # but every five seconds at least


def test_a_live_twin_has_few_splats_that_still_cover_it() -> None:
    count = 1000
    cloud = GaussianCloud(
        means=np.arange(3 * count, dtype=np.float32).reshape(count, 3),
        log_scales=np.zeros((count, 3), np.float32),
        quaternions=np.ones((count, 4), np.float32),
        opacity_logits=np.zeros(count, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )
    few = thinned(cloud, 250)
    assert len(few) == 250 and few.means[0, 0] == 0.0 and few.means[-1, 2] == 3 * count - 1
    assert np.allclose(np.exp(2 * few.log_scales) * len(few), count)  # the areas' sum stays
    assert few.log_scales.dtype == np.float32 and thinned(cloud, count) is cloud


def test_previews_are_read_upright_and_damaged_ones_are_no_news(tmp_path: Path) -> None:
    folder = tmp_path / RUN / "snapshot"
    folder.mkdir(parents=True)
    reader = SnapshotReader(tmp_path, live=False, most=10)
    assert reader.read_news() is None
    pixels = np.zeros((90, 180, 3), np.uint8)
    pixels[:45] = (255, 0, 0)  # the upper half is red
    np.save(folder / "preview.npy", pixels)
    news = reader.read_news()
    assert news is not None and news.cloud is None and reader.read_news() is None
    assert news.picture.shape == (ABOVE[1], ABOVE[0], 4)
    # Blender's rows go upwards.
    middle = news.picture[:, ABOVE[0] // 2]
    inside = middle[middle[:, 3] > 0]
    assert inside[-1, 0] == 1.0 and inside[0, 0] == 0.0
    (folder / "preview.npy").write_bytes(b"half a file")
    assert reader.read_news() is None
    with pytest.raises((OSError, ValueError)):
        read_preview(folder / "preview.npy")
