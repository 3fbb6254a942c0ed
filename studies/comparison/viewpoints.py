"""The first painted line's width from every viewpoint: the paper's figure, drawn from the twins on disk."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from ...core.evaluation.lines import line_width
from ...core.evaluation.profiles import Sampler
from ...core.files import read_json, write_json
from ...core.pipeline.views import Viewer
from ...core.progress import Progress
from .measure import Measure, TrueWidth


def widths_from_everywhere(
    file: Path, measure: Measure, viewers: Mapping[str, Viewer], key: str, progress: Progress
) -> dict[str, Any]:
    """Widths (px) of the first line in every photo's view, with uncertainties; kept in `file` with its `key`.

    Returns:
        'line', 'views' (names), 'heldout' (bool), 'true', 'true_uncertainty', and 'methods': by name
        {'width', 'uncertainty'}; None where the line is not found. Empty without lines.
    """
    if not measure.true_widths:
        return {}
    kept = _read(file)
    if kept.get("key") == key and list(kept.get("methods", {})) == list(viewers):
        return kept
    line = next(iter(measure.true_widths))
    names = sorted(measure.by_name)
    progress.stage("line widths", len(names))
    views: list[tuple[str, TrueWidth]] = []
    seen: dict[str, list[Any]] = {method: [] for method in viewers}
    for number, name in enumerate(names, start=1):
        true = measure.true_width(line, name)
        if true is not None:
            views.append((name, true))
            for method, viewer in viewers.items():
                lens, pose = measure.data.cameras.lenses[name], measure.data.cameras.poses[name]
                picture = np.clip(viewer.sharp(lens, pose), 0, 1).transpose(1, 2, 0).astype(np.float64)
                seen[method].append(line_width(Sampler.of(picture), true.places, true.direction))
        progress.advance(number)
    found = {
        "key": key,
        "line": line,
        "views": [name for name, _ in views],
        "heldout": [name in measure.held for name, _ in views],
        "true": [_number(t.measured.value) for _, t in views],
        "true_uncertainty": [_number(t.measured.uncertainty) for _, t in views],
        "methods": {
            method: {
                "width": [_number(one.value) for one in widths],
                "uncertainty": [_number(one.uncertainty) for one in widths],
            }
            for method, widths in seen.items()
        },
    }
    write_json(file, found)
    return found


def _read(file: Path) -> dict[str, Any]:
    try:
        content = read_json(file)
    except (OSError, ValueError):
        return {}
    return content if isinstance(content, dict) else {}


def _number(value: float) -> float | None:
    return round(float(value), 4) if np.isfinite(value) else None
