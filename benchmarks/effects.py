"""Does `inspect` find what is there, and nothing else? Synthetic sets with known effects, clean ones among them.

    python -m benchmarks.effects [--scenes 12] [--quick]

Writes benchmarks/effects.json and the table between the markers in docs/studies/effects.md. Resumable: sets that were
inspected with the same code are kept in benchmarks/data/effects.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import time
from dataclasses import asdict
from pathlib import Path

from dgs.core.camera import Camera
from dgs.core.effects.inspect import inspect_photos
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.lens import Lens
from dgs.core.photos.load import Photo
from dgs.core.pose import Pose
from dgs.core.progress import Silent
from dgs.core.reconstruction import Figures, Reconstruction

from .effect_scenes import Truth, degrade, kept_scene

ROOT = Path(__file__).resolve().parents[1]

KEPT = ROOT / "benchmarks/data/effects"
#: Effect -> (what is made, given a multiple of the smallest visible size). Clear is 2.
LEVELS = (0.5, 1.0, 2.0, 4.0)
MADE = {
    "blur": lambda x: Truth(psf=(1.1 * x, 1.1 * x, 0.0)),
    "blur_srgb": lambda x: Truth(psf=(1.1 * x, 1.1 * x, 0.0), space="srgb"),
    "defocus": lambda x: Truth(defocus=1.0 * x),
    "motion": lambda x: Truth(motion=3.0 * x),
    "haze": lambda x: Truth(haze=0.08 * x),
    "exposure": lambda x: Truth(exposure=0.03 * x),
    "white_balance": lambda x: Truth(white_balance=0.02 * x),
    "vignetting": lambda x: Truth(vignetting=0.08 * x),
    "noise": lambda x: Truth(noise=1.5 * x),
    "saturation": lambda x: Truth(saturation=0.005 * x),
    "field_blur": lambda x: Truth(field=1.0 * x),
}
#: What else an effect brings with it, so that finding it is no false alarm.
BRINGS = {
    # A blur that differs from photo to photo or with depth is a blur as well.
    "motion": {"blur"},
    "defocus": {"blur", "field_blur"},
    "blur": set(),
    "saturation": {"exposure"},
    "field_blur": {"blur"},
}


def photo_set(scene, pixels) -> PhotoSet:
    """The inspection's view of a set in memory, with true cameras."""

    def lens(c: Camera) -> Lens:
        return Lens("PINHOLE", c.width, c.height, (c.fx, c.fy, c.cx, c.cy))

    names = [c.name for c in scene.cameras]
    poses = {c.name: Pose(c.rotation, c.translation) for c in scene.cameras}
    lenses = {c.name: lens(c) for c in scene.cameras}
    figures = Figures("known", len(names), len(names), scene.cameras[0].fx, 0.0, 0.0, 0.0)
    photos = [Photo(name, Path(name), p) for name, p in zip(names, pixels, strict=True)]
    return PhotoSet(photos, Reconstruction(poses, lenses, scene.points, figures))


def code_of_inspection() -> str:
    """Changes where the inspection, or what makes the sets, does."""
    # What no evidence reads.
    apart = {"blind_psf", "edge_blur", "edge_kernels", "edges", "lower_mode", "pictures", "cameras", "same_points"}
    files = [f for f in sorted((ROOT / "core/inspection").rglob("*.py")) if f.stem not in apart]
    files.append(ROOT / "benchmarks/effect_scenes.py")
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def plan(scenes: int, quick: bool) -> list[tuple[str, float, int]]:
    """(effect, multiple of the smallest visible, scene): every scene clean, every effect clear in five scenes."""
    sets = [("clean", 0.0, s) for s in range(scenes)]
    for i, effect in enumerate(MADE):
        for level in LEVELS:
            count = (5 if level == 2.0 else 2) if not quick else (1 if level == 2.0 else 0)
            sets += [(effect, level, (3 * i + k + int(4 * level)) % scenes) for k in range(min(count, scenes))]
    return sets


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=12)
    parser.add_argument("--quick", action="store_true", help="one clear set per effect")
    options = parser.parse_args()
    code = code_of_inspection()
    rows = []
    for index, (effect, level, seed) in enumerate(sets := plan(options.scenes, options.quick)):
        kept = KEPT / code / f"{effect}_{level:g}_{seed:02d}.json"
        if kept.is_file():
            rows.append(json.loads(kept.read_text()))
            continue
        scene = kept_scene(seed, KEPT)
        truth = MADE[effect](level) if effect != "clean" else Truth()
        pixels = degrade(scene, truth, seed)
        began = time.process_time()
        found = inspect_photos(photo_set(scene, pixels), Silent())
        row = {
            "effect": effect,
            "level": level,
            "scene": seed,
            "truth": asdict(truth),
            "seconds": time.process_time() - began,
            "found": [e.plain() for e in found],
        }
        kept.parent.mkdir(parents=True, exist_ok=True)
        kept.write_text(json.dumps(row))
        rows.append(row)
        needed = [e.name for e in found if e.needed]
        mine = next((e.estimate["value"] for e in found if e.name == effect.removesuffix("_srgb")), None)
        print(f"{index + 1}/{len(sets)} {effect} x{level:g} scene {seed}: {needed} {mine}", flush=True)
    report(rows)


def report(rows: list[dict]) -> None:
    """Confusion matrix, power and false alarms; benchmarks/effects.json and docs/studies/effects.md."""
    names = [e["name"] for e in rows[0]["found"]]
    clean = [r for r in rows if r["effect"] == "clean"]
    alarms = {n: sum(_needed(r, n) for r in clean) for n in names}
    lines = [
        f"{len(rows)} sets of 12 photos (384 x 256 px) of {len({r['scene'] for r in rows})} scenes, {len(clean)} "
        f"of them clean. On the clean sets {sum(alarms.values())} of {len(clean) * len(names)} decisions were false "
        f"alarms. An inspection took {sum(r['seconds'] for r in rows) / len(rows):.1f} s of processor time.",
        "",
        "Found, by size in multiples of the smallest visible one (rows: what was done to the photos):",
        "",
        "| done | x 0.5 | x 1 | x 2 (clear) | x 4 | estimate / truth at x 2 | other effects called needed at x 2 |",
        "|---|---|---|---|---|---|---|",
    ]
    content = {"sets": len(rows), "clean": len(clean), "false_alarms_clean": alarms, "effects": {}}
    for effect in MADE:
        name = effect.removesuffix("_srgb")
        mine = [r for r in rows if r["effect"] == effect]
        cells, found_at = [], {}
        for level in LEVELS:
            at = [r for r in mine if r["level"] == level]
            found_at[level] = (sum(_needed(r, name) for r in at), len(at))
            cells.append(f"{found_at[level][0]} of {len(at)}" if at else "-")
        clear = [r for r in mine if r["level"] == 2.0]
        ratios = [
            v / t
            for r in clear
            if name != "saturation" and (v := _value(r, name)) is not None and (t := true_size(r, name))
        ]
        others: dict[str, int] = {}
        for r in clear:
            for n in names:
                if n != name and n not in BRINGS.get(name, set()) and _needed(r, n):
                    others[n] = others.get(n, 0) + 1
        shown = f"{min(ratios):.2f} to {max(ratios):.2f}" if ratios else "-"
        lines.append(
            f"| {effect} | {' | '.join(cells)} | {shown} | "
            f"{', '.join(f'{n} ({c} of {len(clear)})' for n, c in others.items()) or 'none'} |"
        )
        content["effects"][effect] = {
            "found": {str(k): v for k, v in found_at.items()},
            "ratios": ratios,
            "others": others,
        }
    hits = sum(content["effects"][e]["found"]["2.0"][0] for e in MADE)
    tried = sum(content["effects"][e]["found"]["2.0"][1] for e in MADE)
    lines += ["", f"Clear effects: {hits} of {tried} found."]
    (ROOT / "benchmarks/effects.json").write_text(json.dumps(content, indent=1) + "\n")
    page = ROOT / "docs/studies/effects.md"
    text = "\n".join(lines)
    print(text)
    if page.is_file() and "<!-- validation -->" in page.read_text():
        head, _, rest = page.read_text().partition("<!-- validation -->")
        tail = rest.partition("<!-- end of validation -->")[2]
        page.write_text(f"{head}<!-- validation -->\n{text}\n<!-- end of validation -->{tail}")


def true_size(row: dict, name: str) -> float:
    """The truth in the unit of the estimate."""
    truth = row["truth"]
    return float(truth["psf"][0] if name == "blur" else truth["field" if name == "field_blur" else name])


def _entry(row: dict, name: str) -> dict:
    return next(e for e in row["found"] if e["name"] == name)


def _needed(row: dict, name: str) -> bool:
    return bool(_entry(row, name)["needed"])


def _value(row: dict, name: str) -> float | None:
    return _entry(row, name)["estimate"]["value"]


if __name__ == "__main__":
    main()
