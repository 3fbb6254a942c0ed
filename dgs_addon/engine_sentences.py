"""What the engine says, in the user's language: its errors with their ways out, and its verdict on a twin.

The engine speaks English, in its log, its reports and its errors. What of it stands in the panel or in Blender's status
bar is recognised and said anew: languages/engine/LOCALE.json holds the engine's sentences, with places for figures and
names, and what they are in that language. One that is not known is shown as it is.
A table is read when the first sentence is to be said in its language, so that nobody waits for it who reads English.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache

import bpy

from .translations import LANGUAGES

#: Tables of the engine's sentences, by language.
TABLES = LANGUAGES / "engine"
#: What stands in a place of this name is the engine's own too, and said anew.
WORDS = "words"
_PLACE = re.compile(r"{(\w+)}")
#: Texts that are remembered: the panel is drawn again and again.
_REMEMBERED = 256
#: Where one sentence of the engine ends and the next begins, and how often at most a text is looked at for that.
_END, _MOST_ENDS = ". ", 20


@dataclass(frozen=True)
class Sentence:
    """A sentence of the engine, and how to say it.

    Attributes:
        parts: its words before, between and after the places; names: of the places, one fewer.
        anew: the same in another language, with places of the same names.
    """

    parts: tuple[str, ...]
    names: tuple[str, ...]
    anew: str

    @classmethod
    def parse(cls, english: str, anew: str) -> Sentence:
        """Of a line of a table."""
        words = _PLACE.split(english)  # words and names by turns
        return cls(tuple(words[::2]), tuple(words[1::2]), anew)

    @property
    def letters(self) -> int:
        """How many letters of a text this sentence fixes: of two that fit, the one that fixes more says more."""
        return sum(map(len, self.parts))

    def places(self, text: str) -> dict[str, str] | None:
        """What stands in its places, if `text` is this sentence; each is as short as can be, and never empty."""
        first, last = self.parts[0], self.parts[-1]
        if not self.names:
            return {} if text == first else None
        if not (text.startswith(first) and text.endswith(last)):
            return None
        found, begin, end = [], len(first), len(text) - len(last)
        for part in self.parts[1:-1]:
            until = text.find(part, begin + 1, end)
            if until < 0:
                return None
            found.append(text[begin:until])
            begin = until + len(part)
        return dict(zip(self.names, [*found, text[begin:end]], strict=True)) if begin < end else None

    def filled(self, places: Mapping[str, str]) -> str:
        """The other language's sentence with these in its places."""
        return _PLACE.sub(lambda place: places[place[1]], self.anew)


def in_users_language(text: str) -> str:
    """What the engine says, in the language of Blender's interface; the same text where it is not known.

    Args:
        text: one sentence or several, such as an error and the way out.
    """
    locale = _locale()
    return _anew(text, locale)[0] if locale and text else text


def _locale() -> str:
    """The language of Blender's interface; '' where nothing is translated."""
    return str(bpy.app.translations.locale) if bpy.context.preferences.view.use_translate_interface else ""


@lru_cache(maxsize=8)
def sentences(locale: str) -> tuple[Sentence, ...]:
    """All that are known in a language, those that fix most letters first; none where there is no table."""
    file = TABLES / f"{locale}.json"
    if not file.is_file():
        return ()
    table: dict[str, str] = json.loads(file.read_text("utf-8"))
    return tuple(sorted((Sentence.parse(*line) for line in table.items()), key=lambda one: -one.letters))


@lru_cache(maxsize=_REMEMBERED)
def _anew(text: str, locale: str, ends: int = _MOST_ENDS) -> tuple[str, int]:
    """A text in a language, and how many of its letters are known: of all ways to part it, the one of most."""
    best = _one_anew(text, locale)
    begin = text.find(_END)
    while begin >= 0 and ends > 0:
        first, rest = _one_anew(text[:begin], locale), _anew(text[begin + len(_END) :], locale, ends - 1)
        if first[1] + rest[1] > best[1]:
            best = first[0] + _END + rest[0], first[1] + rest[1]
        begin, ends = text.find(_END, begin + 1), ends - 1
    return best


@lru_cache(maxsize=_REMEMBERED)
def _one_anew(text: str, locale: str) -> tuple[str, int]:
    """One sentence in a language, and how many of its letters are known: 0 where it is not."""
    best = text, 0
    for ending in ("", ".") if text.endswith(".") else ("",):  # (a few sentences have a full stop of their own)
        said = _said(text.removesuffix(ending), locale)
        if said is not None and said[1] > best[1]:
            best = said[0] + ending, said[1]
    return best


def _said(text: str, locale: str) -> tuple[str, int] | None:
    """What the first sentence that fits says, and how many letters are known; None where none fits."""
    for sentence in sentences(locale):
        places = sentence.places(text)
        if places is not None:
            words, known = _anew(places[WORDS], locale) if WORDS in places else ("", 0)
            return sentence.filled({**places, WORDS: words}), sentence.letters + known
    return None
