"""Who draws 3D views: the graphics card, by a shader, or the engine in its process.

A program that stands in for a card is no card: where Mesa's llvmpipe did, the shader's picture took several times as
long as the engine's own (docs/blender.md). The preference "Draw With" overrules it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import bpy
import gpu
from bpy.app.translations import pgettext_rpt as rpt_

from ...core.errors import DeviceError
from ..engine.interpreter import preferences, why_not
from ..engine_sentences import in_users_language
from .card import Card

#: Words in the names of programs that stand in for a graphics card.
_PROGRAMS = (
    "llvmpipe",
    "softpipe",
    "swrast",
    "lavapipe",
    "swiftshader",
    "software",
    "microsoft basic render",
    "gdi generic",
)
AUTOMATIC, CARD, ENGINE = "AUTO", "CARD", "ENGINE"


@dataclass(frozen=True)
class Drawer:
    """Who draws.

    Attributes:
        card: whether it is the graphics card.
        why: in a sentence, without a full stop.
    """

    card: bool
    why: str


_card: Card | None = None
_failure = ""


def drawer() -> Drawer:
    """Who draws this Blender's 3D views."""
    if bpy.app.background:
        return Drawer(False, rpt_("The engine draws: there is no window"))
    chosen = preferences()
    return choice(AUTOMATIC if chosen is None else chosen.draw_with, _named(), _failure)


def choice(wish: str, named: Sequence[str], failure: str = "") -> Drawer:
    """Who draws, by the preference and what the system says of its card.

    Args:
        wish: `AUTOMATIC`, `CARD` or `ENGINE`.
        named: how the card is called, first by its own name; empty where nothing is known.
        failure: why the card could not draw; '' if it can.
    """
    name = named[0] if named else "?"
    if wish == ENGINE:
        return Drawer(False, rpt_("The engine draws, as the preference says"))
    if failure:
        return Drawer(False, rpt_("The engine draws: {reason}").format(reason=in_users_language(failure).rstrip(".")))
    if wish == CARD:
        return Drawer(True, rpt_("'{name}' draws, as the preference says").format(name=name))
    if not named:
        return Drawer(False, rpt_("The engine draws: Blender does not say which graphics card there is"))
    if any(word in text.lower() for text in named for word in _PROGRAMS):
        return Drawer(False, rpt_("The engine draws: '{name}' is a program, no graphics card").format(name=name))
    return Drawer(True, rpt_("The graphics card draws: '{name}'").format(name=name))


def can_draw() -> bool:
    """Whether somebody can."""
    return drawer().card or not why_not()


def the_card() -> Card:
    """The one card of this Blender."""
    global _card
    if _card is None:
        _card = Card()
    return _card


def card_draws() -> bool:
    """Whether the card draws and has drawn."""
    return _card is not None and _card.drawn > 0 and drawer().card


def note_failure(error: DeviceError) -> None:
    """The card cannot: the engine draws from now on, until the preference is changed."""
    global _failure
    _failure = str(error)


def forget_card() -> None:
    """Lets go of what lies on it, and tries it again."""
    global _card, _failure
    _card, _failure = None, ""


def _named() -> tuple[str, ...]:
    """The card's own name, its maker's, and what kind of device Blender takes it for."""
    try:
        return gpu.platform.renderer_get(), gpu.platform.vendor_get(), gpu.platform.device_type_get()
    except (SystemError, RuntimeError):  # nothing has been drawn yet
        return ()
