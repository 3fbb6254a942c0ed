"""The add-on's texts in other languages than English: languages/LOCALE.json, English text to translation.

Texts with figures hold places for them ('{count} photos'): code translates first and fills in then, so
that a language may change their order. What the engine says has a table of its
own (`engine_sentences`); its log and its reports stay English.
A new language is a new file.
"""

from __future__ import annotations

import json
from pathlib import Path

import bpy

LANGUAGES = Path(__file__).with_name("languages")


def table(locale: str) -> dict[str, str]:
    """English texts and their translations."""
    words: dict[str, str] = json.loads((LANGUAGES / f"{locale}.json").read_text("utf-8"))
    return words


def messages() -> dict[str, dict[tuple[str, str], str]]:
    """By locale: translations by (context, English text), as Blender wants them.

    Operators' names have a context of their own in Blender; all else has the usual one.
    """
    return {
        path.stem: {(context, text): word for text, word in table(path.stem).items() for context in ("*", "Operator")}
        for path in sorted(LANGUAGES.glob("*.json"))
    }


def register_translations() -> None:
    """Hands them to Blender."""
    bpy.app.translations.register(__name__, messages())


def unregister_translations() -> None:
    """Takes them out again."""
    bpy.app.translations.unregister(__name__)
