"""Advice does not take new Gaussians' own rise for a training that was cut short."""

from types import SimpleNamespace

import dgs.core.report.verdict as module
import pytest
from dgs.core.report.verdict import VERDICT

RISING = "still getting better"


def advice(history, monkeypatch):
    monkeypatch.setattr(module, "_gain_of_exposure", lambda score: 0.0)
    cameras = SimpleNamespace(figures=SimpleNamespace(doubted=0.0))
    return module._help([SimpleNamespace(name="a")], [], cameras, history, 0.0, VERDICT)


def rows(scores, restored=()):
    return [
        {"step": index, "heldout_psnr": score, **({"restored": 1.0} if index in restored else {})}
        for index, score in enumerate(scores)
    ]


@pytest.mark.parametrize("restored", [(), (8, 9, 10, 11)])
def test_a_rise_after_new_gaussians_is_no_reason_to_train_longer(restored, monkeypatch):
    scores = [25.0] * 8 + [20.0, 22.0, 23.0, 24.0] + [25.0, 25.1, 25.1]
    said = advice(rows(scores, restored), monkeypatch)
    assert any(RISING in one for one in said) == (not restored)


def test_a_rise_since_then_is_one(monkeypatch):
    scores = [20.0, 21.0, 22.0, 23.0, 24.0, 25.0, 26.0, 27.0]
    assert any(RISING in one for one in advice(rows(scores, restored=(0, 1)), monkeypatch))
