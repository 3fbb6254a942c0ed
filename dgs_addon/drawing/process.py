"""The one picture server of this Blender."""

from __future__ import annotations

import contextlib
from pathlib import Path

from ...core.errors import DgsError
from ..engine.interpreter import find_python
from .picture_server import PictureServer, serve_command

_server: PictureServer | None = None
_python: Path | None = None


def picture_server() -> PictureServer:
    """The server, whose process starts with the first question; another one if another Python was chosen.

    Raises:
        DeviceError: there is no engine; it says what to do.
    """
    global _server, _python
    python = find_python()
    if _server is None or python != _python:
        stop()
        _server, _python = PictureServer(serve_command(python)), python
    return _server


def warm_up() -> None:
    """Starts the process before anybody waits for a picture; nothing happens where there is no engine."""
    with contextlib.suppress(DgsError):
        picture_server().warm_up()


def draws() -> bool:
    """Whether there is a server that makes pictures: not one that starts, or cannot."""
    return _server is not None and _server.drawn > 0 and not _server.error


def stop() -> None:
    """Ends the process, as when the add-on is switched off; the next question starts another."""
    global _server
    if _server is not None:
        _server.close()
    _server = None
