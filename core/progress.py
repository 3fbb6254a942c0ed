"""How long work reports where it stands, and learns that it should stop."""

from __future__ import annotations

from typing import Protocol


class Progress(Protocol):
    """What a stage of the work talks to. Implementations: terminal bars, JSON lines, silence."""

    def stage(self, name: str, total: int | None = None) -> None:
        """A new stage begins: 'photos', 'cameras', 'compile', 'train', 'save', ..."""

    def advance(self, done: int, **figures: float) -> None:
        """`done` of `total` steps of the current stage are finished; figures such as loss, psnr."""

    def note(self, text: str) -> None:
        """A sentence that the user should see (a fallback taken, a photo left out)."""

    def cancelled(self) -> bool:
        """True once the user asked to stop; work ends at the next safe point."""


class Silent:
    """Says nothing and never cancels."""

    def stage(self, name: str, total: int | None = None) -> None: ...

    def advance(self, done: int, **figures: float) -> None: ...

    def note(self, text: str) -> None: ...

    def cancelled(self) -> bool:
        """Whether the user asked to stop."""
        return False
