"""The add-on's texts in other languages than English.

Texts with figures hold places for them ('{count} photos'): code translates first and fills in then, so
that a language may change their order. What the engine itself says stays English, like its log.
A new language is a table like `GERMAN`, and a line in `messages`.
"""

from __future__ import annotations

import bpy

GERMAN = {
    "Optimize": "Optimieren",
}


def messages() -> dict[str, dict[tuple[str, str], str]]:
    """By locale: translations by (context, English text), as Blender wants them.

    Operators' names have a context of their own in Blender; all else has the usual one.
    """
    tables = {"de_DE": GERMAN}
    return {
        locale: {(context, text): word for text, word in table.items() for context in ("*", "Operator")}
        for locale, table in tables.items()
    }


def register_translations() -> None:
    """Hands them to Blender."""
    bpy.app.translations.register(__name__, messages())


def unregister_translations() -> None:
    """Takes them out again."""
    bpy.app.translations.unregister(__name__)
