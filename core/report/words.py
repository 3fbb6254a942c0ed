"""What a report says in words: what the run modelled, what it did not, and what photos cannot show."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from ..effects.registry import all_effects, effect_named
from ..imaging.formation.focus import OUT_OF_FOCUS
from ..run_settings import FROSTED_GLASS

#: The share of the Gaussians that no photo has in focus, from which on a report speaks of them.
WORTH_SAYING = 0.05


def simulated(report: Mapping[str, Any]) -> list[str]:
    """What the image formation of this run contains."""
    medium, training = report["medium"], report["settings"]["training"]
    space = "linear light" if medium["blur_space"] == "linear" else "the photos' sRGB values"
    blur = (
        f"The blur: every render is convolved with the point spread function {medium['psf']}, the same over the whole "
        f"frame, on {space}."
        if medium["psf"] != "none"
        else "No point spread that all photos share: each was blurred in its own way, as below."
        if blurred_by_effects(report)
        else "No blur: the photos were taken as sharp (psf none)."
    )
    effects = [effect for effect in report.get("effects", ()) if effect["on"]]
    behind = next((effect["parameters"] for effect in effects if effect["name"] == FROSTED_GLASS), None)
    if behind is not None:
        blur = _glass(behind)
    own = medium.get("per_photo_sigma")
    if own is not None:
        blur += f" {len(medium['per_photo'])} photos have one of their own, {own[0]:.2f} to {own[1]:.2f} px wide."
    degree = training.get("sh_degree")
    gloss = (
        "Colours that do not change with the direction of view."
        if degree == 0
        else f"Colours that change with the direction of view (spherical harmonics of degree {degree})."
    )
    return [
        blur,
        *_background(report.get("photos", {})),
        *(_sentence(effect["name"]) for effect in effects),
        "Perspective and lens distortion of each photo, with the light from just outside the frame.",
        gloss,
        "Opacity and occlusion of the Gaussians in depth order.",
    ]


def blurred_by_effects(report: Mapping[str, Any]) -> list[str]:
    """What the photos are called after the effects that blurred them, besides a point spread; [] for none."""
    on = (effect_named(effect["name"]) for effect in report.get("effects", ()) if effect["on"])
    return [spec.words.blurred for spec in on if spec is not None and spec.words.blurred]


def _background(photos: Mapping[str, Any]) -> list[str]:
    """What is behind the object, where that is known."""
    colour = photos.get("background")
    if colour is None:
        return []
    if photos.get("transparent"):
        return [f"Empty space where the photos are transparent; photos and twin are shown and compared over {colour}."]
    return [f"Empty space where the photos show the plain background; {colour} stands behind the twin."]


def _out_of_focus(report: Mapping[str, Any]) -> list[str]:
    """What no photo has in focus, and what would show it; nothing where that is next to none of the twin."""
    share = report["counters"].get(OUT_OF_FOCUS, 0) / max(1, report["gaussians"])
    if share < WORTH_SAYING:
        return []
    return [
        f"{share:.0%} of the twin's Gaussians lie where no photo is in focus (a blur of 1 px or more in all of them), "
        "and are kept as soft as the sharpest photo shows them. Photos that are focused there, or a smaller aperture, "
        "would show more."
    ]


def _glass(found: Mapping[str, Any]) -> str:
    """Where the glass stands, how it leans, and how wide it blurs."""
    where = _measured(found, "distance", "")
    leans = (
        f", its right edge turned towards the camera by {_measured(found, 'tilt_right', ' degrees')} and its lower "
        f"edge by {_measured(found, 'tilt_down', ' degrees')},"
        if "tilt_right" in found
        else ","
    )
    return (
        f"The blur: that of frosted glass at {where} before the camera (the cameras' unit){leans} which turns light by "
        f"{found['angle']:.3g} degrees: {found['width_nearest']:.2f} px wide on what is nearest, "
        f"{found['width_farthest']:.2f} px on what is farthest."
    )


def _measured(found: Mapping[str, Any], name: str, unit: str) -> str:
    """A value, with its standard error if it was not given."""
    error = found.get(f"{name}_error", 0.0)
    return f"{found[name]:.4g}" + (f" ± {error:.2g}" if error else "") + unit


def _sentence(name: str) -> str:
    """What the report says of an effect that is on; its name where this program has no words for it."""
    spec = effect_named(name)
    return spec.words.simulated if spec is not None and spec.words.simulated else f"The effect '{name}'."


def not_simulated(report: Mapping[str, Any]) -> list[str]:
    """What a real scene may have and this run leaves out."""
    on = {effect["name"] for effect in report.get("effects", ()) if effect["on"]}
    own = report["medium"].get("per_photo_sigma") is not None
    missing = [
        *(
            spec.words.missing
            for spec in all_effects()
            if spec.words.missing and spec.name not in on and not (own and spec.words.covered_by_own_blurs)
        ),
        "Anything that moved between the photos",
    ]
    if report["cameras"]["source"] == "sfm":
        missing.append("Errors of the cameras, which were found from these same blurred photos")
    return missing


def limits(report: Mapping[str, Any]) -> list[str]:
    """What physics leaves out, and how far the scores can be trusted."""
    period, heldout = report["resolvable_period_px"], report["heldout"]
    lines = []
    if period > 2.0:
        lines.append(
            f"Detail finer than about {period:.3g} px is not in the data of one photo: the medium dims it below the "
            "rounding of 8-bit files. What the twin shows there comes from other views that average the "
            "rounding out, or from the smoothness of the fit, or from chance."
        )
    elif blurred_by_effects(report):
        lines.append(
            "Each photo lacks the detail that its own blur took. What the twin shows of it comes from photos that were "
            "blurred otherwise, or less; where all lack the same, from the smoothness of the fit, or from chance."
        )
    else:
        lines.append("Nothing was blurred, so the pixel grid itself (2 px) is the limit of one photo.")
    lines += _out_of_focus(report)
    if heldout["names"] and heldout["in_sfm"]:
        lines.append(
            "The held-out photos were kept out of the training, but they took part in finding the cameras: "
            "without a camera they could not be compared."
        )
    if heldout.get("moved_px") is not None:
        lines.append(
            "Held-out views are shown from where each photo's learned path says that its camera was on average: "
            f"{heldout['moved_px']:.2f} px (median) beside where it had been found."
        )
    if heldout["degraded"]["psnr"] is not None and heldout["sharp"]["psnr"] is None:
        lines.append(
            "No sharp truth was given. Agreement with blurred photos says little about fine detail: a "
            "twin can match them well and still be wrong below the limit above."
        )
    given, registered = report["photos"]["given"], report["photos"]["registered"]
    if registered < 20:
        lines.append(
            f"With {registered} views, how well the photos cover the object decides the score on new views more "
            "than the deblurring does."
        )
    if registered < given:
        lines.append(f"{given - registered} of {given} photos found no camera and were not used.")
    return lines
