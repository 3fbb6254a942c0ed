"""What is asked: places on photos or in space, measures of them, and what is known of their scale; as JSON.

    {"places": {"a": {"photo": "view_001.png", "at": [120.5, 88.0]},
                "b": {"marks": {"view_001.png": [200, 90], "view_009.png": [188, 92]}, "click": 0.2},
                "c": {"position": [0.1, 0.2, 3.0]},
                "d": {"from": [0, 0, 0], "towards": [0.1, 0.2, 3.0], "spread": 0.001, "edges": true}},
     "measures": [{"name": "edge", "kind": "length", "of": ["a", "b"]},
                  {"kind": "width", "photo": "view_001.png", "across": [[100, 80], [130, 80]]},
                  {"kind": "width", "of": ["c", "d"]}],
     "scale": {"measure": "edge", "value": 120, "deviation": 0.5, "unit": "mm"}}

The scale may come from printed markers instead: {"board": "aruco:4x4_50,40mm"} (`core.measure.boards`).

Points are px of the photos as they are in the files; `click` is how exactly they were set, px. A ray from anywhere in
the twin's world needs no photo: `spread` is the tangent of the angle that a px of the picture it was set on covers, and
`edges` moves its place to the edge or corner that is nearest.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ..errors import FormatError
from ..files import read_json
from ..json_shape import check_shape, number, text, truth
from .boards import MarkerBoard, parsed_board
from .lengths import parsed_length

#: How many places a measure is of: at least, and at most (None: any number).
KINDS: Mapping[str, tuple[int, int | None]] = {
    "length": (2, 2),
    "polyline": (2, None),
    "angle": (3, 3),
    "area": (3, None),
    "width": (0, 2),
}
#: Places and measures that a file may hold.
MOST_ENTRIES = 100_000
_CONTENT = {
    "places?": {
        "*": {
            "photo?": text,
            "at?": [number],
            "marks?": {"*": [number]},
            "position?": [number],
            "from?": [number],
            "towards?": [number],
            "spread?": number,
            "edges?": truth,
            "click?": number,
        }
    },
    "measures": [{"name?": text, "kind": frozenset(KINDS), "of?": [text], "photo?": text, "across?": [[number]]}],
    "scale?": {"measure?": text, "value?": number, "deviation?": number, "unit?": text, "board?": text},
}

Point = tuple[float, float]
Position = tuple[float, float, float]


@dataclass(frozen=True)
class AskedRay:
    """A line of sight in the twin's world.

    Attributes:
        origin, towards: where it begins, and a point that it goes through.
        spread: tangent of the angle that a px of the picture that it was set on covers.
        edges: whether the place is to lie on the nearest edge.
    """

    origin: Position
    towards: Position
    spread: float = 0.0
    edges: bool = False


@dataclass(frozen=True)
class AskedPlace:
    """A place: points of photos by name, a position in the twin's world, or a ray; how exactly it was set (px)."""

    name: str
    marks: dict[str, Point]
    position: Position | None
    click: float | None
    ray: AskedRay | None = None


@dataclass(frozen=True)
class AskedMeasure:
    """A measure of places; a width may lie between two points of a photo instead."""

    name: str
    kind: str
    of: tuple[str, ...]
    photo: str = ""
    across: tuple[Point, Point] | None = None


@dataclass(frozen=True)
class KnownLength:
    """What a measure truly is, with its standard deviation, in a unit's name."""

    measure: str
    value: float
    deviation: float
    unit: str


@dataclass(frozen=True)
class MeasureRequest:
    """All that is asked; the scale comes from a known length, from a printed board, or there is none."""

    places: dict[str, AskedPlace]
    measures: tuple[AskedMeasure, ...]
    scale: KnownLength | None
    board: MarkerBoard | None = None

    @property
    def photos(self) -> tuple[str, ...]:
        """Photos that something is marked on."""
        marked = {name for place in self.places.values() for name in place.marks}
        return tuple(sorted(marked | {m.photo for m in self.measures if m.photo}))


def read_request(path: Path, scale: str | None = None, board: str | None = None) -> MeasureRequest:
    """Reads a file of measures.

    Args:
        scale: 'NAME=12.5mm' or 'NAME=12.5+-0.1mm', in the place of the file's.
        board: what was printed, as `core.measure.boards` has it, in the place of the file's scale.

    Raises:
        FormatError: it is not there, damaged, or asks for what makes no sense.
    """
    try:
        return parsed_request(read_json(path), scale, board)
    except (OSError, ValueError) as error:
        raise FormatError(
            f"'{path}' asks for no measures ({error})", "See docs/measure.md for what it may hold"
        ) from error


def parsed_request(
    content: Any, scale: str | None = None, board: str | None = None, *, alone: bool = False
) -> MeasureRequest:
    """As `read_request`, of what a file holds; raises ValueError, or FormatError of a board.

    Args:
        alone: places may stand without a measure of them.
    """
    check_shape(content, _CONTENT)
    request = _request(content, scale, board)
    if not request.measures and request.board is None and not (alone and request.places):
        raise ValueError(f"it holds {len(request.places)} places and 0 measures")
    return request


def _request(content: dict[str, Any], scale: str | None, board: str | None) -> MeasureRequest:
    places = {name: _place(name, found) for name, found in content.get("places", {}).items()}
    measures = [_measure(index, found, places) for index, found in enumerate(content["measures"])]
    if max(len(measures), len(places)) > MOST_ENTRIES:
        raise ValueError(f"it holds {len(places)} places and {len(measures)} measures")
    if len({measure.name for measure in measures}) < len(measures):
        raise ValueError("two measures have the same name")
    if scale and board:
        raise ValueError("its scale is to come from a known length and from a board")
    given = {"board": board} if board else content.get("scale") or {}
    if not scale and "board" in given:
        if "measure" in given or "value" in given:
            raise ValueError("its scale is a known length and a board")
        return MeasureRequest(places, tuple(measures), None, parsed_board(given["board"]))
    known = _known(scale) if scale else _known_of(given)
    if known is not None:
        found = {measure.name: measure.kind for measure in measures}.get(known.measure)
        if found not in ("length", "polyline", "width"):
            raise ValueError(f"the known length '{known.measure}' is no length that is measured")
    return MeasureRequest(places, tuple(measures), known)


def _place(name: str, found: dict[str, Any]) -> AskedPlace:
    click = found.get("click")
    if click is not None and click < 0:
        raise ValueError(f"'{name}' was set less exactly than not at all")
    if "from" in found or "towards" in found:
        return AskedPlace(name, {}, None, click, _ray(found, name))
    if "position" in found:
        return AskedPlace(name, {}, _position(found["position"], name), click)
    marks = dict(found.get("marks", {}))
    if "photo" in found:
        marks[found["photo"]] = found.get("at", [])
    if not marks:
        raise ValueError(f"'{name}' is marked on no photo and has no position")
    return AskedPlace(name, {photo: _point(at, name) for photo, at in marks.items()}, None, click)


def _ray(found: Mapping[str, Any], name: str) -> AskedRay:
    ends = _position(found.get("from", ()), name), _position(found.get("towards", ()), name)
    spread = float(found.get("spread", 0.0))
    if ends[0] == ends[1] or not 0 <= spread < 1:
        raise ValueError(f"the ray of '{name}' leads nowhere")
    return AskedRay(*ends, spread, bool(found.get("edges", False)))


def _position(values: Sequence[float], name: str) -> Position:
    if len(values) != 3:
        raise ValueError(f"a position of '{name}' has not three coordinates")
    x, y, z = (float(value) for value in values)
    return x, y, z


def _point(values: list[float], name: str) -> Point:
    if len(values) != 2:
        raise ValueError(f"a point of '{name}' has not two coordinates")
    return float(values[0]), float(values[1])


def _measure(index: int, found: dict[str, Any], places: Mapping[str, AskedPlace]) -> AskedMeasure:
    name, kind = found.get("name") or f"{found['kind']} {index + 1}", found["kind"]
    of = tuple(found.get("of", ()))
    least, most = KINDS[kind]
    if len(of) < least or (most is not None and len(of) > most):
        raise ValueError(f"'{name}' is of {len(of)} places: a {kind} is of {least}{'' if most else ' or more'}")
    missing = [place for place in of if place not in places]
    if missing:
        raise ValueError(f"'{name}' is of '{missing[0]}', which is no place")
    if kind != "width" or len(of) == 2:
        return AskedMeasure(name, kind, of)
    across = [_point(point, name) for point in found.get("across", ())]
    if len(across) != 2 or across[0] == across[1] or "photo" not in found:
        raise ValueError(f"the width '{name}' lies between no two points of a photo")
    return AskedMeasure(name, kind, of, found["photo"], (across[0], across[1]))


def _known_of(found: dict[str, Any]) -> KnownLength | None:
    if not found:
        return None
    missing = next((name for name in ("measure", "value", "unit") if name not in found), "")
    if missing:
        raise ValueError(f"scale.{missing} is missing")
    value, deviation = float(found["value"]), float(found.get("deviation", 0.0))
    return _sound(KnownLength(found["measure"], value, deviation, found["unit"]))


def _known(asked: str) -> KnownLength:
    name, _, length = asked.strip().rpartition("=")
    try:
        if not name:
            raise ValueError("it names no measure")
        return _sound(KnownLength(name, *parsed_length(length)))
    except ValueError as error:
        raise ValueError(f"'{asked}' is no known length: write NAME=12.5mm or NAME=12.5+-0.1mm ({error})") from error


def _sound(known: KnownLength) -> KnownLength:
    if not (0 < known.value < 1e30 and 0 <= known.deviation < known.value and known.unit.strip()):
        raise ValueError(f"the known length of '{known.measure}' makes no sense")
    return known
