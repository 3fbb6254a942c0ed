"""What is read off one twin: held-out scores, bands of detail, line widths, depth."""

from __future__ import annotations

import unicodedata
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...core.camera import Camera
from ...core.evaluation.lines import (
    LineWidth,
    PaintedLine,
    Station,
    concordance,
    contrast_direction,
    line_width,
    stations,
)
from ...core.evaluation.metrics import psnr
from ...core.evaluation.poses import Similarity, align_similarity, pose_errors
from ...core.evaluation.profiles import Sampler
from ...core.evaluation.view_scores import ViewScores, mean_of
from ...core.numbers import number
from ...core.photos.write import write_png
from ...core.pipeline.scores import ViewScorer
from ...core.pipeline.views import Viewer
from ...core.progress import Silent
from ...core.rasterizer import RasterSettings, render
from ...core.training.run import Trained
from ...core.training.scale import scene_scale
from .dataset import Dataset

Array = NDArray[np.float64]

#: The widest and the most thinly painted line that reports compare; others only if there is room.
LINES = ("red", "white thin")


@dataclass(frozen=True)
class MeasureNumbers:
    """Of what is read off a twin."""

    fitted_views: int = number(4, "count", "trained views that are scored; each costs as much as a held-out one")
    line_views: int = number(12, "count", "trained views in which lines are measured besides the held-out ones")
    opaque: float = number(0.5, "opacity", "a pixel below it has no depth worth comparing")


NUMBERS = MeasureNumbers()


@dataclass(frozen=True)
class TrueWidth:
    """One line in one view, as the sharp photo shows it.

    Attributes:
        places: where profiles are read.
        direction: [3] in colour space, from the surroundings to the line.
        measured: its width in the sharp photo.
        geometric: px that the painted width projects to.
    """

    places: list[Station]
    direction: Array
    measured: LineWidth
    geometric: float


class Measure:
    """Measures twins of one data set; what concerns the truth alone is done once.

    Args:
        only_heldout: leave out trained views, whose scores and lines take most of the time.
    """

    def __init__(self, data: Dataset, only_heldout: bool = False) -> None:
        self.data = data
        self.by_name = {photo.name: photo for photo in data.photos}
        self.held = [name for name in data.heldout if name in self.by_name]
        trained = [] if only_heldout else [name for name in sorted(self.by_name) if name not in self.held]
        self.fitted = trained[:: max(1, len(trained) // NUMBERS.fitted_views)][: NUMBERS.fitted_views]
        self._line_views = sorted(
            {*self.held, *trained[:: max(1, len(trained) // NUMBERS.line_views)][: NUMBERS.line_views]}
        )
        reference = data.reference_cameras()
        self._alignment: Similarity | None = align_similarity(data.cameras.cameras(), reference) if reference else None
        self.true_widths = self._true_widths(reference) if data.lines else {}

    def poses(self) -> dict[str, float | None] | None:
        """Errors of the cameras that all methods share, after similarity alignment; None without a reference."""
        if self.data.reference is None:
            return None
        errors = pose_errors(
            self.data.cameras.cameras(), self.data.reference_cameras(), self.data.reference.points.positions
        )
        return {
            "centre_median": _finite(np.median(errors.centre), 7),
            "centre_px_median": _finite(np.median(errors.centre_px)),
            "angle_degrees_median": _finite(np.median(errors.angle), 5),
            "focal_percent": _finite(100 * np.median(errors.focal)),
            "cameras": len(errors.names),
        }

    def twin(self, trained: Trained, folder: Path | None) -> dict[str, Any]:
        """All figures of one twin; renders of held-out views are written to `folder`."""
        cameras = self.data.cameras.cameras()
        scale = scene_scale(list(cameras.values()), self.data.cameras.points)
        viewer = Viewer(trained.gaussians, scale, "cpu", trained.low_pass, trained.background)
        scorer = ViewScorer(viewer, self.data.cameras, self.data.medium, self.data.truth, 2.0, Silent())
        out: dict[str, Any] = {}
        pictures: dict[str, NDArray[np.float64]] = {}
        for kind, names in (("heldout", self.held), ("fitted", self.fitted)):
            scores, objects = [], []
            for name in names:
                keep = None
                if folder is not None and kind == "heldout":
                    keep = partial(write_png, folder / render_file(name))
                score, shown = scorer.score(self.by_name[name], kind == "heldout", keep)
                pictures[name] = shown.twin / 255.0
                scores.append(score)
                if name in self.data.masks and shown.truth is not None:
                    objects.append(psnr(pictures[name], shown.truth / 255.0, self.data.masks[name]))
            out[kind] = _means(scores, objects)
        out["lines"] = self._lines(viewer, pictures)
        out["depth"] = self._depth(trained)
        return out

    def true_width(self, line: str, name: str) -> TrueWidth | None:
        """Of any photo; None where the line is not seen, or without a reference."""
        camera = self.data.reference_cameras().get(name)
        painted = next((one for one in self.data.lines if one.name == line), None)
        if camera is None or painted is None:
            return None
        if name in self.true_widths.get(line, {}):
            return self.true_widths[line][name]
        pixels = self.data.truth.pixels(name)
        return self._true_width(painted, camera, Sampler.of(pixels / np.float64(np.iinfo(pixels.dtype).max)))

    def _true_widths(self, reference: dict[str, Camera]) -> dict[str, dict[str, TrueWidth]]:
        chosen = [line for line in self.data.lines if line.name in LINES] or self.data.lines[:2]
        found: dict[str, dict[str, TrueWidth]] = {line.name: {} for line in chosen}
        for name in self._line_views:
            if name not in reference:
                continue
            pixels = self.data.truth.pixels(name)
            sampler = Sampler.of(pixels / np.float64(np.iinfo(pixels.dtype).max))
            for line in chosen:
                true = self._true_width(line, reference[name], sampler)
                if true is not None:
                    found[line.name][name] = true
        return found

    def _true_width(self, line: PaintedLine, camera: Camera, sampler: Sampler) -> TrueWidth | None:
        places = stations(line, camera, self.data.lines)
        if not places:
            return None
        direction = contrast_direction(sampler, places)
        measured = line_width(sampler, places, direction)
        if not np.isfinite(measured.value):
            return None
        return TrueWidth(places, direction, measured, float(np.median([place.width for place in places])))

    def _lines(self, viewer: Viewer, pictures: dict[str, NDArray[np.float64]]) -> dict[str, Any]:
        """Widths by line and view, and concordance over the held-out views and over all that were measured."""
        out: dict[str, Any] = {}
        samplers: dict[str, Sampler] = {}
        for line, views in self.true_widths.items():
            rows: list[dict[str, Any]] = []
            for name, true in views.items():
                if name not in samplers:
                    if name not in pictures:
                        lens, pose = self.data.cameras.lenses[name], self.data.cameras.poses[name]
                        sharp = np.clip(viewer.sharp(lens, pose), 0, 1).transpose(1, 2, 0)
                        pictures[name] = sharp.astype(np.float64)
                    samplers[name] = Sampler.of(pictures[name])
                seen = line_width(samplers[name], true.places, true.direction)
                rows.append(
                    {
                        "view": name,
                        "heldout": name in self.held,
                        "true": _finite(true.measured.value),
                        "true_uncertainty": _finite(true.measured.uncertainty),
                        "geometric": _finite(true.geometric),
                        "rendered": _finite(seen.value),
                        "uncertainty": _finite(seen.uncertainty),
                        "blur": _finite(seen.blur),
                    }
                )
            held = [row for row in rows if row["heldout"]]
            out[line] = {
                "concordance": _concordance(held),
                "concordance_all_views": _concordance(rows),
                "true_mean": mean_of([row["true"] for row in held]),
                "rendered_mean": mean_of([row["rendered"] for row in held]),
                "views": rows,
            }
        return out

    def _depth(self, trained: Trained) -> dict[str, float | None] | None:
        """Median of |depth - true depth| over pixels, in the reference's units and in per cent of the depth."""
        if self._alignment is None or not any(name in self.data.depths for name in self.held):
            return None
        cameras = self.data.cameras.cameras()
        scale = scene_scale(list(cameras.values()), self.data.cameras.points)
        unit = scale.to_unit(trained.gaussians)
        errors, shares, objects = [], [], []
        for name in self.held:
            truth = self.data.depth(name)
            if truth is None:
                continue
            seen = render(unit, scale.camera_to_unit(cameras[name]), settings=RasterSettings(depth=True))
            assert seen.depth is not None
            alpha = seen.alpha.detach().numpy()
            depth = seen.depth.detach().numpy() / np.maximum(alpha, 1e-6) * scale.size * self._alignment.scale
            counted = (alpha > NUMBERS.opaque) & np.isfinite(truth)
            wrong = np.abs(depth - truth)
            errors.append(wrong[counted])
            shares.append(wrong[counted] / truth[counted])
            if name in self.data.masks:
                objects.append(wrong[counted & self.data.masks[name]])
        if not errors:
            return None
        return {
            "median": _median(errors),
            "median_percent": _finite(100 * _median_of(shares)),
            "median_object": _median(objects) if objects else None,
        }


def render_file(name: str) -> str:
    """File name of a view's render, as the photo's is in Unicode's composed form."""
    return f"{unicodedata.normalize('NFC', Path(name).stem)}.png"


def _means(scores: list[ViewScores], objects: list[float]) -> dict[str, Any]:
    out: dict[str, Any] = {
        name: mean_of([(score.sharp or {}).get(name) for score in scores]) for name in ("psnr", "ssim", "psnr_inside")
    }
    out["psnr_object"] = mean_of([_finite(value) for value in objects])
    out["edge_sharpness"] = mean_of([score.edge_sharpness for score in scores])
    out["degraded_psnr"] = mean_of([(score.degraded or {}).get("psnr") for score in scores])
    bands: dict[str, dict[str, float | None]] = {}
    for score in scores[:1]:
        for index, one in enumerate(score.bands):
            own = [other.bands[index] for other in scores if len(other.bands) > index]
            bands[f"{one['coarsest']:g}-{one['finest']:g}"] = {
                key: mean_of([entry[key] for entry in own]) for key in ("gain", "correlation", "energy")
            }
    out["bands"] = bands
    return out


def _concordance(rows: list[dict[str, Any]]) -> float | None:
    true = [row["true"] for row in rows]
    seen = [float("nan") if row["rendered"] is None else row["rendered"] for row in rows]
    return _finite(concordance(true, seen), 2)


def _median_of(parts: list[Any]) -> float:
    joined = np.concatenate(parts)
    return float(np.median(joined)) if len(joined) else float("nan")


def _median(parts: list[Any]) -> float | None:
    return _finite(_median_of(parts), 7)


def _finite(value: Any, digits: int = 4) -> float | None:
    """JSON has no NaN."""
    return round(float(value), digits) if np.isfinite(value) else None
