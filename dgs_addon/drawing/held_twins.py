"""Twins' states by their keys, for as long as somebody draws them. Knows no Blender."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from ...core.serving.messages import SharedTwin
from .splats import Content

#: A state that no picture has named for so many pictures is dropped.
_UNUSED_AFTER = 32


class TwinStore(Protocol):
    """Who takes twins over: the card's, or the picture server."""

    def put(self, twin: SharedTwin, content: bytes) -> None:
        """Hands a state of a twin over; nothing happens if it is there already."""

    def has(self, key: str) -> bool:
        """Whether a state was handed over."""

    def retire(self, key: str) -> None:
        """Nobody will ask for a state again."""


class HeldTwins:
    """A store in this process."""

    def __init__(self) -> None:
        self._held: dict[str, Content] = {}
        self._used: dict[str, int] = {}
        self._pictures = 0

    def put(self, twin: SharedTwin, content: bytes) -> None:
        """As of `TwinStore`."""
        self._held.setdefault(twin.key, (twin, content))
        self._used[twin.key] = self._pictures

    def has(self, key: str) -> bool:
        """As of `TwinStore`."""
        return key in self._held

    def retire(self, key: str) -> None:
        """As of `TwinStore`."""
        self._used[key] = min(self._used.get(key, 0), self._pictures - _UNUSED_AFTER)

    def contents(self, keys: Sequence[str]) -> list[Content]:
        """The states that a picture shows; those that were not needed for long go."""
        self._pictures += 1
        for key in keys:
            self._used[key] = self._pictures
        for key in [key for key in self._held if self._pictures - self._used.get(key, 0) > _UNUSED_AFTER]:
            del self._held[key]
            self._used.pop(key, None)
        return [self._held[key] for key in keys]
