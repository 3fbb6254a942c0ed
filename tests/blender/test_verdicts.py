"""The verdict in the user's language: every sentence that the engine may say is recognised, and nothing else."""

from __future__ import annotations

import re
from dataclasses import replace
from itertools import product

import pytest

bpy = pytest.importorskip("bpy")

from dgs.core.report.verdict import Verdict, verdict  # noqa: E402
from dgs.dgs_addon import verdicts  # noqa: E402
from dgs.dgs_addon.translations import table  # noqa: E402
from dgs.tests.core.report.scored_views import NAMES, ring_of, scored  # noqa: E402

GERMAN = table("de_DE")
#: Shares, angles and names in a sentence.
FIGURES = re.compile(r"[\d.]+ %|\d+°|\d\.png")


def said_by_the_engine() -> list[Verdict]:
    """Verdicts of all kinds, with all that may help."""
    rising = [{"step": i, "heldout_psnr": 20.0 + i} for i in range(8)]
    ring, wide = ring_of(5.0), ring_of(40.0)
    doubted = replace(ring, figures=replace(ring.figures, doubted=0.16))
    found = [verdict([], [], ring, []), verdict([scored("0.png", 0.03)], [], ring, [])]
    for unseen, fitted in product((0.005, 0.05, 0.12, 0.5), (0.02, 0.4)):
        for cameras in (ring, wide, doubted):
            found.append(verdict([scored("0.png", unseen)], [scored(name, fitted) for name in NAMES[1:]], cameras, []))
    found.append(verdict([scored("0.png", 0.5, matched_gain=2.0)], [scored("1.png", 0.3)], ring, rising))
    alone = replace(wide, poses={name: wide.poses[name] for name in NAMES[:2]})
    return [*found, verdict([scored("0.png", 0.5)], [scored("1.png", 0.01)], alone, [])]


@pytest.fixture
def german(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(verdicts, "iface_", lambda text: GERMAN[text])


def test_every_sentence_of_the_engine_is_said_in_german(german: None) -> None:
    reached = set()
    for found in said_by_the_engine():
        for text in (found.sentence, *found.help):
            matching = [s for s, pattern in verdicts._patterns() if pattern.fullmatch(text)]
            assert matching, text
            reached.add(matching[0])
            anew = verdicts.in_users_language(text)
            assert anew != text and FIGURES.findall(anew) == FIGURES.findall(text)
    assert reached == set(verdicts.SENTENCES), "a sentence that the engine no longer says"


def test_in_english_they_stay_as_they_are() -> None:
    for found in said_by_the_engine():
        for text in (found.sentence, *found.help, "Something else {entirely}", ""):
            assert verdicts.in_users_language(text) == text


def test_all_have_a_translation_with_the_same_places() -> None:
    for sentence in verdicts.SENTENCES:
        assert sorted(re.findall(r"{\w+}", GERMAN[sentence])) == sorted(re.findall(r"{\w+}", sentence))
