"""The parts of a run that restores its photos."""

import numpy as np
import pytest
from dgs.core.training.restored.course import COURSE, Part, edges, part_of


def test_a_run_that_restores_nothing_is_one_part():
    assert [part_of(share, restores=False) for share in (0.0, 0.7, 1.0)] == [Part(0.0), Part(0.7), Part(1.0)]
    assert edges(0.5, restores=False) == [0.5]


def test_each_part_goes_its_whole_way():
    shares = np.linspace(0, 1, 4001)
    parts = [part_of(share, restores=True) for share in shares]
    restored = np.array([part.restored for part in parts])
    assert restored.mean() == pytest.approx(COURSE.end - COURSE.begin, abs=1e-3)
    first = np.flatnonzero(restored)[0]
    before, within = (np.array([p.share for p in part]) for part in (parts[:first], parts[first:][: restored.sum()]))
    for course in (before, within):
        assert course[0] == pytest.approx(0.0, abs=1e-2) and course[-1] == pytest.approx(1.0, abs=1e-2)
        assert (np.diff(course) > 0).all()


def test_a_run_ends_as_every_other():
    """So its step sizes come to rest as they do anywhere."""
    assert part_of(COURSE.end, restores=True) == Part(COURSE.end)
    assert part_of(1.0, restores=True) == Part(1.0)


def test_steps_change_where_parts_do():
    assert edges(0.5, restores=True) == [0.5 * COURSE.begin, COURSE.begin, COURSE.end]
