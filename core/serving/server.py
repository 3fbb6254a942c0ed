"""The picture server's loop: lines in, pictures into shared memory, lines out."""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Callable, Iterable
from dataclasses import asdict
from typing import Any

import numpy as np

from ..camera import Camera
from ..devices import choose_device
from ..errors import DgsError
from ..files import parse_json
from ..machine import use_machine
from .messages import PlacedTwin, SharedTwin, View
from .picture import draw
from .shared_area import SharedArea
from .stage import Stage
from .weights import weigh

_IDENTITY = tuple(float(value) for value in np.eye(4).reshape(16))


class PictureServer:
    """Answers one message after the other.

    Args:
        device: where to render.
    """

    def __init__(self, device: str = "cpu") -> None:
        self._stage = Stage(device)
        self._areas: list[SharedArea] = []

    def answer(self, message: Any) -> dict[str, Any]:
        """What to write back.

        Raises:
            ValueError, DgsError: the message is not understood, or cannot be followed.
        """
        if not isinstance(message, dict) or len(message) != 1:
            raise ValueError("a message has one part")
        ((kind, value),) = message.items()
        if kind == "areas" and isinstance(value, list) and len(value) == 2:
            self._areas = [SharedArea(str(address)) for address in value]
            return {"event": "ready"}
        if kind == "forget":
            self._stage.forget(str(value))
            return {"event": "forgotten", "key": str(value)}
        if kind not in ("twin", "view", "seen") or not self._areas:
            raise ValueError(f"'{str(kind)[:40]}' is not understood here")
        if kind == "twin":
            twin = SharedTwin.parse(value)
            self._stage.put(twin, twin.planes(self._areas[0].view(twin.bytes)))
            return {"event": "twin", "key": twin.key}
        if kind == "seen":
            return {"event": "seen", "count": weigh(self._stage, View.parse(value), self._areas[1])}
        return {"event": "picture", **asdict(draw(self._stage, View.parse(value), self._areas[1]))}


def serve(lines: Iterable[str], write: Callable[[str], None], device: str, threads: int | None) -> None:
    """Answers lines until there are no more; a message that cannot be followed is answered by an error.

    Args:
        lines: JSON objects; write: takes a line of the answer.
        device: where to render, or 'auto'; threads: None for all cores.

    Raises:
        DeviceError: the device that was asked for is not there.
    """
    use_machine(threads)
    device = choose_device(device)
    _warm_up(device)
    server = PictureServer(device)
    for line in lines:
        try:
            reply = server.answer(parse_json(line.encode("utf-8", "replace")))
        except (ValueError, DgsError) as error:
            reply = {"event": "error", "text": str(error)}
        except MemoryError:
            reply = {"event": "error", "text": "Out of memory. Show fewer splats, or a smaller picture."}
        except Exception as error:  # noqa: BLE001 (whoever draws must go on; the log has the rest)
            traceback.print_exception(error, file=sys.stderr)
            reply = {"event": "error", "text": f"A bug, please report it: {type(error).__name__}: {error}"}
        write(json.dumps(reply))


def _warm_up(device: str) -> None:
    """Draws one splat, so that kernels are compiled and libraries loaded before anybody waits for a picture."""
    stage, area = Stage(device), SharedArea.create()
    twin = SharedTwin("warm", 1, 4)
    planes = twin.planes(memoryview(bytearray(twin.bytes)))
    planes[0][:], planes[1][:], planes[2][:], planes[3][:] = (0.0, 0.0, 2.0), 0.1, (1.0, 0.0, 0.0, 0.0), 0.5
    stage.put(twin, planes)
    camera = Camera("", 64, 64, 60.0, 60.0, 32.0, 32.0, np.eye(3), np.zeros(3))
    for depth in (False, True):
        draw(stage, View((PlacedTwin("warm", _IDENTITY),), camera, depth, True), area)
    area.close()
