"""The text of a shader: the constants that it shares with Python, the parts that it uses, itself."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from ... import colour, constants
from ...rasterizer.projection import SMOOTH_ALPHA_EDGE
from ...training.density.contribution import LEAST_FOOTPRINT
from ...training.loss import photometric_kernels as window
from ...training.loss.photometric import FILL
from ...training.loss.variation import SMOOTH
from .layout import LAYOUT
from .radices import passes_text

_FOLDER = Path(__file__).parent / "shaders"
#: The first line of a shader that uses others: '// uses: view, shape'.
_USES = re.compile(r"^// uses: (.+)$", re.MULTILINE)
#: A line that stands once for each tap of SSIM's window besides the middle one, `{t}` for its distance: a card reads an
#: array at an index known only at run time from its slow memory.
_EACH_TAP = re.compile(r"^(.*) // each tap {t}$", re.MULTILINE)
#: A binding's kind, in the order of their numbers.
_BINDING = re.compile(r"@binding\((\d+)\)\s+var<(uniform|storage, read_write|storage, read|storage)>")


def constants_text() -> str:
    """Every number of `core.constants` (those of a tuple one by one, as SH_C2_0), and of `layout`, as WGSL."""
    lines = [f"const SMOOTH_ALPHA_EDGE = {SMOOTH_ALPHA_EDGE!r};"]
    for name, value in vars(constants).items():
        if name.isupper():
            values = {name: value} if not isinstance(value, tuple) else {f"{name}_{i}": v for i, v in enumerate(value)}
            lines += [f"const {key} = {number!r};" for key, number in values.items()]
    lines += [f"const {name} = {value}u;" for name, value in LAYOUT.items()]
    lines += [f"const SSIM_C1 = {window.C1!r};", f"const SSIM_C2 = {window.C2!r};"]
    lines += [f"const WINDOW_REACH = {window.REACH}u;", f"const PHOTO_FILL = {FILL!r};"]
    lines += [f"const WINDOW_TAP_{t} = {tap!r};" for t, tap in enumerate(window._TAPS)]
    lines += [f"const SRGB_{name} = {getattr(colour, '_' + name)!r};" for name in ("SLOPE", "OFFSET", "POWER")]
    lines += [f"const SRGB_KNEE = {colour._SRGB_KNEE!r};"]
    lines += [f"const SMOOTH_SQUARED = {SMOOTH**2!r};", f"const LEAST_FOOTPRINT = {LEAST_FOOTPRINT!r};"]
    return "\n".join(lines) + "\n"


@cache
def shader_text(name: str) -> str:
    """A whole shader, ready to be compiled; a number after a slash is the length of lines that it is written for."""
    name, _, length = name.partition("/")
    seen: dict[str, str] = {}

    def take(part: str) -> None:
        if part in seen:
            return
        text = (_FOLDER / f"{part}.wgsl").read_text("utf-8")
        for used in _USES.findall(text):
            for other in used.split(","):
                take(other.strip())
        seen[part] = text

    take(name)
    if length:
        seen["passes"] = passes_text(int(length))
    return constants_text() + _EACH_TAP.sub(_for_each_tap, "\n".join(seen.values()))


def _for_each_tap(line: re.Match[str]) -> str:
    return "\n".join(line[1].replace("{t}", str(t)) for t in range(1, window.REACH + 1))


@cache
def bindings(name: str) -> tuple[str, ...]:
    """What a shader binds, by number: 'uniform', 'storage, read' or 'storage, read_write'."""
    found = sorted((int(number), kind) for number, kind in _BINDING.findall(shader_text(name)))
    assert [number for number, _ in found] == list(range(len(found))), name
    return tuple(kind for _, kind in found)
