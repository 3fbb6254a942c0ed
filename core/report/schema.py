"""What report.json holds: the one list that the writer, the tests and docs/report.md agree on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

#: Raised when a field changes its meaning or goes; new fields alone do not raise it.
SCHEMA_VERSION = 1


@dataclass(frozen=True)
class Field:
    """One field of report.json.

    Attributes:
        path: names joined by dots.
        kind: 'number', 'integer', 'text', 'list', 'object' or 'boolean'.
        meaning: what it says, with its unit.
        nullable: null where it does not apply or could not be measured.
    """

    path: str
    kind: str
    meaning: str
    nullable: bool = False


FIELDS = (
    Field("schema", "integer", "version of this list"),
    Field("status", "text", "'done', 'time limit', 'quality', 'plateau' or 'cancelled'"),
    Field("photos.folder", "text", "where the photos came from"),
    Field("photos.given", "integer", "readable photos in the folder"),
    Field("photos.registered", "integer", "photos whose camera is known"),
    Field("photos.unregistered", "list", "names of the others"),
    Field("photos.size", "list", "width and height in px of the first photo as used", True),
    Field("photos.scale", "number", "size as used / size in the file; 1 unless --max-size shrank it"),
    Field("photos.background", "text", "what stands behind the object: 'white', 'black' or '#rrggbb'", True),
    Field("photos.transparent", "integer", "photos with alpha: what is transparent is empty"),
    Field("cameras.source", "text", "'sfm' (found from the photos) or 'given' (--cameras)"),
    Field("cameras.file", "text", "the given model", True),
    Field("cameras.focal_px", "number", "median focal length in px of the photos as used", True),
    Field("cameras.reprojection_error_px", "number", "mean reprojection error of the sparse points in px", True),
    Field("cameras.points", "integer", "sparse points that the training started from"),
    Field("cameras.points_scattered", "boolean", "whether they are random ones, because the cameras came without any"),
    Field("cameras.world_offset", "list", "x, y, z taken from all positions, where float32 could not hold them", True),
    Field(
        "cameras.refined",
        "object",
        "with --refine-cameras: kept, moved_px, focal_change, loss_before, loss_after "
        "and its error (8-bit steps squared, held-out photos), error_before, error_after against true cameras",
        True,
    ),
    Field("medium.psf", "text", "the point spread function as asked for; 'none' without"),
    Field("medium.blur_space", "text", "'srgb' or 'linear': the values that the blur acts on"),
    Field(
        "medium.per_photo",
        "object",
        "point spreads of photos with one of their own, by name, px of the files, as --psf takes them",
    ),
    Field(
        "medium.per_photo_sigma",
        "list",
        "least and largest standard deviation of those, px of the photos as used",
        True,
    ),
    Field(
        "effects",
        "list",
        "per effect: name, on, why, evidence, gain_db, gain_error_db, seconds, parameters; empty without any",
    ),
    Field("gaussians", "integer", "Gaussians in the twin", True),
    Field("steps", "integer", "optimization steps done", True),
    Field("seconds.start", "number", "from the start of the process to the first work, in s", True),
    Field("seconds.photos", "number", "reading and undistorting photos, in s", True),
    Field("seconds.sfm", "number", "finding (or reading) the cameras, in s", True),
    Field("seconds.surface", "number", "looking for the surfaces that the training begins with, in s", True),
    Field("seconds.refine", "number", "moving the cameras by the loss, in s", True),
    Field("seconds.effects", "number", "looking for effects and trying them, in s; null with --effects none", True),
    Field("seconds.compile", "number", "compiling the kernels, in s; small when they were cached", True),
    Field("seconds.prepare", "number", "before and after the training: views, first Gaussians, plan, twin, in s", True),
    Field("seconds.train", "number", "training, in s", True),
    Field("seconds.save", "number", "rendering held-out views, scoring and writing, in s", True),
    Field("seconds.total", "number", "everything before this report, in s"),
    Field(
        "predicted",
        "object",
        "what was said before: by 'plan' (a time limit) or 'estimate'; seconds, memory_mb, psnr",
        True,
    ),
    Field("peak_memory_mb", "number", "most memory held, child processes included, in MB (10^6 bytes)", True),
    Field("heldout.names", "list", "held-out views that were rendered and scored"),
    Field("heldout.unregistered", "list", "held-out views without a camera, which cannot be scored"),
    Field("heldout.every", "integer", "every how many-th view by sorted name was held out; 0: none"),
    Field("heldout.in_sfm", "boolean", "whether held-out photos took part in finding the cameras"),
    Field(
        "heldout.moved_px",
        "number",
        "how far from where it was found a held-out photo's camera was on average by its learned path, median in px:"
        " the sharp view is taken from there; null where cameras were given, or no paths learned",
        True,
    ),
    Field("heldout.degraded.psnr", "number", "twin through the medium against the photos, mean in dB", True),
    Field("heldout.degraded.ssim", "number", "the same, mean SSIM", True),
    Field("heldout.degraded.psnr_matched", "number", "PSNR with gains taken from each photo itself", True),
    Field(
        "heldout.degraded.psnr_halves",
        "number",
        "PSNR with gain and offset per channel from the other half of each photo; only where exposure is learned",
        True,
    ),
    Field("heldout.sharp.psnr", "number", "twin against the sharp truth, mean in dB", True),
    Field("heldout.sharp.ssim", "number", "the same, mean SSIM", True),
    Field("heldout.sharp.psnr_inside", "number", "the same without a 30 px border, mean in dB", True),
    Field(
        "heldout.truth_low_passed_psnr",
        "number",
        "PSNR in dB of the truth itself without periods below resolvable_period_px",
        True,
    ),
    Field("heldout.bands", "list", "per band of periods: finest, coarsest (px), gain, correlation, energy"),
    Field("heldout.edge_sharpness", "number", "slope at the truth's strongest edges / the truth's own", True),
    Field("heldout.views", "list", "per view: name, degraded {psnr, ssim}, sharp {psnr, ssim} or null"),
    Field(
        "verdict.level", "text", "'good', 'doubtful' or 'poor' prediction of unseen photos; 'unknown': none held out"
    ),
    Field("verdict.sentence", "text", "the same in words"),
    Field("verdict.unseen", "number", "share of held-out photos' variance that the twin leaves unexplained", True),
    Field("verdict.fitted", "number", "the same of a few photos that it was trained on", True),
    Field("verdict.views", "list", "sentences about the worst held-out views"),
    Field("verdict.help", "list", "what would make the twin better"),
    Field("resolvable_period_px", "number", "finest detail that one photo still holds, period in px; 2 without blur"),
    Field("settings", "object", "all settings that the run used"),
    Field("versions", "object", "program and library versions"),
    Field("machine", "object", "system, processor, cores, threads, and the device that the twin was trained on"),
    Field("counters", "object", "what was culled, clamped, refused, masked or left out, and how often"),
    Field("notes", "list", "sentences that the run said"),
    Field("history", "list", "training over time: step, seconds, loss, heldout_psnr where measured"),
)

_KINDS: dict[str, tuple[type, ...]] = {
    "number": (int, float),
    "integer": (int,),
    "text": (str,),
    "list": (list,),
    "object": (dict,),
    "boolean": (bool,),
}


def lookup(report: dict[str, Any], path: str) -> Any:
    """The value at a dotted path; KeyError if it is not there."""
    value: Any = report
    for name in path.split("."):
        value = value[name]
    return value


def problems(report: dict[str, Any]) -> list[str]:
    """What a report lacks or has of a wrong kind; empty for a good one."""
    found = []
    for field in FIELDS:
        try:
            value = lookup(report, field.path)
        except (KeyError, TypeError):
            found.append(f"{field.path} is missing")
            continue
        if value is None:
            if not field.nullable:
                found.append(f"{field.path} is null")
        elif not isinstance(value, _KINDS[field.kind]) or (isinstance(value, bool) and field.kind != "boolean"):
            found.append(f"{field.path} is {type(value).__name__}, not {field.kind}")
    return found


def markdown_table() -> str:
    """The list as it stands in docs/report.md."""
    rows = [
        f"| `{f.path}` | {f.kind}{' or null' if f.nullable else ''} | {f.meaning} |".replace("||", "|") for f in FIELDS
    ]
    return "\n".join(["| field | kind | meaning |", "|---|---|---|", *rows])
