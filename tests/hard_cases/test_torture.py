"""Trainings on bad scenes: here a few steps of each; `run_dgs.py stress --torture` runs 500."""

import pytest
from dgs.studies.stability.torture import tortured, tortures

STEPS = 120


@pytest.mark.parametrize("one", list(tortures()), ids=lambda one: one.name)
def test_torture(one):
    outcome = tortured(one, STEPS)
    assert outcome.passed, outcome


def test_there_are_twenty():
    assert len(list(tortures())) == 20


def test_same_seed_same_twin():
    """Two trainings of one process and two thread counts: the very bits."""
    import torch
    from dgs.core import compiled
    from dgs.studies.stability.photographed import small_set, trained_steps

    before, twins = compiled.threads(), []
    for threads in (1, 2, 2):
        compiled.set_threads(threads)
        twins.append(trained_steps(*small_set(), 60, density_every=20).result())
    compiled.set_threads(before)
    for twin in twins[1:]:
        assert all(torch.equal(a, b) for (_, a), (_, b) in zip(twins[0].named(), twin.named(), strict=True))
