"""What libraries write to the terminal by themselves goes into a file; between progress bars it would be noise.

Blender's module and its renderer write through C, past Python's `sys.stdout` ('CUEW initialization failed' where there
is no graphics card). Python's own output, a traceback of a crash included, still goes where the user sees it.
"""

from __future__ import annotations

import ctypes
import faulthandler
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO


@contextmanager
def library_output_aside(name: str) -> Iterator[Path]:
    """Gives the file that file descriptors 1 and 2 lead to meanwhile; the caller says where it is, or deletes it.

    Args:
        name: of the command, for the file's name.
    """
    handle, file = tempfile.mkstemp(prefix=f"dgs-{name}-", suffix=".log")
    python_streams = sys.stdout, sys.stderr
    _flush(*python_streams)
    kept = os.dup(1), os.dup(2)
    sys.stdout, sys.stderr = _moved(sys.stdout, 1, kept[0]), _moved(sys.stderr, 2, kept[1])
    os.dup2(handle, 1)
    os.dup2(handle, 2)
    os.close(handle)
    watching = not faulthandler.is_enabled()
    if watching:
        faulthandler.enable(file=kept[1])
    try:
        yield Path(file)
    finally:
        if watching:
            faulthandler.disable()
        _flush(sys.stdout, sys.stderr)
        sys.stdout, sys.stderr = python_streams
        for descriptor, own in zip((1, 2), kept, strict=True):
            os.dup2(own, descriptor)
            os.close(own)


def _moved(stream: TextIO, descriptor: int, to: int) -> TextIO:
    """A stream like this one that leads to another descriptor; itself if it does not lead to `descriptor`."""
    try:
        if stream.fileno() != descriptor:
            return stream
    except (AttributeError, OSError, ValueError):  # none, one in memory, or a closed one
        return stream
    return open(to, "w", buffering=1, encoding=stream.encoding, errors=stream.errors, closefd=False)


def _flush(*streams: TextIO | None) -> None:
    """Empties Python's buffers and those of C, which would else be emptied after the descriptors have changed."""
    for stream in streams:
        if stream is not None:
            stream.flush()
    ctypes.CDLL(None if os.name == "posix" else "ucrtbase").fflush(None)
