"""The points that are measured: the product's presets, and its balanced one with one knob turned at a time."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Literal

from ...core.effects.registry import switches
from ...core.training.settings import TrainingSettings

Cameras = Literal["usual", "unrefined", "hurried", "refined"]

GROUPS = (
    "preset",
    "iterations",
    "gaussians",
    "resolution",
    "harmonics",
    "blur",
    "float width",
    "loss",
    "cameras",
    "effects",
)


@dataclass(frozen=True)
class Knob:
    """One point.

    Attributes:
        group: which knob; label: how far it is turned, as charts say it.
        changes: of the training's settings.
        cameras: how they are found; effects: what `--effects` would say.
        bits: of each number of the finished twin.
        medium: whether the training is given the blur at all.
    """

    group: str
    label: str
    changes: Mapping[str, Any] = field(default_factory=dict)
    cameras: Cameras = "usual"
    effects: str = "none"
    bits: Literal[16, 32] = 32
    medium: bool = True

    @property
    def name(self) -> str:
        """For files."""
        return f"{self.group}-{self.label}".replace(" ", "_").replace("/", "-").replace(",", "")

    def settings(self, base: TrainingSettings) -> TrainingSettings:
        """The training of this point."""
        return replace(base, **dict(self.changes))


def base_settings(quick: bool) -> TrainingSettings:
    """The balanced preset, from which knobs are turned."""
    base = TrainingSettings.preset("balanced")
    return replace(base, steps=60, max_gaussians=2000) if quick else base


def knobs(quick: bool, only: Sequence[str] = ()) -> list[Knob]:
    """All points of the groups that are asked for (all if none); the balanced preset is always the first."""
    balanced = Knob("preset", "balanced")
    chosen = [knob for knob in (_quick() if quick else _all()) if not only or knob.group in only]
    return [balanced, *(knob for knob in chosen if knob != balanced)]


def _quick() -> list[Knob]:
    return [
        Knob("iterations", "30 steps", {"steps": 30}),
        Knob("gaussians", "1000 Gaussians", {"max_gaussians": 1000}),
        Knob("resolution", "grid 2 px", {"grid_step": 2}),
        Knob("harmonics", "SH 0", {"sh_degree": 0}),
        Knob("blur", "Fourier", {"blur_evaluation": "fourier"}),
        Knob("blur", "splats", {"blur_evaluation": "splats"}),
        Knob("float width", "16-bit twin", bits=16),
        Knob("loss", "no SSIM", {"ssim_weight": 0.0}),
        Knob("cameras", "poses through the loss", cameras="refined"),
        Knob("effects", "without the blur", medium=False),
    ]


def _all() -> list[Knob]:
    found = []
    for name in ("draft", "fine"):
        preset = TrainingSettings.preset(name)
        changes = {"steps": preset.steps, "max_gaussians": preset.max_gaussians}
        found.append(Knob("preset", name, changes, cameras="hurried" if name == "draft" else "usual"))
    found += [Knob("iterations", f"{n} steps", {"steps": n}) for n in (100, 200, 500, 4000)]
    for count in (5000, 10_000, 20_000, 80_000):
        found.append(Knob("gaussians", f"{count // 1000}k Gaussians", {"max_gaussians": count}))
    found += [Knob("resolution", f"grid {n} px", {"grid_step": n}) for n in (1, 2, 3, 4)]
    found += [Knob("resolution", "no coarse start", {"coarse_share": 0.0})]
    found += [Knob("harmonics", f"SH {n}", {"sh_degree": n}) for n in (0, 2, 3)]
    found += [
        Knob("blur", name, {"blur_evaluation": name.lower()})
        for name in ("direct", "separable", "Fourier", "reduced", "splats")
    ]
    found += [Knob("float width", "16-bit twin", bits=16)]
    found += [
        Knob("loss", "no SSIM", {"ssim_weight": 0.0}),
        Knob("loss", "no variation", {"variation_weight": 0.0}),
        Knob("loss", "no sharpened start", {"start_share": 0.0}),
        Knob("loss", "paper's loss", {"loss": "paper"}),
        Knob("cameras", "cameras unrefined", cameras="unrefined"),
        Knob("cameras", "cameras hurried", cameras="hurried"),
        Knob("cameras", "poses through the loss", cameras="refined"),
        Knob("effects", "without the blur", medium=False),
    ]
    # Blurs that vary are confirmed by points and paths by photo: what they cost is another study's (docs/effects.md).
    named = [n for n, switch in switches().items() if switch.confirmed_by == "trial" and not switch.may_be_absent]
    return [*found, *(Knob("effects", f"with {name}", effects=name) for name in named)]
