"""The mesh that is being made of a twin, if one is; one at a time."""

from __future__ import annotations

from ..engine.errand import Errand

_errand: Errand | None = None
#: Why the last one failed, in one line; '' if it did not.
error = ""
#: Name of the twin that the last one is of.
subject = ""

#: Seconds that an engine that was ended may take to go.
_FAREWELL = 5.0


def begin(errand: Errand, of: str) -> Errand:
    """Starts the engine; returns at once."""
    global _errand, error, subject
    _errand, error, subject = errand, "", of
    errand.start()
    return errand


def making() -> bool:
    """Whether the engine is at it."""
    return _errand is not None


def ended(reason: str) -> None:
    """It is done, or failed."""
    global _errand, error
    _errand, error = None, reason


def stop() -> None:
    """Ends the engine's work, as when the add-on is switched off."""
    global _errand
    if _errand is not None and _errand.running:
        _errand.cancel()
        _errand.join(_FAREWELL)
    _errand = None
