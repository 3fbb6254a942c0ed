"""report.html: one file that needs nothing else, for people."""

from __future__ import annotations

import math
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from ..camera import Camera
from ..files import write_text
from ..imaging.psf import PointSpread
from .charts import Axis, Marker, line_chart, scatter_map
from .foci import drawn_foci, usual_scale
from .kernels import drawn_kernels
from .paths import curve_said, drawn_paths, shutter_said
from .pictures import ViewPictures, embedded
from .words import blurred_by_effects, limits, not_simulated, simulated

_FOLDER = Path(__file__).parent

#: Title, text, and SVG (empty where there is nothing to draw).
_Chart = tuple[str, str, str]


def write_page(
    path: Path,
    report: Mapping[str, Any],
    pictures: list[ViewPictures],
    psf: PointSpread | None,
    cameras: Mapping[str, Camera],
) -> None:
    """Writes the page.

    Args:
        path: the file.
        report: the content of report.json.
        pictures: the views that are shown.
        psf: on the grid of the photos as used; None without blur.
        cameras: all cameras by photo name.

    Raises:
        OutputError: the file cannot be written.
    """
    write_text(path, page(report, pictures, psf, cameras))


def page(
    report: Mapping[str, Any], pictures: list[ViewPictures], psf: PointSpread | None, cameras: Mapping[str, Camera]
) -> str:
    """The page as text; see `write_page`."""
    from jinja2 import Environment, StrictUndefined  # (a tenth of a second: only when a page is written)

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["number"] = _number
    environment.filters["seconds"] = _seconds
    template = environment.from_string((_FOLDER / "report.html.j2").read_text("utf-8"))
    data = embedded(pictures)
    views = [
        {
            "name": view.name,
            "heldout": view.heldout,
            "scores": view.scores,
            "width": view.photo.shape[1],
            "height": view.photo.shape[0],
            "pictures": [{"key": key, "title": title, "data": uris[key]} for key, title, _ in view.named()],
        }
        for view, uris in zip(pictures, data, strict=True)
    ]
    return template.render(
        report=report,
        title=Path(report["photos"]["folder"]).resolve().name or "photos",
        made=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
        style=Markup((_FOLDER / "report.css").read_text("utf-8")),
        script=Markup((_FOLDER / "report.js").read_text("utf-8")),
        views=views,
        charts=_charts(report, psf),
        map=_map(cameras, set(report["heldout"]["names"])),
        cameras=[_camera_row(cameras[name]) for name in sorted(cameras)],
        simulated=simulated(report),
        not_simulated=not_simulated(report),
        limits=limits(report),
        exposures=exposures(report),
        blurred=blurred_by_effects(report),
        paths=drawn_paths(report),
        shutter=shutter_said(report),
        curve=curve_said(report),
        kernels=drawn_kernels(report),
        foci=(foci := drawn_foci(report)),
        focus_scale=usual_scale(foci),
    )


#: Why the accuracy of a shaken set falls on its way.
_RESTORED = " It falls where new Gaussians take the place of all, which are fitted to restored photos first."


def _charts(report: Mapping[str, Any], psf: PointSpread | None) -> list[dict[str, Any]]:
    history = [row for row in report["history"] if row.get("seconds") is not None]
    time = Axis("training time in s", low=0.0)
    loss = [(row["seconds"], row["loss"]) for row in history if row.get("loss") is not None]
    accuracy = [(row["seconds"], row["heldout_psnr"]) for row in history if row.get("heldout_psnr") is not None]
    charts: list[_Chart] = [
        (
            "Loss",
            "What the optimizer lowers, on the photos it trains on.",
            line_chart("Loss over time", [("loss", loss)], time, Axis("loss", logarithmic=True)),
        ),
        (
            "Accuracy on held-out views",
            "The twin through the medium against photos it was not trained on."
            + (_RESTORED if any(row.get("restored") for row in history) else ""),
            line_chart("Accuracy over time", [("held-out PSNR", accuracy)], time, Axis("PSNR in dB")),
        ),
    ]
    charts += _detail_chart(report)
    if psf is not None and not psf.is_identity:
        charts.append(
            (
                "What the medium lets through",
                "Contrast that remains of a pattern, by its period.",
                _transfer(psf, report["resolvable_period_px"]),
            )
        )
    charts += _exposure_chart(report)
    return [{"title": title, "text": text, "svg": svg} for title, text, svg in charts if svg]


def _detail_chart(report: Mapping[str, Any]) -> list[_Chart]:
    """Gain and correlation against the sharp truth; none without one."""
    bands = [band for band in report["heldout"]["bands"] if band["gain"] is not None]
    if not bands:
        return []

    def centre(band: Mapping[str, float]) -> float:
        return math.sqrt(band["finest"] * band["coarsest"])

    drawn = line_chart(
        "Gain and correlation by period",
        [
            ("gain", [(centre(b), b["gain"]) for b in bands]),
            ("correlation", [(centre(b), b["correlation"]) for b in bands if b["correlation"] is not None]),
        ],
        Axis("period in px (fine on the left)", logarithmic=True),
        Axis("share", low=0.0, high=1.1),
        [Marker("one photo's limit", x=report["resolvable_period_px"])],
    )
    text = "Against the sharp truth: gain 1 is all of it, correlation 1 is nothing invented."
    return [("Detail that came back", text, drawn)]


def _exposure_chart(report: Mapping[str, Any]) -> list[_Chart]:
    """Gains of the photos; none where none were learned."""
    gains = exposures(report)
    if not gains:
        return []
    drawn = line_chart(
        "Exposure by photo",
        [
            (name, [(i + 1.0, math.log2(row[c])) for i, row in enumerate(gains.values())])
            for c, name in enumerate(("red", "green", "blue"))
        ],
        Axis("photo"),
        Axis("stops"),
        [Marker("mean", y=0.0)],
    )
    text = "Learned with the twin, against the photos' mean, in the order of names: red, green, blue."
    return [("Exposure of each photo", text, drawn)]


def exposures(report: Mapping[str, Any]) -> dict[str, list[float]]:
    """Gains (red, green, blue) by photo, in the order of names; empty where none were learned."""
    for effect in report.get("effects", ()):
        if effect["name"] == "exposure" and effect["on"]:
            return dict(sorted((effect["parameters"] or {}).items()))
    return {}


def _transfer(psf: PointSpread, period: float) -> Markup:
    periods = np.geomspace(2.0, max(64.0, 6.0 * period), 160)
    worst = np.min([psf.mtf(1.0 / periods, angle) for angle in range(0, 180, 15)], axis=0)
    points = list(zip(periods.tolist(), worst.tolist(), strict=True))
    return line_chart(
        "Transfer of the point spread function",
        [("transfer", points)],
        Axis("period in px", logarithmic=True),
        Axis("contrast left", low=0.0, high=1.0),
        [Marker(f"{period:.3g} px: finer detail is lost in the rounding", x=period)],
    )


def _map(cameras: Mapping[str, Camera], held: set[str]) -> Markup:
    """The cameras from the side from which they spread most."""
    names = sorted(cameras)
    if len(names) < 2:
        return Markup("")
    centres = np.array([cameras[name].centre for name in names])
    centres -= centres.mean(axis=0)
    axes = np.linalg.svd(centres, full_matrices=False)[2]
    flat = centres @ axes[:2].T
    return scatter_map(
        "Where the photos were taken from",
        [(name, float(x), float(y), name in held) for name, (x, y) in zip(names, flat, strict=True)],
    )


def _camera_row(camera: Camera) -> dict[str, Any]:
    return {
        "name": camera.name,
        "size": f"{camera.width} × {camera.height}",
        "focal": f"{camera.fx:.1f}" if abs(camera.fx - camera.fy) < 0.05 else f"{camera.fx:.1f}, {camera.fy:.1f}",
        "centre": ", ".join(f"{value:.4g}" for value in camera.centre),
    }


def _number(value: float | None, digits: int = 2) -> str:
    if value is None:
        return "–"
    if isinstance(value, int):
        return f"{value:,}".replace(",", "\u202f")
    return f"{value:.{digits}f}"


def _seconds(value: float | None) -> str:
    if value is None:
        return "–"
    if value < 99.95:
        return f"{value:.1f} s" if value < 10 else f"{value:.0f} s"
    minutes, rest = divmod(round(value), 60)
    return f"{minutes} min {rest} s" if minutes < 60 else f"{minutes // 60} h {minutes % 60} min"
