"""tradeoff.html: the chart and the table in one file that needs nothing else."""

from __future__ import annotations

import re
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Any

from markupsafe import Markup

from ...core.effort.records import RECORDS
from ...core.files import write_text
from ...core.version import VERSION

_FOLDER = Path(__file__).parent
#: The style of the engine's own report.
_STYLE = _FOLDER.parents[1] / "core" / "report" / "report.css"


def write_page(path: Path, content: Mapping[str, Any], svg: str) -> None:
    """Writes the page.

    Args:
        content: of tradeoff.json; svg: the chart.

    Raises:
        OutputError: it cannot be written.
    """
    from jinja2 import Environment, StrictUndefined  # heavy: jinja2

    environment = Environment(autoescape=True, undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True)
    environment.filters["figure"] = _figure
    template = environment.from_string((_FOLDER / "tradeoff.html.j2").read_text("utf-8"))
    points = content["points"]
    measured = [point for point in points if not point["skipped"]]
    text = template.render(
        content=content,
        version=VERSION,
        points=sorted(measured, key=lambda point: float(point["seconds"])),
        skipped=[point for point in points if point["skipped"]],
        lines=any(point["line_error"] is not None for point in measured),
        busy=max((point["disturbed"] or 0.0 for point in measured), default=0.0),
        disturbed=RECORDS.disturbed_share,
        style=Markup(_STYLE.read_text("utf-8")),
        # The prolog of a file is no part of a page.
        chart=Markup(re.sub(r"^.*?(?=<svg)", "", svg, flags=re.DOTALL)),
        made=datetime.now().astimezone().strftime("%Y-%m-%d %H:%M"),
    )
    write_text(path, text)


def _figure(value: float | None, digits: int = 2) -> str:
    return "–" if value is None else f"{value:.{digits}f}"
