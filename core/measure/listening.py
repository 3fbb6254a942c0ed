"""Measures for a program that asks again and again: a twin is opened once, then each line is answered by a line."""

from __future__ import annotations

import json
import sys
import traceback
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from ..errors import DgsError
from ..files import parse_json
from ..machine import use_machine
from ..progress import Progress, Silent
from ..twin.folder import TwinFolder
from ..twin.opened import open_twin
from .by_board import BoardScale, board_scale
from .measured import check_photos, measured
from .request import MeasureRequest, parsed_request
from .sights import sights
from .tables import as_plain
from .written import looking


class Measurer:
    """A twin that is measured.

    Args:
        folder: of the twin; photos: where its photos lie now, if they were moved.
        progress: of the opening.

    Raises:
        FormatError: no twin folder, or damaged.
    """

    def __init__(self, folder: Path, photos: Path | None, progress: Progress) -> None:
        self._twin = open_twin(folder, progress, photos)
        self._cameras = looking(TwinFolder(folder))
        self._views = sights(self._twin, (), progress)
        self._boards = dict[str, BoardScale]()

    @property
    def cameras(self) -> int:
        """How many say how sure a place is."""
        return len(self._views.views)

    def answer(self, message: Any) -> dict[str, Any]:
        """What is measured, as the command's JSON has it.

        Args:
            message: what a file of places and measures holds; measures may be missing.

        Raises:
            ValueError, DgsError: it makes no sense, or the known length could not be measured, or the board not found.
        """
        request = parsed_request({"measures": [], **message} if isinstance(message, dict) else message, alone=True)
        check_photos(self._twin, request)
        if any(photo not in self._views.views for photo in request.photos):  # one that was held out
            self._views = sights(self._twin, [*self._views.views, *request.photos], Silent())
        board = self._board(request)
        return as_plain(measured(self._twin, self._views, request, self._cameras, Silent(), board))

    def _board(self, request: MeasureRequest) -> BoardScale | None:
        """The scale of the board that is asked for: photos are searched once for each."""
        if request.board is None:
            return None
        text = request.board.text
        if text not in self._boards:
            self._boards[text] = board_scale(request.board, self._twin, self._views, self._cameras, Silent())
        return self._boards[text]


def listen(
    folder: Path,
    photos: Path | None,
    threads: int | None,
    lines: Iterable[str],
    write: Callable[[str], None],
    progress: Progress,
) -> None:
    """Answers lines until there are no more; one that cannot be followed is answered by an error.

    Args:
        lines: JSON objects; write: takes a line of the answer. The first one says that the twin is open.

    Raises:
        FormatError: no twin folder, or damaged. Cancelled: the user asked to stop before it was open.
    """
    use_machine(threads)
    measurer = Measurer(folder, photos, progress)
    write(json.dumps({"event": "open", "cameras": measurer.cameras}))
    for line in lines:
        try:
            reply = {"event": "measured", **measurer.answer(parse_json(line.encode("utf-8", "replace")))}
        except (ValueError, DgsError) as error:
            reply = {"event": "error", "text": str(error)}
        except Exception as error:  # noqa: BLE001 (whoever asks must go on; the log has the rest)
            traceback.print_exception(error, file=sys.stderr)
            reply = {"event": "error", "text": f"A bug, please report it: {type(error).__name__}: {error}"}
        write(json.dumps(reply, allow_nan=False))
