"""Frosted glass read off the points of drawn scenes: sheets that lean, that stand, that do neither, and even blurs.

    python -m benchmarks.glass_planes [--scenes 1 2 3]

Ten photos of 288 x 192 px of each scene with true cameras and points, blurred by the engine's own glass or by an even
point spread. Prints a row for each set: the truth, and what `core.inspection.glass_planes` says of it, nothing given.
"""

from __future__ import annotations

import argparse
import math
from dataclasses import dataclass

import numpy as np
import torch
from dgs.core.colour import linear_to_srgb
from dgs.core.effects.glass import inspect
from dgs.core.imaging.formation.glass import oblique
from dgs.core.imaging.formation.occluding import OccludingBlur
from dgs.core.imaging.formation.stands import middle_of
from dgs.core.inspection.glass_planes import glass_of
from dgs.core.inspection.photo_set import PhotoSet

from .effect_scenes import MARGIN, Truth, degrade, make_scene
from .effects import photo_set

#: px far behind the glass.
FAR = 5.0
SIZE = {"width": 288, "height": 192, "views": 10, "finer": 1}


@dataclass(frozen=True)
class Sheet:
    """A sheet of glass before a drawn scene.

    Attributes:
        share: of the nearest depth, where it stands on the axis.
        lean: degrees by which its normal leans towards the right and downwards.
        standing: in the world, before the middle camera, instead of moving with the camera.
    """

    share: float
    lean: tuple[float, float] = (0.0, 0.0)
    standing: bool = False


#: Those that the search was written on (scenes 1 to 3) are the first two.
SHEETS = (
    Sheet(0.7, (25.0, -10.0)),
    Sheet(0.6, (15.0, 10.0), standing=True),
    Sheet(0.75),
    Sheet(0.65, (18.0, 12.0)),
    Sheet(0.6, (-20.0, 5.0), standing=True),
    Sheet(0.6, standing=True),
)
EVEN = tuple(Truth(psf=(s, s, 0.0), space=space) for s in (1.5, 2.5, 4.0) for space in ("linear", "srgb"))


def behind_sheet(seed: int, sheet: Sheet) -> tuple[PhotoSet, float]:
    """Photos of a drawn scene through a sheet, and the sheet's distance on the axis."""
    scene, inner = make_scene(seed, **SIZE), slice(MARGIN, -MARGIN)
    distance = sheet.share * float(np.quantile(scene.depth[:, inner, inner], 0.02))
    first = np.array([*np.tan(np.radians(sheet.lean)), 1.0]) / distance
    middle = scene.cameras[middle_of(np.array([camera.centre for camera in scene.cameras]))]
    photos = []
    for camera, light, depth in zip(scene.cameras, scene.light, scene.depth, strict=True):
        plane = first
        if sheet.standing:
            turn, moved = middle.rotation @ camera.rotation.T, middle.rotation @ (camera.centre - middle.centre)
            plane = turn.T @ first / (1.0 - moved @ first)
        y, x = np.mgrid[: depth.shape[0], : depth.shape[1]] + 0.5 - MARGIN
        x, y = (x - camera.cx) / camera.fx, (y - camera.cy) / camera.fx
        met = plane[0] * x + plane[1] * y + plane[2]
        cosine = met / np.sqrt((plane @ plane) * (1.0 + x**2 + y**2))
        sigma = FAR * oblique(x**2 + y**2, cosine) * np.clip(1.0 - 1.0 / (met * depth), 0.0, None)
        blur = OccludingBlur(-torch.from_numpy(sigma).float(), "gaussian")
        seen = blur.apply(torch.from_numpy(light).permute(2, 0, 1)).permute(1, 2, 0).numpy()[inner, inner]
        photos.append(np.round(255 * linear_to_srgb(np.clip(seen, 0, 1))).astype(np.uint8))
    return photo_set(scene, photos), distance


def said(photos: PhotoSet) -> str:
    """What the points say, in a line."""
    seen, needed = photos.once(glass_of), inspect(photos).needed
    if seen is None:
        return "nothing"
    text = f"{'glass' if needed else 'no glass'}: grows {seen.grows:.2f} +- {seen.grows_error:.2f} px, "
    text += f"{seen.over_even.errors:.1f} errors over an even blur, "
    text += f"{seen.over_camera.errors:.1f} over a glass at the camera"
    if seen.plane is None:
        return f"{text}; parallel at {seen.distance:.3f} +- {seen.distance_error:.3f}"
    plane = seen.plane
    angles = [math.degrees(math.atan(lean)) for lean in plane.lean]
    errors = [math.degrees(error) for error in plane.lean_error]
    return (
        f"{text}; {'stands' if plane.standing else 'leans'} at {plane.distance:.3f} +- {plane.distance_error:.3f}, "
        f"{angles[0]:.1f} +- {errors[0]:.1f} and {angles[1]:.1f} +- {errors[1]:.1f} degrees, "
        f"{plane.over_parallel.errors:.1f} errors over a parallel one, {plane.over_even.errors:.1f} over an even blur"
    )


def main() -> None:
    """Prints all rows."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, nargs="+", default=[1, 2, 3, 4, 5, 6])
    for seed in parser.parse_args().scenes:
        for sheet in SHEETS:
            photos, distance = behind_sheet(seed, sheet)
            kind = "standing" if sheet.standing else "moving"
            print(f"{seed}, {kind} at {distance:.3f}, {sheet.lean}: {said(photos)}", flush=True)
        scene = make_scene(seed, **SIZE)
        for even in EVEN:
            print(
                f"{seed}, even {even.psf[0]} px, {even.space}: {said(photo_set(scene, degrade(scene, even, 1)))}",
                flush=True,
            )


if __name__ == "__main__":
    main()
