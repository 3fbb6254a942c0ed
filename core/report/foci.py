"""The focus of each photo, as the report draws it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from markupsafe import Markup

#: Size of a picture in the units of its SVG, and the space at either end of its line.
WIDTH, HEIGHT, EDGE = 96, 24, 8
#: Standard errors to either side that are drawn: 95 % of a normal.
SURE = 2.0
#: A standard error beyond this share of all foci's range says nothing of where a photo is focused.
DETERMINED = 0.5
#: A photo whose strength is less than this share of the median counts as sharp everywhere.
SHARP = 0.1


@dataclass(frozen=True)
class DrawnFocus:
    """One photo's focus.

    Attributes:
        said: its distance in the cameras' unit with its standard error, or why there is none.
        scale: a circle's diameter is this many px times the difference of 1 / distance from the focus.
        svg: where it lies on a line from the nearest to the farthest focus of all photos, in 1 / distance.
    """

    said: str
    scale: float
    svg: Markup


def drawn_foci(report: Mapping[str, Any]) -> dict[str, DrawnFocus]:
    """By photo, in the order of names; empty where none were learned."""
    for effect in report.get("effects", ()):
        if effect["name"] == "defocus" and effect["on"] and "photos" in (effect["parameters"] or {}):
            return _drawn(effect["parameters"], math.hypot(*report["photos"]["size"]))
    return {}


def usual_scale(foci: Mapping[str, DrawnFocus]) -> float:
    """Median of the photos' scales, px times the cameras' unit; 0 where there are none."""
    return float(np.median([focus.scale for focus in foci.values()])) if foci else 0.0


def _drawn(parameters: Mapping[str, Any], diagonal: float) -> dict[str, DrawnFocus]:
    rows = {name: np.asarray(row, float) for name, row in sorted(parameters["photos"].items())}
    unit, usual = float(parameters["unit"]), float(np.median([row[0] for row in rows.values()]))
    there = [row for row in rows.values() if row[0] > SHARP * usual]
    if not there:
        learned = any(row[2:].any() for row in rows.values())
        said = "sharp everywhere" if learned else "not identifiable: too flat"
        return {name: DrawnFocus(said, 0.0, _svg(None, 0.0)) for name in rows}
    low, high = (float(f([row[1] for row in there])) for f in (min, max))
    found = {}
    for name, (strength, focus, _, error) in rows.items():
        scale = 4.0 * strength * diagonal * unit
        reach = max(high - low, 1e-9)
        if strength <= SHARP * usual:
            found[name] = DrawnFocus("sharp everywhere", scale, _svg(None, 0.0))
        elif error > DETERMINED * reach and len(there) > 1:
            found[name] = DrawnFocus("not identifiable", scale, _svg(None, 0.0))
        else:
            # Small on the left is far: a focus at infinity is 0.
            found[name] = DrawnFocus(
                _said(unit, focus, error), scale, _svg((focus - low) / reach, SURE * error / reach)
            )
    return found


def _said(unit: float, focus: float, error: float) -> str:
    """A distance and its standard error; 'beyond' where infinity lies within two of them."""
    if focus <= SURE * error:
        return f"beyond {unit / max(focus + SURE * error, 1e-9):.3g}"
    return f"{unit / focus:.3g} ± {unit / focus**2 * error:.2g}"


def _svg(place: float | None, reach: float) -> Markup:
    way, middle = WIDTH - 2 * EDGE, HEIGHT / 2
    drawn = f'<path d="M{EDGE} {middle}H{WIDTH - EDGE}" stroke="currentColor" stroke-opacity="0.25"/>'
    if place is not None:
        near, far = (EDGE + way * min(max(place + side * reach, 0.0), 1.0) for side in (-1, 1))
        drawn += f'<path d="M{near:.1f} {middle}H{far:.1f}" stroke="currentColor" stroke-width="3"/>'
        drawn += f'<circle cx="{EDGE + way * place:.1f}" cy="{middle}" r="3.5" fill="currentColor"/>'
    size = f'viewBox="0 0 {WIDTH} {HEIGHT}" width="{WIDTH}" height="{HEIGHT}"'
    return Markup(f'<svg {size} role="img" aria-label="focus">{drawn}</svg>')
