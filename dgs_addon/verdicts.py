"""The engine's verdict on a twin in the user's language.

The engine speaks English, in its log and its reports. What it says of a twin stands in the panel for good, so those
sentences are recognised and said anew; one that is not is shown as it is.
"""

from __future__ import annotations

import re
from functools import lru_cache

from bpy.app.translations import pgettext_iface as iface_

_EXPLAINED = "{unseen} of what unseen photos show, {fitted} of what fitted ones show"

#: The engine's sentences (`core.report.verdict`), with places for their figures and names.
SENTENCES = (
    f"The twin predicts photos that it has not seen: it explains {_EXPLAINED}.",
    f"The twin predicts less well photos that it has not seen: it explains {_EXPLAINED}. "
    "Between its photos it is less exact than before them.",
    f"The twin hardly predicts photos that it has not seen: it explains {_EXPLAINED}. "
    "Between its photos it is not to be trusted.",
    f"The twin explains its own photos only in part, and unseen ones alike: {_EXPLAINED}.",
    "No photo was held out, so nothing says how well the twin predicts photos that it has not seen.",
    "No photo could be scored, so nothing says how well the twin predicts photos that it has not seen.",
    "Hold photos out (--holdout-every 8)",
    "The cameras may be wrong: {share} of the pairs of photos contradict them, as where two places look alike. "
    "Take photos nearer to one another, or give cameras (--cameras)",
    "Take photos between {first} and {second}: they look from {angle}° apart or more",
    "Take photos between {first}: they look from {angle}° apart or more",
    "The photos differ in exposure ({gain} dB): lock it while photographing, or use --effects auto",
    "The training was still getting better: give it more time (--preset best, --time-limit)",
    "Mask what moved between the photos (--masks), and check the cameras and the blur that were given",
    "Take more photos of the places that are named, from directions between the present ones",
)


def in_users_language(text: str) -> str:
    """One of the engine's sentences as the panel says it; the same text where it is none that is known."""
    for sentence, pattern in _patterns():
        found = pattern.fullmatch(text)
        if found is not None:
            return iface_(sentence).format(**found.groupdict())
    return text


@lru_cache(maxsize=1)
def _patterns() -> list[tuple[str, re.Pattern[str]]]:
    """Each sentence and what recognises it."""
    found = []
    for sentence in SENTENCES:
        parts = re.split(r"{(\w+)}", sentence)  # words and names of places by turns
        of_places = [f"(?P<{part}>.+)" if i % 2 else re.escape(part) for i, part in enumerate(parts)]
        found.append((sentence, re.compile("".join(of_places))))
    return found
