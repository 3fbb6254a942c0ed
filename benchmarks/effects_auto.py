"""Is `--effects auto` as accurate as `none` and cheaper than `all`? Whole reconstructions of sets with known effects.

    python -m benchmarks.effects_auto [--only haze,clean] [--preset draft] [--gaussians 4000]

Draws small scenes, does known things to their light, runs the product's own pipeline (known cameras, one thread) with
--effects none, auto and all, and once more with nothing left out: `all` skips what the photos show no size of; this
arm simulates every effect at its smallest visible size at least, as one does who does not look. Writes the table
between the markers in docs/studies/effects.md. Resumable: runs of the same code are kept in
benchmarks/data/effects_auto.
"""

from __future__ import annotations

import argparse
import hashlib
import json
import math
import os
import shutil
import time
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path

import torch
from dgs.core.effects import registry
from dgs.core.effects.defocus import Defocus
from dgs.core.effects.field_blur import FieldBlur
from dgs.core.effects.haze import SETTINGS as HAZE
from dgs.core.effects.haze import Haze
from dgs.core.effects.spec import EffectSpec
from dgs.core.imaging.formation.effect import Effect
from dgs.core.inspection.photo_set import PhotoSet
from dgs.core.pipeline.reconstruct import reconstruct
from dgs.core.progress import Silent
from dgs.core.run_settings import ReconstructSettings

from .effect_scenes import Truth, degrade, make_scene, write_set

ROOT = Path(__file__).resolve().parents[1]

USUAL = registry.EFFECTS
KEPT = ROOT / "benchmarks/data/effects_auto"
PAGE = ROOT / "docs/studies/effects.md"
START, END = "<!-- auto -->", "<!-- end of auto -->"
WIDTH, HEIGHT, PHOTOS, HELD_EVERY = 240, 160, 16, 4
#: Every set is blurred by this, px, in linear light: the medium that all runs are found.
SIGMA = 2.0
#: What is done to the photos; scenes that the inspection's own table does not use.
SETS = {
    "clean, scene 101": (101, {}),
    "clean, scene 102": (102, {}),
    "haze 0.3": (103, {"haze": 0.3}),
    "haze 0.6": (104, {"haze": 0.6}),
    "vignetting 25 %": (105, {"vignetting": 0.25}),
    "vignetting 45 %": (106, {"vignetting": 0.45}),
    "exposure 10 %": (107, {"exposure": 0.10}),
    "exposure 20 %": (108, {"exposure": 0.20}),
    "saturation 15 %": (110, {"saturation": 0.15}),
    "defocus 2 px": (111, {"defocus": 2.0}),
    "defocus 4 px": (112, {"defocus": 4.0}),
    "field blur 2 px": (113, {"field": 2.0}),
    "motion 6 px": (111, {"motion": 6.0}),
    "motion 12 px": (112, {"motion": 12.0}),
    "haze 0.3 + vignetting 25 % + exposure 10 %": (114, {"haze": 0.3, "vignetting": 0.25, "exposure": 0.10}),
    "defocus 3 px + exposure 10 %": (115, {"defocus": 3.0, "exposure": 0.10}),
}
ARMS = ("none", "auto", "all", "nothing left out")


def code() -> str:
    """Changes where a run, or what makes the sets, does."""
    packages = ("inspection", "pipeline", "imaging", "training", "rasterizer", "evaluation")
    files = [f for package in packages for f in sorted((ROOT / "core" / package).rglob("*.py"))]
    files += [ROOT / "benchmarks/effect_scenes.py", Path(__file__)]
    return hashlib.sha256(b"".join(f.read_bytes() for f in files)).hexdigest()[:12]


def one_set(name: str, width: int, height: int) -> Path:
    """The photos and cameras of a set, drawn once."""
    seed, done = SETS[name]
    folder = KEPT / "sets" / f"{seed}_{SIGMA:g}_{width}_{PHOTOS}_{'_'.join(f'{k}{v:g}' for k, v in done.items())}"
    if not (folder / "truth").is_dir():
        scene = make_scene(seed, width=width, height=height, views=PHOTOS, finer=2)
        kept = {k: v for k, v in done.items() if k not in ("defocus", "field", "motion")}
        sharp = degrade(scene, Truth(**kept), seed)
        write_set(folder, scene, degrade(scene, Truth(psf=(SIGMA, SIGMA, 0.0), **done), seed), sharp)
    return folder


def visible(spec: EffectSpec) -> EffectSpec:
    """An effect that is nowhere smaller than what is just visible."""
    if spec.switch is None or spec.switch.build is None:
        return spec
    build = partial(at_least_visible, spec.name, spec.switch.shared or spec.switch.build)
    return replace(spec, switch=replace(spec.switch, build=build))


def at_least_visible(name: str, usual: Callable[[PhotoSet], Effect | None], photos: PhotoSet) -> Effect | None:
    """The effect as the photos show it, but nowhere smaller than what is just visible."""
    found = usual(photos)
    diagonal = math.hypot(*photos.greys[0].shape)
    if name == "haze":
        attenuation, veil = (torch.full((3,), v) for v in (HAZE.smallest_visible, 0.7))
        if found is None or float(found.parameters["attenuation"].mean()) < HAZE.smallest_visible:
            return Haze(attenuation, veil)
    if name == "defocus" and (found is None or float(found.parameters["strength"]) < 1.0 / diagonal):
        return Defocus(torch.tensor(1.0 / 0.6 / diagonal), torch.tensor(1.0))  # 1 / depth differs by 0.6 of its median
    if name == "field_blur" and (found is None or abs(float(found.parameters["corner"])) < 1.0 / diagonal):
        return FieldBlur(torch.tensor(1.0 / diagonal))
    return found


def run(folder: Path, effects: str, preset: str, gaussians: int) -> dict:
    """One reconstruction: scores on held-out photos, seconds, decisions."""
    registry.EFFECTS = tuple(visible(spec) for spec in USUAL) if effects == "nothing left out" else USUAL
    out = KEPT / f"running_{os.getpid()}"
    shutil.rmtree(out, ignore_errors=True)
    settings = ReconstructSettings(
        photos=folder / "photos",
        out=out,
        psf=f"gaussian:{SIGMA:g}",
        blur_space="linear",
        threads=1,
        device="cpu",
        cameras=folder / "cameras",
        holdout_every=HELD_EVERY,
        preset=preset,
        max_gaussians=gaussians,
        effects="all" if effects == "nothing left out" else effects,
        truth=folder / "truth",
    )
    wall, processor = time.perf_counter(), time.process_time()
    report = reconstruct(settings.split(), Silent()).report
    row = {
        "effects": effects,
        "wall": time.perf_counter() - wall,
        "processor": time.process_time() - processor,
        **{k: report["heldout"]["degraded"][k] for k in ("psnr", "psnr_matched")},
        "sharp": report["heldout"]["sharp"]["psnr"],
        "seconds": report["seconds"],
        "steps": report["steps"],
        "gaussians": report["gaussians"],
        "load": os.getloadavg()[0],
        "decisions": [
            {k: d[k] for k in ("name", "on", "why", "gain_db", "gain_error_db", "seconds")} for d in report["effects"]
        ],
    }
    shutil.rmtree(out, ignore_errors=True)
    return row


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--only", default="", help="sets whose name holds one of these words, with commas")
    parser.add_argument("--preset", default="draft", choices=("draft", "balanced"))
    parser.add_argument("--gaussians", type=int, default=4000)
    parser.add_argument("--size", type=int, nargs=2, default=(WIDTH, HEIGHT), metavar=("W", "H"))
    parser.add_argument("--arms", nargs="+", default=ARMS, choices=ARMS, help="fewer than all print no table")
    options = parser.parse_args()
    words = [word.strip() for word in options.only.split(",") if word.strip()]
    names = [name for name in SETS if not words or any(word in name for word in words)]
    kept = KEPT / f"{code()}_{options.preset}_{options.gaussians}_{options.size[0]}"
    rows, warm = {}, False
    for name in names:
        folder = one_set(name, *options.size)
        for effects in options.arms:
            file = kept / f"{name.replace(' ', '_').replace('%', 'p')}_{effects}.json"
            if not file.is_file():
                if not warm:  # kernels are compiled, and modules loaded, before a clock runs
                    run(folder, "all", "draft", 500)
                    warm = True
                kept.mkdir(parents=True, exist_ok=True)
                file.write_text(json.dumps(run(folder, effects, options.preset, options.gaussians)))
            rows[name, effects] = row = json.loads(file.read_text())
            on = [d["name"] for d in row["decisions"] if d["on"]]
            print(
                f"{name}, {effects}: {row['psnr_matched']:.2f} dB matched, {row['psnr']:.2f} dB, "
                f"{row['processor']:.1f} s of processor, {row['wall']:.1f} s, on: {on}",
                flush=True,
            )
    if set(options.arms) != set(ARMS):
        return
    text = table(names, rows)
    print(text)
    if names == list(SETS) and options.preset == "draft" and START in PAGE.read_text():
        head, _, rest = PAGE.read_text().partition(START)
        PAGE.write_text(f"{head}{START}\n{text}\n{END}{rest.partition(END)[2]}")


def table(names: list[str], rows: dict) -> str:
    """Markdown: scores and processor time of the three, what auto decided, and the two targets."""
    lines = [
        "| photos | none, dB | auto - none | all - none | auto - none, as filed | sharp: none, dB | auto - none "
        "| all - none | none, s | auto, s | all, s | nothing left out, dB, s "
        "| auto / all | auto / nothing left out | auto: gain of the trial, dB |",
        "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
    ]
    share = {n: rows[n, "auto"]["processor"] / rows[n, "all"]["processor"] for n in names}
    gain = {}
    for name in names:
        none, auto, every, full = (rows[name, effects] for effects in ARMS)
        matched, filed = (auto[kind] - none[kind] for kind in ("psnr_matched", "psnr"))
        gain[name] = min(matched, filed)
        tried = [
            f"{d['name']} {d['gain_db']:+.2f} +- {d['gain_error_db']:.2f}, {'on' if d['on'] else 'off'}"
            for d in auto["decisions"]
            if d["gain_db"] is not None
        ]
        lines.append(
            f"| {name} | {none['psnr_matched']:.2f} | {matched:+.2f} | "
            f"{every['psnr_matched'] - none['psnr_matched']:+.2f} | {filed:+.2f} | "
            f"{none['sharp']:.2f} | {auto['sharp'] - none['sharp']:+.2f} | {every['sharp'] - none['sharp']:+.2f} | "
            f"{none['processor']:.1f} | "
            f"{auto['processor']:.1f} | {every['processor']:.1f} | "
            f"{full['psnr_matched'] - none['psnr_matched']:+.2f}, {full['processor']:.1f} | {share[name]:.2f} | "
            f"{auto['processor'] / full['processor']:.2f} | {'; '.join(tried) or 'none'} |"
        )
    worst = min(gain, key=gain.__getitem__)
    single = {n: share[n] for n in names if len(SETS[n][1]) == 1}
    loads, walls = ([r[kind] for r in rows.values()] for kind in ("load", "wall"))
    lines += [
        "",
        f"Auto against none: at worst {gain[worst]:+.2f} dB ({worst}); not worse by more than 0.1 dB in "
        f"{sum(g >= -0.1 for g in gain.values())} of {len(gain)} sets. Auto against all, sets with one effect: at "
        f"least 30 % cheaper in {sum(s <= 0.7 for s in single.values())} of {len(single)}; against nothing left out in "
        f"{sum(rows[n, 'auto']['processor'] <= 0.7 * rows[n, ARMS[3]]['processor'] for n in single)}. Load average "
        f"meanwhile {min(loads):.1f} to {max(loads):.1f}; the clock on the wall showed "
        f"{sum(walls) / sum(r['processor'] for r in rows.values()):.2f} times the processor time.",
    ]
    return "\n".join(lines)


if __name__ == "__main__":
    main()
