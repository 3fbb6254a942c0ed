"""Measures of a twin, kept on its object: how each was set, what came out, and the one length that is known.

Places are kept as the lines of sight that they were set along, in the axes of the twin's file, so that they can be
measured again on a later state of it.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ...core.errors import FormatError
from ...core.json_shape import anything, check_shape, number, text
from .sources import read_sources
from .twin import is_twin

#: Kinds of measures: label, tooltip, icon, places that it takes at least, and at most.
KINDS: Mapping[str, tuple[str, str, str, int, int]] = {
    "length": ("Length", "The distance of two places", "DRIVER_DISTANCE", 2, 2),
    "polyline": ("Path", "The length of a way through several places; Enter ends it", "IPO_LINEAR", 2, 1000),
    "angle": ("Angle", "The angle at the second of three places", "DRIVER_ROTATIONAL_DIFFERENCE", 3, 3),
    "width": ("Width", "The width of a line or a crack, between two places beside it", "ARROW_LEFTRIGHT", 2, 2),
    "area": ("Area", "The area of a polygon of three places or more; Enter ends it", "MESH_PLANE", 3, 1000),
}
#: The same as a Blender enumeration takes them.
KIND_ITEMS = [(kind, *KINDS[kind][:3], index) for index, kind in enumerate(KINDS)]
#: Units of lengths.
UNITS = ("mm", "µm", "cm", "m", "km", "in", "ft")
UNIT_ITEMS = [(unit, unit, "") for unit in UNITS]
#: From here on figures are written with an exponent.
_LARGE = 1e5
#: What is read of the engine's answer.
ANSWER = {
    "measures": [
        {"value": anything, "low": anything, "high": anything, "deviation": anything, "unit": text, "reason": anything}
    ],
    "places": {"*": {"position": [number], "photos": number}},
    "missing": {"*": anything},
    "scale?": {"markers": number, "photos": number, "size": number, "deviation": number},
}


def _changed(_owner: Any, context: Any) -> None:
    for window in context.window_manager.windows:
        for area in window.screen.areas:
            if area.type == "VIEW_3D":
                area.tag_redraw()


class DGS_PG_place(bpy.types.PropertyGroup):
    """A place that was set."""

    origin: bpy.props.FloatVectorProperty(size=3)  # type: ignore[valid-type]
    towards: bpy.props.FloatVectorProperty(size=3)  # type: ignore[valid-type]
    spread: bpy.props.FloatProperty()  # type: ignore[valid-type]
    edges: bpy.props.BoolProperty()  # type: ignore[valid-type]
    given: bpy.props.BoolProperty(description="It was given as a position, not along a line of sight")  # type: ignore[valid-type]
    position: bpy.props.FloatVectorProperty(size=3)  # type: ignore[valid-type]


class DGS_PG_measure(bpy.types.PropertyGroup):
    """A measure, and what came out."""

    kind: bpy.props.EnumProperty(items=KIND_ITEMS)  # type: ignore[valid-type]
    places: bpy.props.CollectionProperty(type=DGS_PG_place)  # type: ignore[valid-type]
    found: bpy.props.BoolProperty()  # type: ignore[valid-type]
    value: bpy.props.FloatProperty()  # type: ignore[valid-type]
    low: bpy.props.FloatProperty()  # type: ignore[valid-type]
    high: bpy.props.FloatProperty()  # type: ignore[valid-type]
    unit: bpy.props.StringProperty()  # type: ignore[valid-type]
    reason: bpy.props.StringProperty()  # type: ignore[valid-type]
    photos: bpy.props.IntProperty()  # type: ignore[valid-type]
    known: bpy.props.BoolProperty()  # type: ignore[valid-type]
    shown: bpy.props.BoolProperty(  # type: ignore[valid-type]
        name="Show", default=True, update=_changed, description="Draw it in 3D views"
    )


class DGS_PG_measures(bpy.types.PropertyGroup):
    """All measures of a twin."""

    items: bpy.props.CollectionProperty(type=DGS_PG_measure)  # type: ignore[valid-type]
    active: bpy.props.IntProperty(update=_changed)  # type: ignore[valid-type]
    length: bpy.props.FloatProperty()  # type: ignore[valid-type]
    deviation: bpy.props.FloatProperty()  # type: ignore[valid-type]
    unit: bpy.props.StringProperty()  # type: ignore[valid-type]
    board: bpy.props.StringProperty(description="Printed markers that give the scale; empty without")  # type: ignore[valid-type]
    trouble: bpy.props.StringProperty(description="Why no printed markers were found")  # type: ignore[valid-type]
    answer: bpy.props.StringProperty(description="The engine's last answer, as JSON")  # type: ignore[valid-type]


def register_measures() -> None:
    """Adds `object.dgs_measures`."""
    bpy.types.Object.dgs_measures = bpy.props.PointerProperty(type=DGS_PG_measures)


def unregister_measures() -> None:
    """Takes it out; what files hold of it stays in them."""
    del bpy.types.Object.dgs_measures


def measures_of(twin: Any) -> Any:
    """A twin's measures; None where it is none."""
    return twin.dgs_measures if is_twin(twin) else None


def active_measure(twin: Any) -> Any:
    """The one that is chosen in the list, or None."""
    held = measures_of(twin)
    return held.items[held.active] if held is not None and 0 <= held.active < len(held.items) else None


def from_file(twin: Any) -> NDArray[np.float64]:
    """[4, 4] from the axes of the twin's file to Blender's world.

    Raises:
        FormatError: it is of several files.
    """
    sources = read_sources(twin.data)
    if len(sources) > 1:
        raise FormatError(f"'{twin.name}' is of several twins", "Measure each before they are merged")
    own = np.array(sources[0].matrix, np.float64).reshape(4, 4) if sources else np.eye(4)
    return np.array(twin.matrix_world, np.float64) @ own


def sight_line(twin: Any, origin: Any, towards: Any, spread: float, edges: bool) -> dict[str, Any]:
    """A place along a line of sight (two points of Blender's world), as the engine takes it."""
    into = np.linalg.inv(from_file(twin))
    ends = [(into @ [*point, 1.0])[:3].tolist() for point in (origin, towards)]
    return {"from": ends[0], "towards": ends[1], "spread": spread, "edges": edges}


def given_place(twin: Any, position: Any) -> dict[str, Any]:
    """A place at a position of Blender's world, as the engine takes it."""
    return {"position": (np.linalg.inv(from_file(twin)) @ [*position, 1.0])[:3].tolist()}


def add_measure(twin: Any, kind: str, places: Sequence[Mapping[str, Any]], name: str) -> Any:
    """Keeps a measure of places that `sight_line` or `given_place` made; it is the chosen one now."""
    held = twin.dgs_measures
    names = {item.name for item in held.items}
    item = held.items.add()
    item.name = next(new for new in (name, *(f"{name} {count}" for count in range(2, 10**6))) if new not in names)
    item.kind = kind
    for asked in places:
        place = item.places.add()
        place.given = "position" in asked
        if place.given:
            place.position = asked["position"]
        else:
            place.origin, place.towards = asked["from"], asked["towards"]
            place.spread, place.edges = asked["spread"], asked["edges"]
    held.active = len(held.items) - 1
    return item


def remove_measure(twin: Any, index: int) -> None:
    """Forgets one; without the known one, nothing is known."""
    held = twin.dgs_measures
    held.items.remove(index)
    held.active = max(0, min(held.active, len(held.items) - 1))


def known_measure(twin: Any) -> Any:
    """The measure whose length is known, or None."""
    return next((item for item in twin.dgs_measures.items if item.known), None)


def asked_of(twin: Any) -> dict[str, Any]:
    """All measures of a twin as a file of the engine's command has them; a measure's number stands for its name."""
    places: dict[str, Any] = {}
    measures, held = [], twin.dgs_measures
    for index, item in enumerate(held.items):
        names = [f"{index}.{at}" for at in range(len(item.places))]
        places |= dict(zip(names, map(_asked, item.places), strict=True))
        measures.append({"name": str(index), "kind": item.kind, "of": names})
    known = known_measure(twin)
    scale = {}
    if known is not None:
        chosen = next(index for index, item in enumerate(held.items) if item == known)
        length = {"value": _short(held.length), "deviation": _short(held.deviation), "unit": held.unit}
        scale = {"scale": {"measure": str(chosen), **length}}
    elif held.board:
        scale = {"scale": {"board": held.board}}
    return {"places": places, "measures": measures, **scale}


def known_of(twin: Any) -> dict[str, Any] | None:
    """What is known of a twin's scale alone, as a file of the engine's command has it; None where nothing is."""
    item, held = known_measure(twin), twin.dgs_measures
    if item is None:
        return {"measures": [], "scale": {"board": held.board}} if held.board else None
    places = {f"{at}": _asked(place) for at, place in enumerate(item.places)}
    measure = {"name": item.name, "kind": item.kind, "of": list(places)}
    length = {"value": _short(held.length), "deviation": _short(held.deviation), "unit": held.unit}
    return {"places": places, "measures": [measure], "scale": {"measure": item.name, **length}}


def board_of(twin: Any) -> dict[str, Any] | None:
    """What the engine has found of the printed markers that give a twin's scale; None where they do not."""
    held = twin.dgs_measures
    if not held.board or known_measure(twin) is not None:
        return None
    try:
        found = json.loads(held.answer)["scale"]
        return {"board": held.board, **{name: found[name] for name in ("markers", "photos", "size", "deviation")}}
    except (ValueError, KeyError, TypeError):
        return None


def take_in(twin: Any, answer: Mapping[str, Any]) -> None:
    """Keeps what the engine has measured.

    Raises:
        FormatError: it is no answer to what was asked.
    """
    items = twin.dgs_measures.items
    try:
        check_shape(answer, ANSWER)
        if len(answer["measures"]) != len(items):
            raise ValueError("it has another number of measures")
    except ValueError as error:
        raise FormatError(f"The engine's answer is not understood: {error}") from error
    for index, (item, row) in enumerate(zip(items, answer["measures"], strict=True)):
        item.found, item.unit = row["value"] is not None, row["unit"]
        item.reason = "" if item.found else str(row["reason"])
        for name in ("value", "low", "high") if item.found else ():
            setattr(item, name, row[name])
        photos = []
        for at, place in enumerate(item.places):
            seen = answer["places"].get(f"{index}.{at}")
            if seen is not None:
                place.position = seen["position"]
                photos.append(int(seen["photos"]))
        item.photos = min(photos, default=0)
    twin.dgs_measures.answer = json.dumps(answer)


def rows_of_table(twin: Any) -> list[dict[str, Any]]:
    """What the engine has measured, with the names that measures have now, for a table."""
    held = twin.dgs_measures
    try:
        answer = json.loads(held.answer)
        rows = [{**row, "name": item.name} for row, item in zip(answer["measures"], held.items, strict=True)]
    except (ValueError, KeyError, TypeError):
        rows = [_row(item) for item in held.items]
    return [{**row, "of": [f"{row['name']}.{name.partition('.')[2]}" for name in row["of"]]} for row in rows]


def value_text(item: Any) -> str:
    """A value and half its 95 % interval: '12.3 ± 0.4 mm'; '< 31 mm' where it is no larger than its error."""
    if not item.found:
        return "–"
    half = max(item.value - item.low, item.high - item.value)
    unit = {"deg": "°", "px-equivalent": "px", "px-equivalent^2": "px²"}.get(item.unit, item.unit.replace("^2", "²"))
    if item.known:
        return f"{item.value:.6g} {unit}"
    unit = unit if unit == "°" else f" {unit}"
    if half >= item.value:  # nothing but a bound is known of it
        return f"< {rounded(item.high, half)}{unit}"
    return f"{rounded(item.value, half)} ± {rounded(half, half)}{unit}"


def rounded(value: float, half: float) -> str:
    """With two digits of `half`, if it has them behind the point, and no more than six in all."""
    if not half > 0 or half >= _LARGE:
        return f"{value:.3g}" if half > 0 else f"{value:.6g}"
    digits = min(max(0, 1 - math.floor(math.log10(half))), 6)
    return f"{value:,.{digits}f}"


def _asked(place: Any) -> dict[str, Any]:
    if place.given:
        return {"position": list(place.position)}
    ends = {"from": list(place.origin), "towards": list(place.towards)}
    return {**ends, "spread": place.spread, "edges": place.edges}


def _short(value: float) -> float:
    """Blender's 32 bits, without the digits behind them."""
    return float(f"{value:.7g}")


def _row(item: Any) -> dict[str, Any]:
    values = {name: getattr(item, name) if item.found else None for name in ("value", "low", "high")}
    of = [f"0.{at}" for at in range(len(item.places))]
    return {"name": item.name, "kind": item.kind, "of": of, **values, "unit": item.unit, "reason": item.reason}
